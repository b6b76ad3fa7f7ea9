"""Files that decide records are those that they were."""

import os

import pytest
from shell_program import WRITE, command, ran, script

from calib.errors import CodeChanged

OTHER = "printf 'time,u\\n0,1\\n1,1\\n' > out.csv"  # what another program writes


def replaced(path, text):
    """Replace a file by another one, as `mv` does."""
    new = path.with_name("new")
    new.write_text(text)
    new.chmod(path.stat().st_mode)
    new.replace(path)


def test_a_program_that_is_replaced_during_a_run_gives_no_record_and_none_in_the_cache(tmp_path):
    replacing = f"sed 's/sin(i)/7/' {tmp_path}/solve.sh > {tmp_path}/new; chmod +x {tmp_path}/new"
    simulator = command(tmp_path, WRITE, replacing, f"mv {tmp_path}/new {tmp_path}/solve.sh")
    with pytest.raises(CodeChanged, match=r"program solve.sh: .*solve.sh has changed since the study was read .*start"):
        ran(simulator)
    assert not (tmp_path / "out" / "cache").exists()
    assert not list((tmp_path / "out" / "runs").glob("*/*"))


def test_no_cache_answers_for_a_program_that_was_replaced(tmp_path):
    simulator = command(tmp_path, WRITE)
    ran(simulator)
    replaced(tmp_path / "solve.sh", f"#!/bin/sh\n{OTHER}\n")
    with pytest.raises(CodeChanged, match="sha256 .* then, sha256 .* now"):
        ran(simulator)
    (tmp_path / "solve.sh").unlink()
    with pytest.raises(CodeChanged, match="is there no longer"):
        ran(simulator)


def test_a_file_that_was_only_touched_or_written_anew_is_the_same(tmp_path):
    (tmp_path / "mesh.inc").write_text("one")
    simulator = command(tmp_path, WRITE, template=["mesh.inc"], cache=False)
    ran(simulator)
    os.utime(tmp_path / "mesh.inc", (1, 1))
    replaced(tmp_path / "solve.sh", (tmp_path / "solve.sh").read_text())
    assert ran(simulator).attrs["status"] == "ok"
    replaced(tmp_path / "mesh.inc", "two")
    with pytest.raises(CodeChanged, match="file mesh.inc: .*has changed"):
        ran(simulator)


def test_a_program_that_is_first_on_path_during_a_run_is_another_one(tmp_path, monkeypatch):
    for folder in ("early", "late"):
        (tmp_path / folder).mkdir()
    script(tmp_path / "late", WRITE, name="lab_solver")
    monkeypatch.setenv("PATH", f"{tmp_path}/early:{tmp_path}/late:{os.environ['PATH']}")
    simulator = command(tmp_path, run=["lab_solver"])
    ran(simulator)
    script(tmp_path / "early", OTHER, name="lab_solver")
    with pytest.raises(CodeChanged, match="program lab_solver: .*early/lab_solver has changed"):
        ran(simulator)


def test_a_program_with_a_version_is_asked_again_where_its_file_has_changed(tmp_path):
    (tmp_path / "number").write_text("2.20")
    version = script(tmp_path, "cat ${0%/*}/number; echo x >> ${0%/*}/asked", name="version.sh")
    simulator = command(tmp_path, WRITE, version=version, cache=False)
    ran(simulator)
    assert (tmp_path / "asked").read_text().count("x") == 1
    replaced(tmp_path / "solve.sh", (tmp_path / "solve.sh").read_text() + "# compiled anew\n")
    assert ran(simulator).attrs["status"] == "ok"
    assert (tmp_path / "asked").read_text().count("x") == 2
    (tmp_path / "number").write_text("2.21")
    replaced(tmp_path / "solve.sh", (tmp_path / "solve.sh").read_text() + "# and once more\n")
    with pytest.raises(CodeChanged, match=r"2\.20 then, 2\.21 now"):
        ran(simulator)


READER = """import numpy as np

def numbers(path):
    table = np.genfromtxt(path, delimiter=",", skip_header=1)
    return table[:, 0], {"u": table[:, 1]}
"""


def test_the_module_of_a_reader_that_changes_ends_the_run(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "known_reader.py").write_text(READER)
    read = {"reader": "known_reader:numbers", "file": "out.csv", "bodies": {"tip": "u"}}
    simulator = command(tmp_path, WRITE, read=read)
    ran(simulator)
    (tmp_path / "known_reader.py").write_text(READER.replace("table[:, 1]}", "2 * table[:, 1]}"))
    with pytest.raises(CodeChanged, match=r"known_reader: .*known_reader.py has changed"):
        ran(simulator)
