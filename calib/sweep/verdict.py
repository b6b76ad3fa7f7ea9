"""The motion that gives the kind at a value, once those of neighbouring values are known."""

from collections.abc import Container, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from calib.dynamics.motion import gives_kind
from calib.dynamics.orbit_kind import FAILED, NEUTRAL_EXPONENT, QUASI_PERIODIC
from calib.dynamics.recurrence import SAME_MOTION_DISTANCE
from calib.sweep.compute import OTHER, no_motion, stacked
from calib.sweep.continuation import Known, Regular, supported
from calib.sweep.plan import NONE, Sweep

Motion = dict[str, np.ndarray]  # arrays of one motion by name
Rows = dict[tuple[int, int], dict[str, np.ndarray]]  # branch, point -> arrays


NO_NAMES = np.array([], dtype=str)


class Arrivals(NamedTuple):
    """Motions continued to a point from its neighbours: new ones, and sightings of those of each period there."""

    motions: list[Motion]
    support: dict[int, int]


def known(sweep: Sweep, rows: Rows) -> dict[int, Known]:
    """Regular motions of each point, of all starts; none where states are carried, and nothing is continued."""
    if sweep.carry != NONE:
        return {}
    return {point: _known(sweep, rows, point) for point in range(len(sweep.points))}


def _known(sweep: Sweep, rows: Rows, point: int) -> Known:
    regular, settled = [], False
    for branch in range(len(sweep.starts)):
        row = rows[branch, point]
        for motion in _motions(sweep, row):
            if _regular(motion):
                regular.append(_as_regular(motion, row["names"]))
        settled |= _regular(row) and bool(row["share"] > 0.0)
    failed = all(rows[branch, point]["kind"] == FAILED for branch in range(len(sweep.branches)))
    return Known(tuple(regular), settled, failed)


def regular_at_end(
    at: Mapping[int, Known], points: Sequence[int], arrays: Mapping[str, np.ndarray]
) -> tuple[Regular, ...]:
    """Motions that the last of some points brings to the next: those known there, and those brought to it."""
    brought = _unstacked(arrays, np.flatnonzero(arrays["at"] == len(points) - 1))
    motions = (*at[points[-1]].regular, *(_as_regular(motion, motion["names"]) for motion in brought))
    return supported(motions, _support(arrays, len(points) - 1))


def _support(arrays: Mapping[str, np.ndarray], index: int) -> dict[int, int]:
    """Sightings of the motions of each period at the points of a chain before an index."""
    return dict(zip(arrays["confirmed"][index].tolist(), arrays["support"][index].tolist(), strict=True))


def arrivals(
    chains: Sequence[tuple[int, ...]], pieces: Sequence[Sequence[Mapping[str, np.ndarray]]], chunk: int
) -> dict[int, Arrivals]:
    """Motions continued to each point by all chains.

    Parameters
    ----------
    pieces : of each chain, of `chunk` points each
    """
    brought: dict[int, Arrivals] = {}
    for chain, parts in zip(chains, pieces, strict=True):
        for c, arrays in enumerate(parts):
            for index, point in enumerate(chain[c * chunk : (c + 1) * chunk]):
                before = brought.get(point, Arrivals([], {}))
                own = _support(arrays, index)
                brought[point] = Arrivals(
                    before.motions + _unstacked(arrays, np.flatnonzero(arrays["at"] == index)),
                    {p: before.support.get(p, 0) + own.get(p, 0) for p in {*before.support, *own}},
                )
    return brought


def judged(sweep: Sweep, rows: Rows, brought: Mapping[int, Arrivals]) -> Rows:
    """Rows with all motions of each point, of which one gives the kind by the rule of a sweep."""
    return {
        (branch, point): _judged(sweep, row, brought[point], _of_other_starts(sweep, rows, branch, point))
        if point in brought and row["kind"] != FAILED
        else row
        for (branch, point), row in rows.items()
    }


def _of_other_starts(sweep: Sweep, rows: Rows, branch: int, point: int) -> list[Motion]:
    others = [rows[b, point] for b in range(len(sweep.branches)) if b != branch]
    met = [motion for row in others for motion in _motions(sweep, row) if _regular(motion)]
    return [{**motion, "share": np.array(0.0)} for motion in met]


def _judged(sweep: Sweep, row: Motion, brought: Arrivals, elsewhere: Sequence[Motion]) -> Motion:
    own = _motions(sweep, row)
    motions = list(own)
    for motion in (*brought.motions, *elsewhere):
        if not any(_same(motion, other) for other in motions):
            motions.append(motion)
    chosen, certain = own[0], bool(row["certain"])
    if not (_regular(chosen) and certain and row["runs"] == 1):  # else no rounding leads the run elsewhere
        established = [motion for motion in motions if _regular(motion) and _established(motion, brought)]
        if established:
            chosen = min(established, key=lambda motion: (*_rank(motion, brought.support), motion is not own[0]))
        certain = bool(established) or (certain and not any(map(_regular, motions)))
    others = sorted((motion for motion in motions if motion is not chosen), key=_rank)
    if chosen is not own[0]:
        how = "met at this value too" if any(chosen is motion for motion in own) else "found from a neighbouring value"
        text = f"{chosen['evidence']}; {how}, beside {own[0]['kind']} ({own[0]['evidence']})"
        chosen = {**chosen, "evidence": np.array(text)}
    beside = stacked([no_motion(sweep), *(_told(sweep, motion) for motion in others)])
    return {
        **row,
        **_told(sweep, chosen),
        **{f"{OTHER}{name}": array[1:] for name, array in beside.items()},
        "certain": np.array(certain),
    }


def _established(motion: Motion, brought: Arrivals) -> bool:
    """Whether a motion was met often enough to give the kind, at this value and along its branch at others."""
    period = int(motion["period"])
    return gives_kind(period, int(motion["sightings"]) + brought.support.get(period, 0))


def _motions(sweep: Sweep, row: Motion) -> list[Motion]:
    """Motions of a row, the one that gives the kind first; padding is left out."""
    if row["kind"] == FAILED:
        return []
    others = {name: row[f"{OTHER}{name}"] for name in no_motion(sweep)}
    present = [k for k, kind in enumerate(others["kind"]) if kind not in ("", FAILED)]
    return [_told(sweep, row), *_unstacked(others, present)]


def _unstacked(arrays: Mapping[str, np.ndarray], which: Iterable[int]) -> list[Motion]:
    return [{name: array[k] for name, array in arrays.items() if array.ndim and len(array) > k} for k in which]


def _told(sweep: Sweep, motion: Motion) -> Motion:
    return {name: motion[name] for name in no_motion(sweep)}


def _as_regular(motion: Motion, names: np.ndarray) -> Regular:
    named = zip(names, motion["state"], strict=False)  # both may be padded at their ends
    state = {str(name): float(value) for name, value in named if name}
    period = int(motion["period"])
    last = period or 1
    return Regular(
        period,
        int(motion["impacts"]),
        state,
        motion["displacement"][:, -last:],
        motion["velocity"][:, -last:],
        int(motion["sightings"]),
    )


def _regular(motion: Motion) -> bool:
    periodic = motion["period"] > 0 and not motion["exponent"] > NEUTRAL_EXPONENT
    return bool(periodic or motion["kind"] == QUASI_PERIODIC)


def _rank(motion: Motion, confirmed: Container[int] = ()) -> tuple[bool, bool, float, int]:
    """As `calib.dynamics.motion.rank`; what neighbouring values have too is preferred to what one value has alone."""
    period = int(motion["period"])
    return not _regular(motion), period not in confirmed, period or np.inf, int(motion["impacts"])


def _same(one: Motion, other: Motion) -> bool:
    """Whether two rows are of one motion: sections do not distinguish two tori, or two irregular motions."""
    if one["kind"] != other["kind"] or one["impacts"] != other["impacts"]:
        return False
    return not one["period"] or _as_regular(one, NO_NAMES).apart(_as_regular(other, NO_NAMES)) < SAME_MOTION_DISTANCE
