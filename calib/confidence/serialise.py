"""Profiles in SI and in words."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from calib.confidence.constrained import FittedPoint
from calib.confidence.document import ConfidenceResult, EndResult, PairResult, PointResult, ProfileResult
from calib.confidence.likelihood import LEVEL
from calib.confidence.pair import NODES_PER_SIDE
from calib.confidence.profile import CROSSED, JUMP, NO_MOTION, WINDOW_END, Side, SideEnd
from calib.confidence.profiles import HIGH, LOW, Profiles
from calib.modelling.parameter import Space
from calib.units import count, shown

MAX_EQUAL_DIFFERENCE = 0.05  # of half widths, relative, that count as equal  [1]
MAX_UNSAID_MOVE = 0.1  # of a standard error: a best point that moved less is the calibrated one  [1]
WORDS = {LOW: "below", HIGH: "above"}


def confidence_result(
    name: str, space: Space, units: Mapping[str, str], profiles: Profiles, evaluations: int, seconds: float
) -> ConfidenceResult:
    """Return what confidence.json holds.

    Parameters
    ----------
    name : of the study
    space : of its parameters
    units : SI unit of each
    evaluations, seconds : that the profiles took
    """
    values, calibrated = space.values(profiles.centre.u), space.values(profiles.centre.u - profiles.moved)
    return ConfidenceResult(
        name=name,
        level=LEVEL,
        noise=_noise(profiles),
        calibrated={own: calibrated[own] for own in space.names},
        values={own: values[own] for own in space.names},
        kind=profiles.centre.kind,
        profiles=tuple(_profile(own, space, units[own], profiles) for own in profiles.sides),
        pairs=tuple(_pair(space, units, profiles, k) for k in range(len(profiles.pairs))),
        remarks=tuple(_remarks(space, profiles)),
        evaluations=evaluations,
        seconds=seconds,
    )


def _noise(profiles: Profiles) -> str:
    if profiles.centre.likelihood.differentiable:
        return (
            "the likelihood is adjusted to the level and the autocorrelation of the residuals of each channel, as in "
            "the local intervals"
        )
    return (
        "the residuals have no derivatives at the best point "
        f"({profiles.analysis.confidence.reason}); the noise is the largest spectral density of the residuals of each "
        "channel, which makes intervals wide rather than narrow"
    )


def _profile(name: str, space: Space, unit: str, profiles: Profiles) -> ProfileResult:
    sides, ends, points = profiles.sides[name], profiles.ends[name], profiles.points[name]
    axis, window = sides[0].axis, space.windows[name]
    at = [
        (side.position(side.distance(point)), side, point)
        for side, own in zip(sides, points, strict=True)
        for point in own
    ]
    likelihood = profiles.centre.likelihood
    local = half = None
    if likelihood.differentiable:
        width = sides[0].target * float(likelihood.standard_error[axis])
        x = float(profiles.centre.u[axis])
        local = window.value(x - width), window.value(x + width)
        span = math.log(window.high / window.low) if window.scale == "log" else window.high - window.low
        half = width * span
    low, high = (_end(side, end, space, name, unit) for side, end in zip(sides, ends, strict=True))
    return ProfileResult(
        name, unit, window.scale, window.value(float(profiles.centre.u[axis])), low, high, local,
        likelihood.quantile([axis]), half, _difference(sides, ends, points, space, name, unit),
        tuple(_point(space, name, side, point) for _, side, point in sorted(at, key=lambda one: one[0])),
    )  # fmt: skip


def _point(space: Space, name: str, side: Side, point: FittedPoint) -> PointResult:
    values = space.values(np.array(point.u))
    root = side.root(point)
    own = {key: values[key] for key in space.names}
    return PointResult(values[name], None if math.isinf(root) else root**2, point.kind, point.reason, own)


def _end(side: Side, end: SideEnd, space: Space, name: str, unit: str) -> EndResult:
    value = space.windows[name].value(side.position(end.distance))
    text, (near, far) = shown(value, unit), end.kinds
    changes = "" if near == far or far is None else f", a change of the kind of motion ({near} to {far})"
    words = {
        CROSSED: text,
        WINDOW_END: f"open: the likelihood never falls enough before the end of the window, {text}",
        NO_MOTION: f"{text}: beyond, {end.reason}",
        JUMP: f"{text}: the likelihood jumps there{changes}",
    }
    return EndResult(value, end.cause, words.get(end.cause, f"not located: beyond {text}"))


def _difference(
    sides: tuple[Side, Side], ends: tuple[SideEnd, SideEnd],
    points: tuple[Sequence[FittedPoint], Sequence[FittedPoint]], space: Space, name: str, unit: str,
) -> str:  # fmt: skip
    """One sentence: how the interval differs from the local one, and why."""
    window = space.windows[name]
    causes = [
        f"{WORDS[label]}, it is {_end(side, end, space, name, unit).text}"
        for label, side, end in zip(WORDS, sides, ends, strict=True)
        if end.cause != CROSSED
    ]
    for side, own, end in zip(sides, points, ends, strict=True):
        causes += [
            f"the kind of motion changes at about {shown(window.value(side.position(at)), unit)} ({before} to {after})"
            for at, before, after in _changes(side, own, end.distance)
        ]
    if not sides[0].centre.likelihood.differentiable:
        return "; ".join(["there is no local interval to compare with", *causes])
    widths = [end.distance / (side.target * float(side.centre.likelihood.standard_error[side.axis]))
              for side, end in zip(sides, ends, strict=True)]  # fmt: skip
    crossed = [width for width, end in zip(widths, ends, strict=True) if end.cause == CROSSED]
    if not causes and all(abs(width - 1.0) <= MAX_EQUAL_DIFFERENCE for width in crossed):
        return f"as the local interval, within {max(abs(width - 1.0) for width in crossed):.1%}"
    if crossed:
        parts = [
            f"{width:.3g} times as far {WORDS[label]}"
            for label, width, end in zip(WORDS, widths, ends, strict=True)
            if end.cause == CROSSED
        ]
        scale = ", on the logarithmic scale of the window" if window.scale == "log" else ""
        causes.insert(0, f"it reaches {' and '.join(parts)} as the local interval{scale} (curvature of the model)")
    return "; ".join(causes)


def _changes(side: Side, points: Sequence[FittedPoint], limit: float) -> list[tuple[float, str, str]]:
    """Changes of the kind of motion within the interval: distance, kind before and behind."""
    ordered = sorted((side.distance(p), p.kind) for p in points if math.isfinite(p.square))
    changes, (before, kind) = [], (0.0, side.centre.kind)
    for at, own in ordered:
        if own != kind and at <= limit:
            changes.append((0.5 * (before + at), f"{kind}", f"{own}"))
        before, kind = at, own
    return changes


def _pair(space: Space, units: Mapping[str, str], profiles: Profiles, k: int) -> PairResult:
    pair, points = profiles.pairs[k]
    names = tuple(space.names[axis] for axis in pair.axes)
    windows = [space.windows[name] for name in names]
    span = range(-NODES_PER_SIDE, NODES_PER_SIDE + 1)
    ratios = [[pair.ratio((i, j), points[i, j]) for j in span] for i in span]
    first, second = (
        tuple(window.value(float(x)) for x in row) for window, row in zip(windows, pair.positions, strict=True)
    )
    return PairResult(
        names, tuple(units[name] for name in names), tuple(window.scale for window in windows), first, second,
        tuple(tuple(None if math.isinf(ratio) else ratio for ratio in row) for row in ratios),
        profiles.centre.likelihood.quantile(list(pair.axes)),
    )  # fmt: skip


def _remarks(space: Space, profiles: Profiles) -> list[str]:
    remarks = []
    likelihood = profiles.centre.likelihood
    if profiles.improved:
        remarks.append("a profile met a better point than the calibrated one; the intervals are about that")
    elif likelihood.differentiable:
        moved = np.abs(profiles.moved) / likelihood.standard_error
        far = [f"{name} by {size:.2g}" for name, size in zip(space.names, moved, strict=True) if size > MAX_UNSAID_MOVE]
        if far:
            remarks.append(
                f"the calibrated values are not quite the best ones: moved were, in standard errors, {', '.join(far)}"
            )
    if profiles.better:
        remarks.append(
            "profiles still meet better points than the best one: there are several minima; search longer, with "
            "`calib run` and a larger budget"
        )
    failed = [p for both in profiles.points.values() for own in both for p in own if not math.isfinite(p.square)]
    if failed:
        remarks.append(f"{count(len(failed), 'point')} of the profiles could not be compared: {failed[0].reason}")
    return remarks
