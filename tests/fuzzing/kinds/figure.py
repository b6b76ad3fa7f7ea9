"""Figures and the exports of other tools, with the description of what they show."""

import io
import json
import random
import tarfile
from functools import cache
from pathlib import Path

import numpy as np
from fuzzing.mutations import damaged, text_damaged, tree_damaged
from PIL import Image, ImageDraw

from calib.digitise import digitise
from calib.digitise.importers import read
from calib.digitise.reading import is_picture

LOOP = [[round(float(np.cos(a)), 6), round(float(-np.sin(a)), 6)] for a in np.linspace(0.0, 5.9, 16)]  # mm, m/s
ENGAUGE = (
    '<?xml version="1.0"?><!DOCTYPE engauge><Document VersionNumber="10.0" AxesPointsRequired="0"><CoordSystem>'
    '<Coords TypeString="Cartesian" ScaleXThetaString="Linear" ScaleYRadiusString="Linear" UnitsXString="Number"/>'
    '<Curve CurveName="Axes"><CurvePoints>'
    + "".join(
        f'<Point IsXOnly="False"><PositionScreen X="{a}" Y="{b}"/><PositionGraph X="{c}" Y="{d}"/></Point>'
        for a, b, c, d in ((0, 0, -1, -1), (100, 0, 1, -1), (0, 100, -1, 1))
    )
    + '</CurvePoints></Curve><CurvesGraphs><Curve CurveName="a"><CurvePoints>'
    + "".join(f'<Point><PositionScreen X="{50 + 50 * q:.4f}" Y="{50 + 50 * v:.4f}"/></Point>' for q, v in LOOP)
    + "</CurvePoints></Curve></CurvesGraphs></CoordSystem></Document>"
).encode()
CORNERS = [{"px": px, "py": py, "dx": dx, "dy": dy} for px, py, dx, dy in ((0, 0, "-1", "-1"), (9, 0, "1", "-1"),
           (0, 0, "-1", "-1"), (0, 9, "-1", "1"))]  # fmt: skip
PROJECT = {
    "version": [4, 2],
    "axesColl": [{"name": "XY", "type": "XYAxes", "isLogX": False, "isLogY": False, "calibrationPoints": CORNERS}],
    "datasetColl": [
        {
            "name": "a",
            "axesName": "XY",
            "data": [{"x": 4.5 + 4.5 * q, "y": 4.5 + 4.5 * v, "value": [q, v]} for q, v in LOOP],
        }
    ],
}
SPEC = """\
source = "s"
[excitation]
place = "base"
quantity = "base motion"
frequency = "159.155 Hz"
amplitude = "1 mm"
[[curve]]
body = "b"
kind = "phase curve"
units = ["mm", "m/s"]
"""
CORNER_POINTS = ", ".join(
    f"{{ pixel = [{x}, {y}], x = {(x - 100) / 60:.6f}, y = {(100 - y) / 60:.6f} }}"
    for x, y in ((20, 180), (180, 180), (20, 20))
)
PICTURED = SPEC.replace('units = ["mm", "m/s"]\n', 'panel = "a"\ncolour = "#ff0000"\n').replace(
    "[[curve]]",
    '[[panel]]\nname = "a"\nx = { unit = "mm", low = -1.3, high = 1.3 }\ny = { unit = "m/s", low = -1.3, high = 1.3 }\n'
    f"points = [{CORNER_POINTS}]\n[[curve]]",
)
PICTURES = (".png", ".jpg", ".tif")
TABLE = "q,v\n" + "".join(f"{q},{v}\n" for q, v in LOOP)


def archived(project: bytes) -> bytes:
    """A project of WebPlotDigitizer as its archive."""
    raw = io.BytesIO()
    with tarfile.open(fileobj=raw, mode="w") as tar:
        for name, content in (("p/info.json", b'{"json": "wpd.json"}'), ("p/wpd.json", project)):
            info = tarfile.TarInfo(name)
            info.size = len(content)
            tar.addfile(info, io.BytesIO(content))
    return raw.getvalue()


def _picture(form: str) -> bytes:
    picture = Image.new("RGB", (200, 200), "white")
    ImageDraw.Draw(picture).ellipse((40, 40, 160, 160), outline="red", width=2)
    ImageDraw.Draw(picture).rectangle((20, 20, 180, 180), outline="black")
    stored = io.BytesIO()
    picture.save(stored, format=form)
    return stored.getvalue()


@cache
def files() -> dict[str, bytes]:
    """Content of a figure of each kind by its suffix."""
    project = json.dumps(PROJECT).encode()
    table = "".join(f"# {line}\n" for line in SPEC.splitlines()) + TABLE
    return {
        ".json": project,
        ".tar": archived(project),
        ".dig": ENGAUGE,
        ".csv": table.encode(),
        ".txt": "".join(f"{q} {v}\n" for q, v in LOOP).encode(),
        ".png": _picture("PNG"),
        ".jpg": _picture("JPEG"),
        ".tif": _picture("TIFF"),
    }


class _Figures:
    name = "figure"

    def samples(self) -> list[str]:
        return [
            *files(),
            *(suffix for suffix in files() if suffix not in PICTURES),
            *(suffix for suffix in files() if suffix not in PICTURES),
        ]

    def make(self, sample: str, rng: random.Random | None, folder: Path) -> list[str]:
        content, done = files()[sample], ["bytes"]
        spec = PICTURED if sample in PICTURES else SPEC
        if rng is not None:
            if sample in (".json", ".tar") and rng.random() < 0.6:
                tree, what = tree_damaged(json.loads(json.dumps(PROJECT)), rng, deep=False)
                project = json.dumps(tree).encode()
                content, done = project if sample == ".json" else archived(project), [what]
            elif rng.random() < 0.2:
                spec, done = text_damaged(spec.encode(), rng).decode("utf-8", "replace"), ["description"]
            else:
                content = (text_damaged if sample in (".json", ".dig", ".csv", ".txt") else damaged)(content, rng)
        (folder / f"figure{sample}").write_bytes(content)
        (folder / "figure.toml").write_bytes(spec.encode("utf-8", "surrogatepass"))
        return done

    def read(self, folder: Path) -> None:
        path = next(path for path in sorted(folder.iterdir()) if path.suffix != ".toml")
        spec = None if path.suffix == ".csv" else folder / "figure.toml"
        if not is_picture(path):
            read(path)
        digitise(path, spec)

    def readable(self, folder: Path) -> frozenset[str]:
        return frozenset()


FIGURE = _Figures()
