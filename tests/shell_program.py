"""A simulator whose program is a shell script."""

from pathlib import Path

from calib.modelling.model import Model
from calib.modelling.simulator import Request
from calib.records.excitation import Excitation
from calib.simulators.command import Command

DRIVE = Excitation("mass", "force", frequency=20.0, amplitude=30.0)
REQUEST = Request(periods=2, samples=20, settle=1)
READ = {"reader": "delimited", "file": "out.csv", "bodies": {"tip": "u"}}
WRITE = 'awk \'BEGIN { print "time,u"; for (i = 0; i <= 60; i++) print i * 0.0025 "," sin(i) }\' > out.csv\n'


def script(folder: Path, *lines: str, name: str = "solve.sh") -> str:
    """Write a program; return the command line that runs it."""
    (folder / name).write_text("#!/bin/sh\n" + "\n".join(lines) + "\n")
    (folder / name).chmod(0o755)
    return f"./{name}"


def command(folder: Path, *lines: str, **options) -> Command:
    """A simulator whose program is a shell script, with its results in `folder`/out."""
    made = Command(**{"run": [script(folder, *lines)], "read": READ, "keep": "none", **options})
    return made.placed(folder, folder / "out", None)


def ran(simulator, request=REQUEST, excitation=DRIVE):
    return Model(simulator).run({}, excitation, request)


def left(folder: Path) -> list[str]:
    """Folders of runs that were not cleaned."""
    return sorted(
        path.name for path in (folder / "out" / "runs").glob("*") if path.name != "active" or any(path.iterdir())
    )
