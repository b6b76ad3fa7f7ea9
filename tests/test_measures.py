"""What an outsider measures on the package holds (`python tests/measures.py` prints it)."""

from collections import Counter
from statistics import median

import measures

MAX_FILE_LINES, MAX_FUNCTION_LINES, MAX_MEDIAN_LINES, MAX_ENTRIES = 450, 60, 110, 27


def test_files_hold_one_idea():
    lengths = measures.lines_by_file()
    assert len(lengths) > 100
    assert median(lengths.values()) <= MAX_MEDIAN_LINES
    assert {path: lines for path, lines in lengths.items() if lines > MAX_FILE_LINES} == {}


def test_functions_fit_a_screen_unless_they_are_compiled():
    every = list(measures.functions())
    assert len(every) > 1000
    assert {
        f"{path}:{f.name}": measures.length(f) for path, f in every if measures.length(f) > MAX_FUNCTION_LINES
    } == {}


def test_public_functions_are_fully_annotated():
    assert [
        f"{path}:{f.name}" for path, f in measures.functions() if measures.public(f) and measures.unannotated(f)
    ] == []


def test_numeric_constants_state_their_quantity():
    constants = measures.constants()
    assert len(constants) > 500
    assert [f"{c.path}:{c.name}" for c in constants if not c.comment] == []


def test_a_constant_has_its_name_alone():
    times = Counter(c.name for c in measures.constants())
    assert {name for name, number in times.items() if number > 1} <= {"DONE", "DIVERGED"}  # codes of three kernels


def test_no_class_has_the_name_of_another():
    assert [name for name, times in measures.class_names().items() if times > 1] == []


def test_the_root_of_the_package_holds_rooms():
    entries = measures.entries_at_the_root()
    assert len(entries) <= MAX_ENTRIES
    assert [name for name in entries if name.endswith(".py")] == [
        "__init__.py", "__main__.py", "errors.py", "plugins.py", "units.py",
    ]  # fmt: skip
