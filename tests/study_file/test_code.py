"""The code outside calib that a study uses."""

import os
import runpy
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from child_environment import environment
from echo_study import TEXT

from calib.execution import module_code as identity
from calib.study_file.code import used_code
from calib.study_file.schema import StudyToml


def stated(simulator):
    return StudyToml.model_validate(tomllib.loads(TEXT.replace("tiny_simulators:Echo", simulator)))


@pytest.fixture
def beside(tmp_path, monkeypatch):
    """Write modules beside a study and import the first; return their code."""
    monkeypatch.syspath_prepend(tmp_path)

    def write(**texts):
        for name, text in texts.items():
            (tmp_path / f"{name}.py").write_text(text)
            monkeypatch.delitem(sys.modules, name, raising=False)
        first = next(iter(texts))
        __import__(first)
        try:
            return used_code(stated(f"{first}:Thing"), tmp_path)
        finally:
            for name in texts:
                sys.modules.pop(name, None)

    return write


SIMULATOR = "import numpy, ident_constants\nfrom ident_law import *\nclass Thing: ...\n"


def test_the_code_of_calib_is_known_by_its_version():
    assert used_code(stated("oscillator"), None) == {}


def test_a_module_and_those_beside_it_that_it_imports_belong_to_it(beside):
    texts = {"ident_simulator": SIMULATOR, "ident_constants": "GAIN = 1.0\n", "ident_law": "from ident_deep import A\n"}
    before = beside(**texts, ident_deep="A = 1\n", ident_other="X = 1\n")
    assert list(before) == ["ident_constants", "ident_deep", "ident_law", "ident_simulator"]
    assert all(text.startswith("sha256 ") for text in before.values())
    after = beside(**texts, ident_deep="A = 2\n", ident_other="X = 2\n")
    assert [name for name in before if before[name] != after[name]] == ["ident_deep"]


@pytest.mark.slow
def test_an_installed_distribution_is_known_by_its_version():
    [(name, text)] = used_code(stated("pytest:Thing"), None).items()
    assert (name, text) == ("pytest", f"pytest {pytest.__version__}")


@pytest.mark.slow
def test_an_editable_distribution_is_known_by_its_source(monkeypatch):
    monkeypatch.setattr(identity.sysconfig, "get_path", lambda kind: str(Path(__file__).parent / "no site"))
    assert set(used_code(stated("pytest:Thing"), None).values()) != {f"pytest {pytest.__version__}"}


CELL = """
GAIN = {gain}
def doubled(x): return 2.0 * x
class Thing:
    names = ("x", "y")
    def run(self, x): return GAIN * doubled(x) if x in {{"a", "b"}} else [y for y in {order}]
"""


def session_codes(*cells, seed="0"):
    """Code of the classes that the cells of an interactive session define one after the other."""
    script = "import test_code\n" + "".join(
        f"exec({cell!r})\nprint(test_code.used_code(test_code.stated('__main__:Thing'), None))\n" for cell in cells
    )
    path = {"PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), environment()["PYTHONPATH"]])}
    variables = {**environment(), **path, "PYTHONHASHSEED": seed}
    return subprocess.run(
        [sys.executable, "-c", script], env=variables, capture_output=True, text=True, check=True
    ).stdout.splitlines()


@pytest.mark.slow
def test_a_class_of_a_notebook_is_known_by_its_compiled_code():
    cell = CELL.format(gain=1.0, order="(1, 2)")
    code, of_another_gain, of_another_order, again = session_codes(
        cell, CELL.format(gain=0.5, order="(1, 2)"), CELL.format(gain=1.0, order="(2, 1)"), cell
    )
    assert code.startswith("{'__main__:Thing': 'compiled sha256 ")
    assert [again] == session_codes(cell, seed="7") == [code]
    assert of_another_gain != code
    assert of_another_order != code


def test_a_class_of_a_script_is_known_by_its_compiled_code_and_the_modules_beside(tmp_path, monkeypatch, capsys):
    (tmp_path / "beside_script.py").write_text("GAIN = 1.0\n")
    text = (
        "import sys, beside_script\nfrom study_file import test_code\nclass Thing:\n    def run(self): return 1.0\n"
        "budget = int(sys.argv[1])\nprint(test_code.used_code(test_code.stated('__main__:Thing'), None))\n"
    )
    monkeypatch.syspath_prepend(tmp_path)

    def code(text, budget):
        (tmp_path / "script.py").write_text(text)
        monkeypatch.setattr(sys, "argv", ["script.py", budget])
        runpy.run_path(str(tmp_path / "script.py"), run_name="__main__")
        return capsys.readouterr().out

    try:
        first = code(text, "10")
        assert "'__main__:Thing': 'compiled sha256 " in first
        assert "'beside_script': 'sha256 " in first
        assert code(f"{text}# another line\n", "20") == first
        assert code(text.replace("return 1.0", "return 2.0"), "10") != first
    finally:
        sys.modules.pop("beside_script", None)
