"""The chapter of a page that says how sure the calibrated values are: intervals, profiles, what differs and why."""

import math
from dataclasses import dataclass

from calib.confidence.document import ConfidenceResult, EndResult, ProfileResult
from calib.confidence.profile import WINDOW_END
from calib.report.formatting import capitalised, count
from calib.report.pages.diagnosis.conclusion import MAX_RELATIVE_CHANGE
from calib.report.pages.picture import Picture
from calib.report.plots.profiles import profiles_figure
from calib.study import CalibrationResult
from calib.units import shown

PROFILES = (
    "Likelihood-ratio statistic (twice the fall of the log-likelihood from its best value) over each parameter, all "
    "others searched again. Where it crosses the quantile the interval ends; the parabola is what the curvature at the "
    "best value alone says."
)
PAIRS = " Of two parameters: the region of the joint quantile, and that of a quarter of it."


@dataclass(frozen=True)
class IntervalRow:
    """The intervals of one parameter."""

    name: str
    value: str
    profile: str
    local: str
    posterior: str
    text: str


@dataclass(frozen=True)
class ConfidenceChapter:
    """Everything that a page shows of the profiles, in the order of the page."""

    stale: bool
    rows: tuple[IntervalRow, ...]
    posterior: bool
    caption: str
    remarks: tuple[str, ...]
    picture: Picture
    effort: str


def confidence_chapter(confidence: ConfidenceResult, result: CalibrationResult) -> ConfidenceChapter:
    """Everything that a page shows of the profiles.

    Parameters
    ----------
    result : of the calibration as it is now
    """
    then, now = confidence.calibrated, result.values
    stale = any(n in then and not math.isclose(then[n], x, rel_tol=MAX_RELATIVE_CHANGE) for n, x in now.items())
    sampled = {} if confidence.posterior is None else {own.name: own for own in confidence.posterior.parameters}
    rows = [
        IntervalRow(
            profile.name,
            shown(profile.value, profile.unit),
            f"{_end(profile, profile.low)} .. {_end(profile, profile.high)}",
            "" if profile.local is None else _interval(profile, *profile.local),
            _interval(profile, sampled[profile.name].low, sampled[profile.name].high) if sampled else "",
            profile.text,
        )
        for profile in confidence.profiles
    ]
    return ConfidenceChapter(
        stale=stale,
        rows=tuple(rows),
        posterior=bool(sampled),
        caption=f"{confidence.level:.1%} intervals. {capitalised(confidence.noise)}.",
        remarks=tuple(map(capitalised, confidence.remarks)),
        picture=Picture(profiles_figure(confidence), "profiles", PROFILES + (PAIRS if confidence.pairs else "")),
        effort=f"{count(confidence.evaluations, 'evaluation')} of the calibrated records",
    )


def _end(profile: ProfileResult, end: EndResult) -> str:
    return "open" if end.cause == WINDOW_END else shown(end.value, profile.unit)


def _interval(profile: ProfileResult, low: float, high: float) -> str:
    return f"{shown(low, profile.unit)} .. {shown(high, profile.unit)}"
