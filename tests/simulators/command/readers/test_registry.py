"""Readers by name; a function of one's own; options and results are checked."""

import inspect
import sys

import numpy as np
import pytest

from calib import plugins
from calib.errors import CalibError
from calib.simulators.command.readers import check_options, reader

OWN = """
import numpy as np
from calib.simulators.command.readers import Columns

def pair(path, *, factor=1.0):
    time, tip = np.loadtxt(path, unpack=True)
    return time, {"tip": factor * tip}

def columns(path):
    return Columns([0.0], {"tip": [1.0]})

def ragged(path):
    return [0.0, 1.0], {"tip": [1.0]}

def nothing(path):
    return None

number = 3.0
"""


@pytest.fixture
def own(tmp_path, monkeypatch):
    monkeypatch.setattr("sys.path", list(sys.path))
    (tmp_path / "own_readers.py").write_text(OWN)
    (tmp_path / "out.txt").write_text("0 1\n1 2\n")
    yield tmp_path
    sys.modules.pop("own_readers", None)
    plugins._FOLDERS.discard(tmp_path.resolve())


def test_a_function_of_ones_own_returns_columns_or_a_pair(own):
    pair = reader("own_readers:pair", own)(own / "out.txt", factor=2.0)
    np.testing.assert_array_equal(pair.time, [0.0, 1.0])
    np.testing.assert_array_equal(pair.values["tip"], [2.0, 4.0])
    assert reader("own_readers:columns", own)(own / "out.txt").values["tip"] == [1.0]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("own_readers:ragged", "out.txt: reader 'own_readers:ragged': column 'tip': expected 2 samples"),
        ("own_readers:nothing", "expected Columns, or time and {name: array}, got NoneType"),
        ("own_readers:number", "an object of type float; name a function"),
        ("own_readers:absent", "does not load"),
        ("delimitted", "unknown reader 'delimitted' \\(did you mean 'delimited'\\?\\)"),
    ],
)
def test_what_is_no_reader_is_refused(own, name, message):
    with pytest.raises(CalibError, match=message):
        reader(name, own)(own / "out.txt")


def test_a_function_of_ones_own_that_fails_on_a_file_names_it(own):
    (own / "out.txt").write_text("0 1\nERROR\n")
    with pytest.raises(CalibError, match="out.txt: the reader 'own_readers:pair' failed: ValueError"):
        reader("own_readers:pair", own)(own / "out.txt")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"skp": 1}, "unknown option 'skp' of the reader 'delimited' \\(did you mean 'skip'\\?\\)"),
        ({"skip": "1"}, "option 'skip' of the reader 'delimited': input should be a valid integer; got '1'"),
        ({"skip": -1}, "greater than or equal to 0"),
        ({"time": 0}, "option 'time'"),
        ({"columns": "x"}, "option 'columns'"),
        ({"separator": '"'}, "option 'separator'"),
        ({"step": float("nan")}, "option 'step'"),
    ],
)
def test_options_are_checked_before_there_is_a_file(options, message):
    with pytest.raises(CalibError, match=message):
        check_options("delimited", options)


def test_options_of_a_function_of_ones_own_are_checked_by_name(own):
    check_options("own_readers:pair", {"factor": 2.0}, own)
    with pytest.raises(CalibError, match="unknown option 'factr'.*did you mean 'factor'"):
        check_options("own_readers:pair", {"factr": 2.0}, own)


def test_a_file_that_is_not_there_and_a_folder_are_refused(tmp_path):
    for path, kind in ((tmp_path / "absent.csv", "no such file"), (tmp_path, "a folder or a device")):
        with pytest.raises(CalibError, match=f"{path}: expected an output file to read, got {kind}"):
            reader("delimited")(path)


@pytest.mark.parametrize("name", plugins.names("calib.readers"))
def test_every_option_of_a_reader_is_documented(name):
    function = plugins.load("calib.readers", name)
    path, *options = inspect.signature(function).parameters.values()
    assert path.kind is path.POSITIONAL_ONLY
    undocumented = [one.name for one in options if f"\n    {one.name} : " not in function.__doc__]
    assert (undocumented, {one.kind for one in options}) == ([], {inspect.Parameter.KEYWORD_ONLY})
