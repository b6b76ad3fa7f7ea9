"""The chapter of a page that says how far the parameters may vary: the admissible window."""

import math
from dataclasses import dataclass

import xarray as xr

from calib.confidence.window.document import WindowResult
from calib.confidence.window.words import (
    admissible_in_words,
    alone,
    bounds,
    mechanisms_in_words,
    percent,
    share_in_words,
    together,
)
from calib.report.formatting import capitalised
from calib.report.pages.diagnosis.conclusion import MAX_RELATIVE_CHANGE
from calib.report.pages.picture import Picture
from calib.report.plots.window import window_figure
from calib.study import CalibrationResult
from calib.units import count

WINDOW_CAPTION = (
    "Below the diagonal: slices through the calibrated point, coloured by what bounds the window; above it: share of "
    "the other parameters, within the drawn box, that is admissible, with the evaluated points; on it: the same over "
    "one parameter, what it may vary alone (blue bar) and together with all others (orange bar)."
)


@dataclass(frozen=True)
class ToleranceRow:
    """How far one parameter may vary."""

    name: str
    alone: str
    together: str
    bounds: str


@dataclass(frozen=True)
class WindowChapter:
    """Everything that a page shows of the window, in the order of the page."""

    stale: bool
    share: str
    admitted: str
    mechanisms: str
    rows: tuple[ToleranceRow, ...]
    inside: str
    remarks: tuple[str, ...]
    picture: Picture
    effort: str


def window_chapter(window: WindowResult, dataset: xr.Dataset, result: CalibrationResult) -> WindowChapter:
    """Everything that a page shows of the window.

    Parameters
    ----------
    dataset : of window.nc
    result : of the calibration as it is now
    """
    then, now = window.calibrated, result.values
    stale = any(n in then and not math.isclose(then[n], x, rel_tol=MAX_RELATIVE_CHANGE) for n, x in now.items())
    inside = ""
    if window.box_share is not None:
        inside = f"The largest box inside has {percent(window.box_share)} of the window's volume"
        if window.ellipsoid is not None:
            inside += f", the largest ellipsoid {percent(window.ellipsoid.share)}"
        inside += "."
    return WindowChapter(
        stale=stale,
        share=capitalised(share_in_words(window)),
        admitted=admissible_in_words(window),
        mechanisms=mechanisms_in_words(window.mechanisms, most=len(window.mechanisms)),
        rows=tuple(ToleranceRow(own.name, alone(own), together(own), bounds(own)) for own in window.parameters),
        inside=inside,
        remarks=tuple(map(capitalised, window.remarks)),
        picture=Picture(window_figure(window, dataset), "window", WINDOW_CAPTION),
        effort=f"{count(window.points, 'point')}, {count(window.simulations, 'simulation')}",
    )
