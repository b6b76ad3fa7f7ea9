"""Simulators and effects that lie beside the study file."""

import pytest
from click.testing import CliRunner
from echo_study import write_study

from calib.cli import main
from calib.errors import CalibError
from calib.store import read
from calib.study_file import load

OWN = "from tiny_simulators import Echo\n\n\nclass Spring(Echo):\n    name = 'spring'\n"


def study_with(folder, module, text=OWN):
    folder.mkdir(exist_ok=True)
    (folder / f"{module}.py").write_text(text)
    return write_study(folder, ("tiny_simulators:Echo", f"{module}:Spring"), ("jobs = 1", "jobs = 2"))


def test_a_simulator_beside_the_study_file_is_found_from_anywhere(tmp_path, monkeypatch):
    """By the child processes, too."""
    path = study_with(tmp_path / "bench", "own_spring")
    monkeypatch.chdir(tmp_path)
    ended = CliRunner().invoke(main, ["run", str(path), "--budget", "10", "--quiet"])
    assert ended.exit_code == 0, ended.output
    header, trials = read(tmp_path / "bench" / "out")
    assert header.definition["model"]["simulator"] == "own_spring:Spring"
    assert [trial.status for trial in trials] == 10 * ["ok"]


def test_where_a_module_was_looked_for_is_said(tmp_path):
    path = write_study(tmp_path, ("tiny_simulators:Echo", "no_such_module:Spring"))
    with pytest.raises(CalibError, match=f"there is no module 'no_such_module' in {tmp_path} or on Python's path"):
        load(path)


def test_a_module_of_the_same_name_from_elsewhere_is_not_taken(tmp_path):
    load(study_with(tmp_path / "one", "spring_of_two_studies"))
    with pytest.raises(CalibError, match="was imported from .*one.* already, not from .*two"):
        load(study_with(tmp_path / "two", "spring_of_two_studies", f"{OWN}    sites = frozenset()\n"))
    assert load(study_with(tmp_path / "three", "spring_of_two_studies")).study.name == "echo"


def test_a_module_of_another_study_is_not_taken(tmp_path):
    load(study_with(tmp_path / "one", "spring_of_one_study"))
    (tmp_path / "two").mkdir()
    path = write_study(tmp_path / "two", ("tiny_simulators:Echo", "spring_of_one_study:Spring"))
    with pytest.raises(CalibError, match="is that of another study, in .*one; copy it to .*two"):
        load(path)


def test_a_module_that_fails_says_why(tmp_path):
    with pytest.raises(CalibError, match="'broken_spring:Spring' does not load: NameError.*stiffness"):
        load(study_with(tmp_path, "broken_spring", "stiffness\n"))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("def Spring(mark=LEFT):\n    open(mark, 'w')\n", "is a function, and is not called"),
        ("class Spring:\n    def __init__(self):\n        open(LEFT, 'w')\n", "lacks run, the method run"),
        ("Spring = 3\n", "is an instance of int, and is not called"),
    ],
)
def test_what_is_no_class_of_a_simulator_is_not_called(tmp_path, text, says):
    module, left = f"caller_{len(text)}", tmp_path / "left_behind"
    with pytest.raises(CalibError, match=says):
        load(study_with(tmp_path, module, f"LEFT = {str(left)!r}\n{text}"))
    assert not left.exists()


def test_the_number_of_child_processes_is_bounded(tmp_path):
    path = study_with(tmp_path, "bounded_spring")
    with pytest.raises(CalibError, match="jobs: 5000 child processes exceed the bound of 512"):
        load(path, jobs=5000)
    path.write_text(path.read_text().replace("jobs = 2", "jobs = 5000"))
    with pytest.raises(CalibError, match="study.jobs.*less than or equal to 512, got 5000"):
        load(path)
