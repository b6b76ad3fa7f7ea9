"""Programs that are known behind launchers and scripts."""

import os
import re

import pytest
from shell_program import DRIVE, READ, REQUEST, WRITE, command, ran, script

from calib.errors import CodeChanged
from calib.modelling.model import Model
from calib.simulators.command import Command


@pytest.fixture
def solver(tmp_path, monkeypatch):
    """A program on PATH, with its path."""
    (tmp_path / "bin").mkdir()
    script(tmp_path / "bin", WRITE, name="lab_solver")
    monkeypatch.setenv("PATH", f"{tmp_path}/bin:{os.environ['PATH']}")
    return tmp_path / "bin" / "lab_solver"


@pytest.mark.parametrize(
    ("line", "known"),
    [
        ("nice -n 5 lab_solver deck", {"nice", "lab_solver"}),
        ("env THREADS=2 nice {solver} deck", {"env", "nice", "lab_solver"}),
        ("./wrap.sh {solver}", {"wrap.sh", "lab_solver"}),
        ("python3 {folder}/solve.py deck", {"python3", "solve.py"}),
        ("./wrap.sh lab_solver /dev/null {folder}/data.bin", {"wrap.sh"}),
        ("nice ./given.sh", {"nice"}),
        ("./wrap.sh own_solver data.bin", {"wrap.sh", "own_solver"}),
        ("nice lab_solver {{{{ env }}}} {{{{ env | unit('mm') }}}}", {"nice", "lab_solver"}),
    ],
)
def test_programs_that_a_command_line_names_as_arguments_belong_to_the_identity(tmp_path, solver, line, known):
    for name in ("solve.py", "data.bin"):
        (tmp_path / name).write_text("")
    script(tmp_path, "exec true", name="wrap.sh")
    script(tmp_path, "exec true", name="given.sh")
    script(tmp_path, "exec true", name="own_solver")
    stated = line.format(solver=solver, folder=tmp_path)
    parameters = {"env": "1 mm"} if "{{" in stated else {}
    code = command(tmp_path, run=[stated], template=["given.sh"], parameters=parameters).code
    assert {name.removeprefix("program ") for name in code if name.startswith("program ")} == known


def test_a_program_behind_a_launcher_that_is_replaced_ends_the_run(tmp_path, solver):
    simulator = command(tmp_path, run=["nice lab_solver"])
    ran(simulator)
    script(solver.parent, WRITE.replace("sin(i)", "7"), name="lab_solver")
    with pytest.raises(CodeChanged, match="program lab_solver"):
        ran(simulator)


@pytest.mark.parametrize(
    ("line", "remark"),
    [
        ("./wrap.sh deck", "wrap.sh is a script: programs that it calls are no part of the identity .* `version`"),
        ("sh -c 'cp $HOME/x y'", "sh runs a program that no word of .* names; state the command line of `version`"),
        ("nice env true", ""),
        ("./wrap.sh own_solver", ""),
        ("python3 given.py", ""),
    ],
)
def test_a_program_that_cannot_be_known_is_a_remark_and_a_version_answers_it(tmp_path, line, remark):
    script(tmp_path, "exec true", name="wrap.sh")
    script(tmp_path, "exec true", name="own_solver")
    (tmp_path / "given.py").write_text("")
    options = {"run": [line], "read": READ, "template": ["given.py"]}
    simulator = Command(**options).placed(tmp_path, tmp_path / "out", None)
    assert len(simulator.remarks) == bool(remark)
    assert all(re.search(remark, text) for text in simulator.remarks)
    stated = Command(**options, version="echo 2.20").placed(tmp_path, tmp_path / "out", None)
    assert stated.remarks == ()


def test_a_dry_run_tells_the_remarks(tmp_path):
    dry = Model(command(tmp_path, WRITE)).dry_run({}, DRIVE, REQUEST)
    assert [text for name, text in dry.facts if name == "remark"] == list(command(tmp_path, WRITE).remarks)
