"""The curves of a figure, read off and brought to SI."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from skimage.draw import polygon2mask

from calib.digitise.axes import AxisCalibration, calibrated
from calib.digitise.curve import Curve
from calib.digitise.image import CurveRequest, Trace, read_picture, traced
from calib.digitise.image.picture import SUFFIXES as PICTURES
from calib.digitise.importers import Imported
from calib.digitise.importers import read as read_export
from calib.digitise.order import ordered
from calib.digitise.response_curve import (
    AMPLITUDE_CURVE,
    PHASE_CURVE,
    PrintedSweep,
    amplitude_sigma,
    printed_amplitudes,
    printed_sweep,
)
from calib.digitise.spec import PERIOD_UNIT, CurveTable, FigureToml, PanelTable, PrintedExcitation
from calib.digitise.uncertainty import ASSUMED_SIGMA_SHARE, hats, leaning
from calib.errors import CalibError, nearest
from calib.records.motion_unit import MotionUnit
from calib.study_file.mistakes import Mistakes
from calib.units import to_si

MAX_NUMBER = 1e100  # in SI: the squares of such numbers still are numbers
SI_UNITS = {
    "phase curve": ("m", "m/s"), "displacement over time": ("s", "m"), "velocity over time": ("s", "m/s"),
    AMPLITUDE_CURVE: ("Hz", "m"), PHASE_CURVE: ("Hz", "rad"),
}  # fmt: skip
EXAMPLES = {
    "phase curve": '["mm", "m/s"]', "displacement over time": '["ms", "mm"]', "velocity over time": '["ms", "m/s"]',
    AMPLITUDE_CURVE: '["Hz", "mm"]', PHASE_CURVE: '["Hz", "deg"]',
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Reading:
    """One curve in SI, with the uncertainty of its points.

    Attributes
    ----------
    body, kind : what it shows, one of `SI_UNITS`
    points : (n, 2) along the curve; displacement [m] and velocity [m/s], or time [s] and one of them, or frequency [Hz]
        and amplitude or phase [rad]
    sigma : (n, 2) standard uncertainty of each point, independent from point to point
    modes : (k, n, 2) what independent errors do that reach over many points, one standard deviation large
    axes : how many of the modes, the first ones, are errors of the axes
    notes : for its user
    sweep : over frequency, what it is the response to
    """

    body: str
    kind: str
    points: np.ndarray
    sigma: np.ndarray
    modes: np.ndarray
    axes: int
    notes: tuple[str, ...]
    sweep: PrintedSweep | None = None


@dataclass(frozen=True, eq=False)
class PicturedCurve:
    """A curve on its picture.

    Attributes
    ----------
    body, kind : what it shows
    trace : the middle of its line
    calibration : of its panel
    points, numbers : (m, 2) pixels of the panel's axis points, and the numbers (x, y) that they carry, None for none
    """

    body: str
    kind: str
    trace: Trace
    calibration: AxisCalibration
    points: np.ndarray
    numbers: Sequence[tuple[float | None, float | None]]


@dataclass(frozen=True, eq=False)
class Figure:
    """All curves read off a figure.

    Attributes
    ----------
    readings : the curves
    shown : the same on the picture; empty of an export
    light : (row, column, 3) the picture, None of an export
    form : what kind of file it was
    """

    readings: Sequence[Reading]
    shown: Sequence[PicturedCurve]
    light: np.ndarray | None
    form: str


def is_picture(path: Path) -> bool:
    """Whether a file is a picture, by its suffix."""
    return path.suffix.lower() in PICTURES


def read_figure(path: Path, spec: FigureToml, mistakes: Mistakes, bodies: Sequence[str] | None = None) -> Figure:
    """Read the curves that a description names off a picture or an export.

    Parameters
    ----------
    bodies : the bodies that are wanted, None for all

    Raises
    ------
    CalibError : every mistake of the description, and every curve that cannot be read, with file, line and key
    """
    wanted = [(i, entry) for i, entry in enumerate(spec.curve) if bodies is None or entry.body in bodies]
    known = list(dict.fromkeys(entry.body for entry in spec.curve))
    for body in bodies or ():
        if body not in known:
            raise CalibError(f"{mistakes.path} has no curve of body {body!r}{nearest(body, known)}; it has {known}")
    period = _period(spec, mistakes)
    if is_picture(path):
        return _off_picture(path, spec, wanted, period, mistakes)
    export = read_export(path)
    readings = []
    for index, entry in wanted:
        with mistakes.at("curve", index):
            readings.append(_off_export(export, entry, period, spec.excitation))
    mistakes.tell()
    return Figure(readings, (), None, export.form)


def _period(spec: FigureToml, mistakes: Mistakes) -> float | None:
    """Period of the excitation [s], None where it is not stated."""
    if spec.excitation is None or spec.excitation.frequency is None:
        return None
    frequency = None
    with mistakes.at("excitation", "frequency"):
        frequency = to_si(spec.excitation.frequency, "Hz")
        if not 0.0 < frequency < np.inf:
            raise CalibError(f"expected a frequency above 0, got {spec.excitation.frequency!r}")
    mistakes.tell()
    return 1.0 / frequency


# --- exports


def _off_export(
    export: Imported, entry: CurveTable, period: float | None, excitation: PrintedExcitation | None
) -> Reading:
    for key in ("panel", "colour", "dashed"):
        if getattr(entry, key) is not None:
            raise CalibError(f"{key} belongs to a curve in a picture; drop it, for {export.path.name} holds numbers")
    if entry.units is None:
        raise CalibError(f"units are missing: those of the two numbers of a point, such as {EXAMPLES[entry.kind]}")
    curve = export.curve(entry.name) if entry.columns is None else export.pair(*entry.columns)
    return _in_si(curve, entry, entry.units, period, excitation)


def _in_si(
    curve: Curve, entry: CurveTable, units: Sequence[str], period: float | None, excitation: PrintedExcitation | None
) -> Reading:
    """Return a curve in SI, its points in order."""
    points, slopes, sweep, own = _scaled(curve, entry, units, period, excitation)
    notes = list(curve.notes)
    closed = entry.kind == "phase curve"
    sigma = None if curve.sigma is None else curve.sigma * slopes
    if entry.sigma is not None:
        each = zip(entry.sigma, units, slopes.T, SI_UNITS[entry.kind], strict=True)
        if own is not None and sweep is not None:  # the second one is that of an amplitude
            stated = [to_si(entry.sigma[0], "Hz") * np.ones(len(points))]
            stated.append(amplitude_sigma(points[:, 0], entry.sigma[1], own, sweep))
        else:
            stated = [np.ones(len(points)) * _sigma(sigma, unit, factor[0], si) for sigma, unit, factor, si in each]
        sigma = np.column_stack(stated)
    if sigma is None:
        sigma = np.tile(ASSUMED_SIGMA_SHARE * np.ptp(points, axis=0), (len(points), 1))
        notes.append(
            f"its uncertainty is assumed as {ASSUMED_SIGMA_SHARE:g} of its extent; state sigma where you know it"
        )
    sigma = np.maximum(sigma, 1e-9 * np.ptp(points, axis=0))
    if not (np.abs(points).max() < MAX_NUMBER and sigma.max() < MAX_NUMBER):
        raise CalibError(f"its numbers exceed {MAX_NUMBER:g} in SI; check its units and axes")
    known = [m * slopes for m in (curve.modes, curve.lean) if len(m)]
    modes = np.concatenate([np.empty((0, len(points), 2)), *known])
    if not len(curve.lean):  # a trace is in order; points that were clicked or exported need not be
        order, of_order = ordered(points, closed)
        points, sigma, modes = points[order], sigma[order], modes[:, order]
        notes += of_order
        modes = np.concatenate([modes, leaning(sigma, closed)])
    return Reading(entry.body, entry.kind, points, sigma, modes, len(curve.modes), tuple(notes), sweep)


def _scaled(
    curve: Curve, entry: CurveTable, units: Sequence[str], period: float | None, excitation: PrintedExcitation | None
) -> tuple[np.ndarray, np.ndarray, PrintedSweep | None, MotionUnit | None]:
    """Points (n, 2) in SI, what one unit of either axis is there (n, 2), and of a response the sweep and its unit."""
    sweep = printed_sweep(entry, excitation)
    if sweep is None or entry.kind != AMPLITUDE_CURVE:
        factors = np.array([_factor(u, si, period) for u, si in zip(units, SI_UNITS[entry.kind], strict=True)])
        return curve.points * factors, np.tile(factors, (len(curve.points), 1)), sweep, None
    factor = to_si(f"1 {units[0]}", "Hz")
    found = printed_amplitudes(factor * curve.points[:, 0], curve.points[:, 1], units[1], sweep)
    points = np.column_stack([factor * curve.points[:, 0], found.values])
    slopes = np.column_stack([np.full(len(points), factor), found.slope])
    return points, slopes, sweep._replace(rates=found.unit.rates), found.unit


def _factor(unit: str, si: str, period: float | None) -> float:
    if si == "s" and unit == PERIOD_UNIT:
        if period is None:
            raise CalibError("time in periods needs the frequency of the excitation; state it in [excitation]")
        return period
    return to_si(f"1 {unit}", si)


def _sigma(stated: float | str, unit: str, factor: float, si: str) -> float:
    value = factor * stated if unit == PERIOD_UNIT and not isinstance(stated, str) else to_si(stated, si)
    if not 0.0 < value < np.inf:
        raise CalibError(f"sigma is a standard uncertainty above 0, got {stated!r}")
    return value


# --- pictures


def _off_picture(
    path: Path,
    spec: FigureToml,
    wanted: Sequence[tuple[int, CurveTable]],
    period: float | None,
    mistakes: Mistakes,
) -> Figure:
    light = read_picture(path)
    panels: dict[str, _Panel] = {}
    for index, panel in enumerate(spec.panel):
        with mistakes.at("panel", index):
            if panel.name in panels:
                raise CalibError(f"a second panel {panel.name!r}; give each its own name")
            panels[panel.name] = _calibrated(panel, light.shape)
    if not spec.panel:
        mistakes.add(("panel",), f"{path.name} is a picture: it needs a [[panel]] with axis points")
    mistakes.tell()
    readings, shown = [], []
    for index, entry in wanted:
        with mistakes.at("curve", index):
            colour = _colour(entry)
            own = _panel(entry, panels)
            trace = traced(light, own.inside, _wanted(entry, colour, own.calibration))
            curve = _curve(entry, trace, own.calibration)
            table = own.table
            readings.append(_in_si(curve, entry, (table.x.unit, table.y.unit), period, spec.excitation))
            pixels = np.array([point.pixel for point in table.points])
            numbers = [(point.x, point.y) for point in table.points]
            shown.append(PicturedCurve(entry.body, entry.kind, trace, own.calibration, pixels, numbers))
    mistakes.tell()
    return Figure(readings, shown, light, "picture")


@dataclass(frozen=True, eq=False)
class _Panel:
    """A panel with its calibration, and the pixels (row, column) between its limits."""

    table: PanelTable
    calibration: AxisCalibration
    inside: np.ndarray


def _colour(entry: CurveTable) -> np.ndarray:
    """Red, green and blue (3,) in [0, 1] of the line of a curve in a picture."""
    for key in ("name", "columns", "units"):
        if getattr(entry, key) is not None:
            raise CalibError(f"{key} belongs to a curve of an export; of a picture, name its panel and colour")
    if entry.colour is None:
        raise CalibError("colour is missing: that of the line, such as '#0072B2' or 'black'")
    code = "#000000" if entry.colour == "black" else entry.colour
    return np.array([int(code[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0


def _panel(entry: CurveTable, panels: Mapping[str, _Panel]) -> _Panel:
    if entry.panel is None and len(panels) == 1:
        return next(iter(panels.values()))
    if entry.panel is None or entry.panel not in panels:
        names = list(panels)
        raise CalibError(f"there is no panel {entry.panel!r}{nearest(str(entry.panel), names)}; there are {names}")
    return panels[entry.panel]


def _calibrated(panel: PanelTable, shape: Sequence[int]) -> _Panel:
    calibration = calibrated(
        [point.pixel for point in panel.points],
        [point.x for point in panel.points],
        [point.y for point in panel.points],
        (panel.x.scale == "log", panel.y.scale == "log"),
        panel.reading,
    )
    corners = [(panel.x.low, panel.y.low), (panel.x.high, panel.y.low), (panel.x.high, panel.y.high),
               (panel.x.low, panel.y.high)]  # fmt: skip
    outline = calibration.pixels(np.array(corners))
    inside = polygon2mask(shape[:2], outline[:, ::-1])
    for left, top, right, bottom in panel.erase:
        inside[max(0, int(top)) : max(0, int(bottom) + 1), max(0, int(left)) : max(0, int(right) + 1)] = False
    if inside.sum() < 100:
        raise CalibError(
            f"between its limits lie {int(inside.sum())} pixels of the picture of {shape[1]} x {shape[0]}; "
            "check limits and axis points (column first, counted from the top left corner)"
        )
    return _Panel(panel, calibration, inside)


def _wanted(entry: CurveTable, colour: np.ndarray, calibration: AxisCalibration) -> CurveRequest:
    through = calibration.pixels(np.array(entry.through)) if entry.through else np.empty((0, 2))
    return CurveRequest(entry.body, colour, entry.kind == "phase curve", entry.dashed, through)


def _curve(entry: CurveTable, trace: Trace, calibration: AxisCalibration) -> Curve:
    """Return a trace in the units of the axes, with its uncertainty."""
    pixels = trace.path
    rates = calibration.rates(pixels)
    along = np.gradient(pixels, axis=0)
    normal = along[:, ::-1] * (1.0, -1.0) / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    across = np.einsum("nij,nj->ni", rates, normal)  # what one pixel across the line is on the axes
    closed = entry.kind == "phase curve"
    lean = hats(len(pixels), closed)[:, :, None] * (trace.lean[:, None] * across)[None]
    sigma = np.maximum(trace.noise * np.abs(across), 1e-12)
    notes = (*trace.notes, _posture(calibration))
    return Curve(entry.body, calibration(pixels), sigma, calibration.modes(pixels), lean, notes)


def _posture(calibration: AxisCalibration) -> str:
    """Describe rotation and shear of the page, and the residuals of the axis points."""
    turn, shear = calibration.posture
    residual = calibration.residual
    agree = "no axis point is over to check them by"
    if len(residual) > 3:
        rms = np.sqrt(np.mean(residual**2))
        agree = f"axis points are {rms:.2f} pixels off it (root mean square), {residual.max():.2f} at most"
    return f"the page is turned by {turn:.2f} and sheared by {shear:.2f} degrees; {agree}"
