"""One curve of a picture, traced along the middle of its line."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import Akima1DInterpolator
from scipy.ndimage import gaussian_filter1d, map_coordinates

from calib.digitise.image.ink import MIN_CONTRAST, coverage, paper
from calib.digitise.image.linking import StrokeChain, linked
from calib.digitise.image.strokes import strokes
from calib.errors import CalibError

INK_COVERAGE = 0.5  # over the fullest coverage of the line: from it on a pixel counts as ink
MIN_LENGTH_PIXELS = 30.0  # of a curve
MIN_RIVAL_SHARE = 0.6  # of the longest candidate: a candidate from this length on could be meant as well
MAX_BREACH_SHARE = 0.05  # of its length: the widest gap at which a curve that should close is closed
STEP_PIXELS = 0.5  # between the points of a trace
SMOOTHING_WIDTHS = 1.0  # line widths over which a trace is smoothed
CORNER_RADIANS = 0.6  # over three line widths: more is a corner, which is not smoothed
MIDDLE_SIGMA_WIDTHS = 0.04  # line widths: standard uncertainty of the middle of a line, correlated along it
MIDDLE_SIGMA_PIXELS = 0.05  # pixels: standard uncertainty of the middle of a line by the pixels themselves
DASH_END_WIDTHS = 0.6  # line widths at the end of a dash whose middle is not that of its line
MAX_WIDTH_DEVIATION = 0.3  # relative; a line thinner or thicker than that is hidden by another, or runs into it
MIN_WIDTH_DEVIATION = 0.1  # relative; from it on the middle of the line is uncertain
MIDDLE_SHIFT_WIDTHS = 0.35  # line widths by which a relative deviation of 1 of the width moves the middle
BRIDGE_SIGMA = 0.08  # of a gap: standard uncertainty of the bridge over it
THROUGH_WIDTHS = 2.5  # line widths: largest distance of the curve from a point that it passes through


@dataclass(frozen=True, eq=False)
class CurveRequest:
    """A curve to look for.

    Attributes
    ----------
    name : for messages
    colour : (3,) of its ink in [0, 1]
    closed : whether it returns to its beginning
    dashed : whether it is dashed or dotted, None where that is left open
    through : (m, 2) pixels that it passes through; empty where its colour alone identifies it
    """

    name: str
    colour: np.ndarray
    closed: bool = True
    dashed: bool | None = None
    through: np.ndarray = field(default_factory=lambda: np.empty((0, 2)))


@dataclass(frozen=True, eq=False)
class Trace:
    """The middle of a line.

    Attributes
    ----------
    path : (n, 2) column and row, `STEP_PIXELS` apart  [pixels]
    inked : (n,) whether there is ink, False in a bridged gap
    noise : standard uncertainty of a point, independent from point to point  [pixels]
    lean : (n,) standard uncertainty over stretches of the curve  [pixels]
    notes : what its reader should know
    """

    path: np.ndarray
    inked: np.ndarray
    noise: float
    lean: np.ndarray
    notes: tuple[str, ...]


def traced(light: np.ndarray, inside: np.ndarray, wanted: CurveRequest) -> Trace:
    """Find a curve within a panel.

    Parameters
    ----------
    light : (row, column, 3) in [0, 1]
    inside : (row, column) True in the panel

    Raises
    ------
    CalibError : no such ink, no such curve, several that could be meant, a loop that does not close, or a curve that
        leaves the panel
    """
    ground = paper(light, inside)
    if np.linalg.norm(wanted.colour - ground) < MIN_CONTRAST:
        raise CalibError(f"curve {wanted.name!r}: its colour is that of the paper; mend colour")
    share = np.where(inside, coverage(light, wanted.colour, ground), 0.0)
    ink = share > INK_COVERAGE * _fullest(share)
    if ink.sum() > 0.25 * inside.sum():
        raise CalibError(
            f"curve {wanted.name!r}: {100.0 * ink.sum() / inside.sum():.0f} % of the panel have its colour, too much "
            "for lines; mend colour or limits"
        )
    lines, width = strokes(ink)
    chain = _chosen(linked(lines, width), wanted, width)
    _check_inside(chain, inside, wanted, width)
    return _refined(share, chain, wanted, width)


def _fullest(share: np.ndarray) -> float:
    """Coverage in the middle of a line; thin lines cover no pixel whole, and grey ones are no thin black ones."""
    for least in (0.5, 0.3):
        some = share[share > least]
        if some.size > MIN_LENGTH_PIXELS:
            return float(np.quantile(some, 0.9))
    return 1.0


def _chosen(chains: Sequence[StrokeChain], wanted: CurveRequest, width: float) -> StrokeChain:
    """Return the chain of strokes that fits the description."""
    where = f"curve {wanted.name!r}"
    fit = [c for c in chains if c.length > MIN_LENGTH_PIXELS]
    if not fit:
        raise CalibError(f"{where}: no line of its colour in the panel; check colour and limits of the panel")
    if wanted.dashed is not None:
        kind = "dashed" if wanted.dashed else "solid"
        fit = [c for c in fit if c.dashed == wanted.dashed]
        if not fit:
            raise CalibError(f"{where}: none of the lines of its colour is {kind}; check colour and dashed")
    if len(wanted.through):
        fit = [c for c in fit if _passes(c, wanted.through, THROUGH_WIDTHS * width + 2.0)]
        if not fit:
            raise CalibError(f"{where}: no line of its colour passes through all of its points; check through")
    fit.sort(key=lambda c: c.length, reverse=True)
    best = fit[0]
    if wanted.closed:
        rings = [c for c in fit if _closes(c)]
        if not rings or rings[0].length < MIN_RIVAL_SHARE * best.length:
            gap = np.linalg.norm(best.path[0] - best.path[-1])
            raise CalibError(
                f"{where}: the longest line of its colour does not close: its ends are {gap:.0f} pixels apart, at "
                f"{_spot(best.path[0])} and {_spot(best.path[-1])} (column, row), after {len(best.path)} pixels; "
                "look there for something that cuts it, or enlarge the limits of the panel"
            )
        fit, best = rings, rings[0]
    rivals = [c for c in fit[1:] if c.length > MIN_RIVAL_SHARE * best.length]
    if rivals:
        raise CalibError(
            f"{where}: {1 + len(rivals)} lines of its colour could be meant; say which, by dashed = true or false, or "
            "by points that it alone passes through: through = [[x, y]]"
        )
    return best


def _closes(chain: StrokeChain) -> bool:
    apart = np.linalg.norm(chain.path[0] - chain.path[-1])
    return bool(chain.closed or apart < MAX_BREACH_SHARE * len(chain.path))


def _spot(pixel: np.ndarray) -> str:
    return f"({pixel[0]:.0f}, {pixel[1]:.0f})"


def _passes(chain: StrokeChain, points: np.ndarray, near: float) -> bool:
    distance = np.linalg.norm(chain.path[:, None] - points[None], axis=2).min(axis=0)
    return bool((distance < near).all())


def _check_inside(chain: StrokeChain, inside: np.ndarray, wanted: CurveRequest, width: float) -> None:
    """Check that a curve does not run along the edge of the panel, beyond which it may continue."""
    columns, rows = np.round(chain.path).astype(int).T
    padded = np.pad(inside, 1)
    reach = max(1, round(0.5 * width) + 1)
    shape = np.array(inside.shape) - 1
    cut = np.zeros(len(columns), dtype=bool)
    for dx, dy in ((reach, 0), (-reach, 0), (0, reach), (0, -reach)):
        row, column = np.clip(rows + dy, -1, shape[0] + 1), np.clip(columns + dx, -1, shape[1] + 1)
        cut |= ~padded[row + 1, column + 1]
    if wanted.closed and cut.any():
        at = int(np.argmax(cut))
        raise CalibError(
            f"curve {wanted.name!r} reaches the edge of the panel at {_spot(chain.path[at])} (column, row), and may go "
            "on beyond it; enlarge its limits, or leave the frame of the figure out of them"
        )


def _refined(share: np.ndarray, chain: StrokeChain, wanted: CurveRequest, width: float) -> Trace:
    """Move a thinned line to the middle of its ink, to parts of a pixel."""
    mode = "wrap" if wanted.closed else "nearest"
    path, inked = _spaced(chain.path, chain.inked, wanted.closed)
    path = _smoothed(path, 0.5 * width / STEP_PIXELS, mode)
    for _ in range(2):
        sharp = _corners(path, width, mode)
        normal = _normals(path, width, mode)
        offset, thick = _offsets(share, path, normal, width)
        odd = np.abs(thick / np.median(thick[inked]) - 1.0)
        reliable = inked & ~sharp & np.isfinite(offset) & (odd < MAX_WIDTH_DEVIATION)
        if reliable.sum() < 0.3 * len(path):
            reliable = inked & np.isfinite(offset)
        raw = _between(offset, reliable, wanted.closed)
        smooth = np.where(sharp, raw, gaussian_filter1d(raw, SMOOTHING_WIDTHS * width / STEP_PIXELS, mode=mode))
        noise = float(np.sqrt(np.mean((raw - smooth)[reliable] ** 2))) if reliable.any() else 0.0
        path = path + smooth[:, None] * normal
    if not inked.all():
        path = _bridged(path, inked, width, wanted.closed)
    lean = (
        np.hypot(MIDDLE_SIGMA_PIXELS, MIDDLE_SIGMA_WIDTHS * width)
        + BRIDGE_SIGMA * _distance_to_ink(inked, wanted.closed) * STEP_PIXELS
    )
    lean = np.where(sharp, lean + 0.15 * width, lean)
    lean = np.hypot(
        lean, np.where(inked, MIDDLE_SHIFT_WIDTHS * width * np.clip(odd - MIN_WIDTH_DEVIATION, 0.0, 1.0), 0.0)
    )
    notes = []
    hidden = 1.0 - inked.mean()
    if hidden > 0.02:
        notes.append(f"{100.0 * hidden:.0f} % of the curve are bridged: gaps of dashes, or hidden behind other lines")
    if wanted.closed and not chain.closed:
        gap = np.linalg.norm(chain.path[0] - chain.path[-1])
        notes.append(f"the loop did not close by itself: its ends were {gap:.1f} pixels apart")
    return Trace(path, inked, noise, lean, tuple(notes))


def _spaced(path: np.ndarray, inked: np.ndarray, closed: bool) -> tuple[np.ndarray, np.ndarray]:
    """Points `STEP_PIXELS` apart on a path."""
    if closed:
        path, inked = np.vstack([path, path[:1]]), np.append(inked, inked[:1])
    away = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    count = max(8, round(away[-1] / STEP_PIXELS))
    at = np.linspace(0.0, away[-1], count, endpoint=not closed)
    spaced = np.column_stack([np.interp(at, away, path[:, k]) for k in (0, 1)])
    return spaced, inked[np.clip(np.searchsorted(away, at), 0, len(inked) - 1)]


def _smoothed(path: np.ndarray, points: float, mode: str) -> np.ndarray:
    return gaussian_filter1d(path, max(1.0, points), axis=0, mode=mode)


def _tangents(path: np.ndarray, width: float, mode: str) -> np.ndarray:
    reach = max(1, round(0.75 * width / STEP_PIXELS))
    ahead, behind = _moved(path, reach, mode), _moved(path, -reach, mode)
    along = ahead - behind
    return along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)


def _moved(values: np.ndarray, by: int, mode: str) -> np.ndarray:
    if mode == "wrap":
        return np.roll(values, -by, axis=0)
    return values[np.clip(np.arange(len(values)) + by, 0, len(values) - 1)]


def _normals(path: np.ndarray, width: float, mode: str) -> np.ndarray:
    return _tangents(path, width, mode) @ np.array([[0.0, 1.0], [-1.0, 0.0]])


def _corners(path: np.ndarray, width: float, mode: str) -> np.ndarray:
    """Where (n,) the direction turns by more than `CORNER_RADIANS` over three line widths."""
    tangent = _tangents(path, width, mode)
    reach = max(1, round(1.5 * width / STEP_PIXELS))
    ahead, behind = _moved(tangent, reach, mode), _moved(tangent, -reach, mode)
    turned = np.arccos(np.clip((ahead * behind).sum(axis=1), -1.0, 1.0))
    return turned > CORNER_RADIANS


def _offsets(share: np.ndarray, path: np.ndarray, normal: np.ndarray, width: float) -> tuple[np.ndarray, np.ndarray]:
    """Distance (n,) from the path to the middle of the ink across it, NaN where there is none, and its amount (n,)."""
    reach = 0.5 * width + 1.5
    across = np.arange(-reach, reach + 1e-9, 0.25)
    positions = path[:, None] + across[None, :, None] * normal[:, None]
    ink = map_coordinates(share, [positions[:, :, 1], positions[:, :, 0]], order=1, mode="nearest")
    ink = np.clip(ink - 0.25 * ink.max(axis=1, keepdims=True), 0.0, None)
    total = ink.sum(axis=1)
    middle = np.divide(ink @ across, total, out=np.full(len(path), np.nan), where=total > 0.5 * width)
    return np.where(np.abs(middle) < 0.5 * width + 0.5, middle, np.nan), total


def _bridged(path: np.ndarray, reliable: np.ndarray, width: float, closed: bool) -> np.ndarray:
    """Path with its gaps, and the ends of dashes beside them, bridged by a smooth curve through the rest."""
    away = _distance_to_ink(~reliable, closed) * STEP_PIXELS
    inner = reliable & (away > DASH_END_WIDTHS * width)
    for dash in np.split(np.arange(len(reliable)), np.flatnonzero(np.diff(reliable.astype(int))) + 1):
        if reliable[dash[0]] and not inner[dash].any():  # a dot: its middle
            inner[dash[len(dash) // 2]] = True
    where = np.flatnonzero(inner)
    if where.size < 4:
        return path
    index = np.arange(len(path))
    if closed:
        where = np.concatenate([where - len(path), where, where + len(path)])
    smooth = Akima1DInterpolator(where, path[where % len(path)], method="makima")(index)
    return np.where(np.isfinite(smooth), smooth, path)


def _between(values: np.ndarray, reliable: np.ndarray, closed: bool) -> np.ndarray:
    """Values (n,) with those not reliable by straight lines between those that are."""
    where = np.flatnonzero(reliable)
    if not where.size:
        return np.zeros(len(values))
    period = {"period": len(values)} if closed else {}
    return np.interp(np.arange(len(values)), where, values[where], **period)


def _distance_to_ink(inked: np.ndarray, closed: bool) -> np.ndarray:
    """Points (n,) to the nearest one that is inked."""
    index = np.arange(len(inked))
    where = index[inked]
    if closed:
        where = np.concatenate([where - len(inked), where, where + len(inked)])
    if not where.size:
        return np.full(len(inked), float(len(inked)))
    after = np.clip(np.searchsorted(where, index), 0, len(where) - 1)
    before = np.clip(after - 1, 0, len(where) - 1)
    return np.minimum(np.abs(where[after] - index), np.abs(index - where[before])).astype(float)
