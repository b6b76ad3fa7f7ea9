"""Figures and the exports of other tools, with the description of what they show."""

import io
import json
import random
import tarfile
from functools import cache
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from calib.digitise import digitise
from calib.digitise.importers import read
from calib.digitise.reading import is_picture
from fuzzing.mutations import damaged, text_damaged, tree_damaged

ENGAUGE = (
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
SPEC = """\
source = "s"
[excitation]
place = "base"
quantity = "base motion"
frequency = "20 Hz"
amplitude = "1 mm"
[[curve]]
body = "b"
kind = "phase curve"
units = ["mm", "m/s"]
"""
PANEL = """\
source = "s"
[[panel]]
name = "a"
x = [{ pixel = [20, 180], value = -1.0 }, { pixel = [180, 180], value = 1.0 }]
"""
LOOP = "q,v\n" + "".join(f"{np.cos(a):.6f},{-np.sin(a):.6f}\n" for a in np.linspace(0.0, 6.2, 40))


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
    table = "".join(f"# {line}\n" for line in SPEC.splitlines()) + LOOP
    return {
        ".json": project,
        ".tar": archived(project),
        ".dig": ENGAUGE,
        ".csv": table.encode(),
        ".txt": b"1 2\n3 4\n5 6\n",
        ".png": _picture("PNG"),
        ".jpg": _picture("JPEG"),
        ".tif": _picture("TIFF"),
    }


class _Figures:
    name = "figure"

    def samples(self) -> list[str]:
        return list(files())

    def make(self, sample: str, rng: random.Random | None, folder: Path) -> list[str]:
        content, spec, done = files()[sample], SPEC, ["bytes"]
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
