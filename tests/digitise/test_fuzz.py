"""Importers fed with damaged and hostile files raise nothing but the project's own error, and touch nothing else.

Minutes of it, with new examples every time: `benchmarks/fuzz.py`, kind `figure`.
"""

import io
import json
import random
import sys

import numpy as np
import pytest
from fuzzing.kinds.figure import archived
from fuzzing.mutations import damaged
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from PIL import Image

from calib.digitise.digitise import digitise
from calib.digitise.image import read_picture
from calib.digitise.importers import SUFFIXES, read
from calib.errors import CalibError

QUICK = settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck), database=None)

DOCUMENT = (
    '<?xml version="1.0"?><!DOCTYPE engauge><Document VersionNumber="10.0" AxesPointsRequired="0"><CoordSystem>'
    '<Coords TypeString="Cartesian" ScaleXThetaString="Linear" ScaleYRadiusString="Log" UnitsXString="Number"/>'
    '<Curve CurveName="Axes"><CurvePoints>'
    + "".join(
        f'<Point IsXOnly="False"><PositionScreen X="{a}" Y="{b}"/><PositionGraph X="{c}" Y="{d}"/></Point>'
        for a, b, c, d in ((0, 0, 0, 1), (10, 0, 1, 1), (0, 10, 0, 10))
    )
    + '</CurvePoints></Curve><CurvesGraphs><Curve CurveName="a"><CurvePoints>'
    + "".join(f'<Point><PositionScreen X="{k}" Y="{k * k}"/></Point>' for k in range(5))
    + "</CurvePoints></Curve></CurvesGraphs></CoordSystem></Document>"
).encode()
CORNERS = [{"px": 0, "py": 0, "dx": "0", "dy": "0"}, {"px": 9, "py": 0, "dx": "1", "dy": "0"},
           {"px": 0, "py": 0, "dx": "0", "dy": "1"}, {"px": 0, "py": 9, "dx": "1", "dy": "2"}]  # fmt: skip
PROJECT = {
    "version": [4, 2],
    "axesColl": [{"name": "XY", "type": "XYAxes", "isLogX": False, "isLogY": True, "calibrationPoints": CORNERS}],
    "datasetColl": [{"name": "a", "axesName": "XY", "data": [{"x": k, "y": k, "value": [k, k + 1]} for k in range(4)]}],
}
TABLE = b'# source = "s"\n# [[curve]]\n# body = "b"\n# kind = "phase curve"\n# units = ["mm", "m/s"]\nq,v\n' + b"".join(
    f"{np.cos(a):.6f},{-np.sin(a):.6f}\n".encode() for a in np.linspace(0.0, 6.2, 40)
)


def seeds():
    project = json.dumps(PROJECT).encode()
    return {".json": project, ".tar": archived(project), ".dig": DOCUMENT, ".csv": TABLE, ".txt": b"1 2\n3 4\n5 6\n"}


SEEDS = seeds()


def mistake(reader, path):
    """Message of the project's own error, None where there is none; every other error is let through."""
    try:
        reader(path)
    except CalibError as error:
        return str(error)
    return None


def tried(folder, suffix, raw):
    """Read bytes as a file of that kind: what comes is a result or the project's own error, with the file's name."""
    path = folder / f"fuzzed{suffix}"
    path.write_bytes(raw)
    before = sorted(folder.iterdir())
    for reader in (read, digitise):
        said = mistake(reader, path)
        assert said is None or str(path) in said
    assert sorted(folder.iterdir()) == before


@pytest.mark.parametrize("suffix", SEEDS)
@QUICK
@given(seed=st.integers(0, 2**32))
def test_a_damaged_file_raises_nothing_else(tmp_path_factory, suffix, seed):
    tried(tmp_path_factory.getbasetemp(), suffix, damaged(SEEDS[suffix], random.Random(seed)))


@QUICK
@given(raw=st.binary(max_size=300), suffix=st.sampled_from(SUFFIXES))
def test_any_bytes_raise_nothing_else(tmp_path_factory, raw, suffix):
    tried(tmp_path_factory.getbasetemp(), suffix, raw)


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=6,
)

DATUM = [8, 0, 2, 0, 1]  # of `PROJECT`: row of the first point on the axis that is logarithmic


def replaced(value, path, new):
    if not path:
        return new
    head, *rest = path
    if isinstance(value, dict) and value:
        key = list(value)[head % len(value)]
        return {**value, key: replaced(value[key], rest, new)}
    if isinstance(value, list) and value:
        at = head % len(value)
        return [*value[:at], replaced(value[at], rest, new), *value[at + 1 :]]
    return new


@QUICK
@given(path=st.lists(st.integers(0, 9), min_size=1, max_size=6), new=VALUES)
@example(path=DATUM, new=9216)  # 10^9216 pixels from the others on a logarithmic axis
@example(path=DATUM, new=9206)  # just a number, but not what a pixel beside it is
@example(path=DATUM, new=4642)  # nor the square of that
def test_a_project_with_anything_in_any_place_raises_nothing_else(tmp_path_factory, path, new):
    raw = json.dumps(replaced(PROJECT, path, new)).encode("utf-8", "surrogatepass")
    tried(tmp_path_factory.getbasetemp(), ".json", raw)
    tried(tmp_path_factory.getbasetemp(), ".tar", archived(raw))


@QUICK
@given(seed=st.integers(0, 2**32), form=st.sampled_from(["PNG", "JPEG", "TIFF", "BMP"]))
def test_a_damaged_picture_raises_nothing_else(tmp_path_factory, seed, form):
    stored = io.BytesIO()
    Image.fromarray(np.full((20, 20, 3), 200, dtype=np.uint8)).save(stored, format=form)
    path = tmp_path_factory.getbasetemp() / f"fuzzed.{form.lower()}"
    path.write_bytes(damaged(stored.getvalue(), random.Random(seed)))
    said = mistake(read_picture, path)
    assert said is None or str(path) in said


@pytest.mark.parametrize(
    ("side", "size"), [(4500, "4500 x 4500 pixels"), (10000, "10000 x 10000"), (14000, "more than")]
)
def test_a_picture_of_too_many_pixels_is_not_decoded(tmp_path, monkeypatch, side, size):
    """Above 89 million pixels, Pillow warns of a decompression bomb, above 178 million it refuses to open the file."""
    path = tmp_path / "blank.png"
    Image.new("1", (side, side), 1).save(path)
    monkeypatch.setattr("PIL.ImageFile.ImageFile.load", lambda picture: pytest.fail("decoded"))
    said = mistake(read_picture, path)
    assert f"a picture of {size}" in said
    assert "exceeds the bound of 20 million pixels; cut out the figure, or scan it at fewer dots per inch" in said


OPENED = []
sys.addaudithook(lambda event, arguments: OPENED.append(str(arguments[0])) if event == "open" else None)


@pytest.mark.parametrize("suffix", SEEDS)
def test_no_other_file_is_opened(tmp_path, suffix):
    path = tmp_path / f"file{suffix}"
    path.write_bytes(SEEDS[suffix])
    read(path)  # what Python imports on the way is opened the first time
    OPENED.clear()
    read(path)
    assert set(OPENED) == {str(path)}
