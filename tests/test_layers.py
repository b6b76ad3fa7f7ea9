"""Imports run down the storeys of the house."""

import ast
import subprocess
import sys
from pathlib import Path

import calib

ROOT = Path(calib.__file__).parent
STOREYS = [
    row.split()
    for row in (
        "errors units plugins execution records modelling emulation",
        "simulators effects features optimisers",
        "objective store dynamics",
        "study sweep confidence diagnosis",
        "study_file digitise report workflows cli __main__ testing",
    )
]
FAMILIES = set(STOREYS[1])
ORDER = [room for storey in STOREYS for room in storey]


def room(path: Path) -> str:
    return path.relative_to(ROOT).with_suffix("").parts[0]


def imported_rooms(path: Path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names = [f"{node.module}.{a.name}" for a in node.names] if node.module == "calib" else [node.module]
        else:
            continue
        for name in names:
            parts = name.split(".")
            if parts[0] == "calib":
                yield parts[1] if len(parts) > 1 else "calib"


def sources():
    return [path for path in ROOT.rglob("*.py") if path != ROOT / "__init__.py"]


def test_every_room_stands_in_the_plan():
    assert {room(path) for path in sources()} <= set(ORDER)


def test_imports_run_down_the_storeys():
    upstairs = [
        f"{path.relative_to(ROOT)} imports {name}"
        for path in sources()
        for name in imported_rooms(path)
        if name != room(path) and (name == "calib" or ORDER.index(name) > ORDER.index(room(path)))
    ]
    assert not upstairs, upstairs


def test_families_are_strangers():
    friends = [
        f"{path.relative_to(ROOT)} imports {name}"
        for path in sources()
        if room(path) in FAMILIES
        for name in imported_rooms(path)
        if name in FAMILIES and name != room(path)
    ]
    assert not friends, friends


def test_only_the_study_file_knows_a_family_by_name():
    knowing = [
        f"{path.relative_to(ROOT)} imports {name}"
        for path in sources()
        if room(path) not in FAMILIES
        for name in imported_rooms(path)
        if name in FAMILIES
    ]
    assert not knowing, knowing


def test_optimisers_import_nothing_of_calib_but_how_a_function_waits_and_emulators():
    borrowed = [
        f"{path.name} imports {name}"
        for path in (ROOT / "optimisers").rglob("*.py")
        for name in imported_rooms(path)
        if name not in ("optimisers", "execution", "emulation")
    ]
    assert not borrowed, borrowed


def test_a_start_imports_nothing_that_it_may_never_need():
    """Each of these takes every process a tenth to half a second; scipy imports its parts when they are asked for."""
    late = ("matplotlib", "pint", "scipy.ndimage", "scipy.signal", "scipy.stats")
    code = (
        "import sys, calib.workflows.calibrate, calib.workflows.diagnose, calib.workflows.evaluations\n"
        f"print([name for name in {late} if name in sys.modules])"
    )
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert answer.stdout == "[]\n", answer.stdout
