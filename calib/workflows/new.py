"""Small working skeletons to begin from: a simulator, an effect, a study."""

import importlib.util
import keyword
import os
import re
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from calib.errors import CalibError
from calib.execution.files import whole
from calib.execution.pools.local import MAX_JOBS

KINDS = ("simulator", "effect", "study")
STIFFNESS, DAMPING, MASS, DRIVE_FREQUENCY = 4000.0, 5.0, 1.0, 9.0  # N/m, N s/m, kg, Hz: of the record that is made up
NOISE_STD = 2e-6  # m, and over the angular frequency m/s: of its noise
RECORD_CYCLES, SAMPLES_PER_CYCLE = 6, 100  # of that record; samples a cycle


def new(kind: str, name: str, folder: str | Path = ".", program: bool = False) -> list[Path]:
    """Write a skeleton into a folder; return the files.

    Parameters
    ----------
    kind : "simulator" and "effect": a module of that name and a test beside it; "study": a folder of that name with a
        study file and a record that is made up
    name : lower case letters, digits and underscores
    program : whether the simulator of the study is an external program, of which a stand-in is written with its deck

    Raises
    ------
    CalibError : no such kind, a program of another kind than a study, a name that no module can have, or a file of that
        name that is there already
    """
    if kind not in KINDS:
        raise CalibError(f"there is a skeleton of a {', '.join(KINDS)}, got {kind!r}")
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        raise CalibError(f"expected a name of lower case letters, digits and underscores, got {name!r}")
    if keyword.iskeyword(name) or name in sys.stdlib_module_names:
        raise CalibError(f"{name!r} is a word or a module of Python; choose another name")
    if program and kind != "study":
        raise CalibError(f"a {kind} is written in Python; an external program belongs to a study")
    title = name.replace("_", " ").capitalize()
    words = {
        "name": name,
        "title": title,
        "thing": thing_of(kind, name),
        "jobs": str(min(os.cpu_count() or 1, MAX_JOBS)),
    }
    files = _study(Path(folder) / name, words, program) if kind == "study" else _module(kind, Path(folder), words)
    for path in files:
        if path.exists():
            raise CalibError(f"{path} is there already; choose another name, or move it away")
    if kind != "study" and importlib.util.find_spec(name) is not None:
        raise CalibError(f"Python has a module {name!r} already, which this one would hide; choose another name")
    for path, text in files.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole(path) as temporary:
            temporary.write_text(text, encoding="utf-8")
    return list(files)


def thing_of(kind: str, name: str) -> str:
    """Name of what a module of that name holds: the class of a simulator, the constant of an effect."""
    return "EFFECT" if kind == "effect" else "".join(part.capitalize() for part in name.split("_"))


def _module(kind: str, folder: Path, words: dict[str, str]) -> dict[Path, str]:
    name = words["name"]
    return {
        folder / f"{name}.py": skeleton(f"{kind}.py.j2", words),
        folder / f"test_{name}.py": skeleton(f"test_{kind}.py.j2", words),
    }


def _study(folder: Path, words: dict[str, str], program: bool) -> dict[Path, str]:
    names = ["study.toml", *(["deck.in.j2", "solver.py"] if program else [])]
    texts = {folder / name: skeleton(f"{name}.j2", {**words, "program": program}) for name in names}
    return {**texts, folder / f"{words['name']}.csv": _made_up()}


def skeleton(template: str, words: Mapping[str, object]) -> str:
    """Text of a file by its template and the words in it."""
    loader = PackageLoader("calib.workflows", "skeletons")
    known = Environment(
        loader=loader, undefined=StrictUndefined, keep_trailing_newline=True, autoescape=False, trim_blocks=True
    )
    return known.get_template(template).render(words)


def _made_up() -> str:
    """Table of a record that is made up: a mass on a spring and a damper under a force, and noise."""
    omega, rng = 2.0 * np.pi * DRIVE_FREQUENCY, np.random.default_rng(1)
    time = np.arange(RECORD_CYCLES * SAMPLES_PER_CYCLE) / (SAMPLES_PER_CYCLE * DRIVE_FREQUENCY)
    x = np.exp(1j * omega * time) / (STIFFNESS - MASS * omega**2 + 1j * omega * DAMPING)
    rows = np.column_stack([x.real, (1j * omega * x).real]) + NOISE_STD * np.array([1.0, omega]) * rng.standard_normal(
        (time.size, 2)
    )
    lines = [f"{t:.6f},{1e3 * a:.6f},{1e3 * b:.4f}" for t, (a, b) in zip(time, rows, strict=True)]
    return "\n".join(["time_s,x_mm,v_mm_s", *lines]) + "\n"
