"""Documents of Engauge Digitizer (.dig, versions 6 and newer)."""

from collections.abc import Sequence
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError

import numpy as np
from defusedxml import ElementTree
from defusedxml.common import DefusedXmlException

from calib.digitise.axes import AxisCalibration, calibrated, two_points
from calib.digitise.curve import Curve
from calib.digitise.importers.content import content
from calib.digitise.importers.imported import CLICK_SIGMA, Imported, clicked
from calib.errors import CalibError

FORM = "Engauge Digitizer document"


def read_dig(path: Path) -> Imported:
    """Read a document.

    Raises
    ------
    CalibError : the old binary format, no XML, entities in it, or no document
    """
    raw = content(path)
    if not raw.lstrip().startswith(b"<"):
        raise CalibError(
            f"{path}: not the XML that Engauge 6 and newer write (versions up to 5 wrote a binary format); "
            "open it in a newer Engauge and save it, or export it as CSV"
        )
    try:
        root = ElementTree.fromstring(raw)
    except DefusedXmlException as error:
        raise CalibError(f"{path}: entities in the XML are not read ({type(error).__name__}); remove them") from error
    except (ParseError, ValueError, LookupError) as error:
        raise CalibError(f"{path}: not readable XML ({error}); save the document again") from error
    if root.tag != "Document":
        raise CalibError(f"{path}: expected an Engauge <Document>, got <{str(root.tag)[:40]}>")
    systems = root.findall("CoordSystem")
    if not systems:
        raise CalibError(f"{path}: the Engauge document has no <CoordSystem>; save it with version 6 or newer")
    curves, refused = [], {}
    for number, system in enumerate(systems, 1):
        prefix = f"{number}: " if len(systems) > 1 else ""
        for element in system.iterfind("CurvesGraphs/Curve"):
            name = prefix + element.get("CurveName", "without a name")
            try:
                curves.append(_curve(name, element, system, root.get("AxesPointsRequired", "0")))
            except CalibError as error:
                refused[name] = str(error)
    return Imported(path, f"{FORM}, version {root.get('VersionNumber', 'unknown')}", curves, refused)


def _curve(name: str, element: Element, system: Element, required: str) -> Curve:
    calibration = _calibration(system, required)
    pixels = np.array([_place(p, "PositionScreen") for p in element.iterfind("CurvePoints/Point")]).reshape(-1, 2)
    if len(pixels) < 2:
        raise CalibError(f"it has {len(pixels)} point(s); expected two at least")
    return clicked(name, calibration(pixels), pixels, calibration)


def _calibration(system: Element, required: str) -> AxisCalibration:
    coords = system.find("Coords")
    if coords is None:
        raise CalibError("the document does not say what its axes are (<Coords> is missing)")
    if coords.get("TypeString") != "Cartesian":
        raise CalibError(f"its axes are {str(coords.get('TypeString'))[:40]!r}; expected Cartesian ones")
    for name, key in (("x", "UnitsXString"), ("y", "UnitsYString")):
        unit = coords.get(key, "Number")
        if unit != "Number":
            raise CalibError(f"{name} is in {unit[:40]!r}; expected numbers: set the units in Engauge")
    logarithmic = coords.get("ScaleXThetaString") == "Log", coords.get("ScaleYRadiusString") == "Log"
    axis = [c for c in system.findall("Curve") if c.get("CurveName") == "Axes"]
    points = axis[0].findall("CurvePoints/Point") if axis else []
    pixels = np.array([_place(p, "PositionScreen") for p in points]).reshape(-1, 2)
    graph = np.array([_place(p, "PositionGraph") for p in points]).reshape(-1, 2)
    if required == "2" and len(points) == 2:
        if any(logarithmic):
            raise CalibError("a map has no logarithmic axes; give three axis points")
        return two_points(pixels, graph)
    x, y = graph[:, 0].tolist(), graph[:, 1].tolist()
    if required == "1":  # four axis points, each of which carries one number
        only = [p.get("IsXOnly") == "True" for p in points]
        x = [value if alone else None for value, alone in zip(x, only, strict=True)]
        y = [None if alone else value for value, alone in zip(y, only, strict=True)]
    return calibrated(pixels, x, y, logarithmic, CLICK_SIGMA)


def _place(point: Element, tag: str) -> Sequence[float]:
    element = point.find(tag)
    attributes = {} if element is None else element.attrib
    try:
        numbers = [float(attributes[key]) for key in ("X", "Y")]
    except (KeyError, ValueError) as error:
        raise CalibError(f"a point has no readable <{tag}>; save the document again") from error
    if not all(abs(number) < 1e300 for number in numbers):
        raise CalibError(f"a point has a <{tag}> without bounds; mend it in Engauge")
    return numbers
