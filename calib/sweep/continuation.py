"""Regular motions continued from one value of a sweep to the next."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import zip_longest
from typing import NamedTuple

import numpy as np

from calib.dynamics.orbit_kind import OrbitKind
from calib.dynamics.orbits import attracting_cycle
from calib.dynamics.recurrence import SAME_MOTION_DISTANCE
from calib.dynamics.settling import kind_of_cycle
from calib.dynamics.single_run import kind_of_run
from calib.dynamics.tangent import longest_affordable
from calib.modelling.orbit import PeriodMap
from calib.sweep.compute import begun, motion_arrays, no_motion, stacked
from calib.sweep.plan import Sweep

MAX_STATE_CHANGE = 0.2  # of a motion from one value to the next, over its largest component
SAME_BRANCH_DISTANCE = 0.05  # relative, of sections of one motion at neighbouring values; period and impacts are equal


class Regular(NamedTuple):
    """A stable periodic or quasi-periodic motion of a value.

    Attributes
    ----------
    period : 0 of a torus
    impacts : of one return
    state : the last one, by component
    displacement, velocity : (body, period) of one return  [m], [m/s]
    sightings : how often it was met independently, at its value and at those along which it came
    """

    period: int
    impacts: int
    state: Mapping[str, float]
    displacement: np.ndarray
    velocity: np.ndarray
    sightings: int = 0

    def apart(self, other: "Regular") -> float:
        """Distance of another motion of the same period, over the largest displacement and velocity.

        0 where a return is longer than the section kept.
        """
        if self.displacement.shape[1] < self.period:
            return 0.0
        apart = []
        for mine, its in ((self.displacement, other.displacement), (self.velocity, other.velocity)):
            size = max(float(np.abs(mine).max()), np.finfo(float).tiny)
            apart.append(np.abs(mine - its[:, -1:]).max(axis=0) / size)
        return float(np.maximum(*apart).min())


class Known(NamedTuple):
    """Motions known at a value before those of its neighbours are continued to it.

    Attributes
    ----------
    regular : its stable motions, of all starts
    settled : whether a run from some start came to one of them
    failed : whether no start led to any motion: the point is passed over
    """

    regular: tuple[Regular, ...]
    settled: bool
    failed: bool


class ContinuationChain(NamedTuple):
    """Neighbouring points, the motions known at each, and those brought from the point before them."""

    points: tuple[int, ...]
    known: tuple[Known, ...]
    brought: tuple[Regular, ...]


def continued(sweep: Sweep, chain: ContinuationChain) -> dict[str, np.ndarray]:
    """Continue the regular motions of each point of a chain to the next.

    A stable cycle goes on by Newton's method; a torus, and a cycle too long for that, by a run from its state where no
    start has led to a regular motion.

    Returns
    -------
    at : (m,) index along the chain at which a motion is new, and the arrays of those motions (m, ...), with the `names`
        of their states' components
    confirmed : (points, n) periods of the motions that came from the point before, known there or not; 0 is a torus, -1
        fills up
    support : (points, n) how often each of these was met along the points before
    """
    at, rows, confirmed, support = [], [_nothing(sweep)], [], []
    brought = chain.brought
    for index, (point, known) in enumerate(zip(chain.points, chain.known, strict=True)):
        staying = [one for one in brought if any(_same_branch(one, other) for other in known.regular)]
        leaving = [one for one in brought if not any(one is other for other in staying)]
        arrived = [(one.period, one.sightings) for one in staying]
        new: list[OrbitKind] = []
        if not known.failed and leaving:
            map = sweep.map_at(point)
            new, further = _taken_on(sweep, map, known, leaving)
            arrived += further
            at += [index] * len(new)
            rows += [{**motion_arrays(sweep, motion), "names": np.array(map.names)} for motion in new]
        confirmed.append([period for period, _ in arrived])
        support.append([sightings for _, sightings in arrived])
        if not known.failed:
            brought = supported((*known.regular, *(regular_of(motion, map) for motion in new)), dict(arrived))
    return {
        "at": np.array(at, dtype=int),
        **{name: array[1:] for name, array in stacked(rows).items()},
        "confirmed": _filled(confirmed, -1),
        "support": _filled(support, 0),
    }


def supported(motions: Sequence[Regular], support: Mapping[int, int]) -> tuple[Regular, ...]:
    """Motions, with the sightings of those of their periods at earlier points added."""
    return tuple(one._replace(sightings=one.sightings + support.get(one.period, 0)) for one in motions)


def _filled(rows: Sequence[Sequence[int]], empty: int) -> np.ndarray:
    """Rows of different lengths as one array (row, n)."""
    return np.array(list(zip_longest(*rows, fillvalue=empty)), dtype=int).reshape(-1, len(rows)).T


def nothing_continued(sweep: Sweep, chain: ContinuationChain) -> dict[str, np.ndarray]:
    """Arrays of a chain whose process died or hung: no motion was continued."""
    count = len(chain.points)
    return {
        "at": np.zeros(0, dtype=int),
        **{name: array[1:] for name, array in stacked([_nothing(sweep)]).items()},
        "confirmed": np.full((count, 0), -1),
        "support": np.zeros((count, 0), dtype=int),
    }


def _nothing(sweep: Sweep) -> dict[str, np.ndarray]:
    return {**no_motion(sweep), "names": np.array([], dtype=str)}


def regular_of(motion: OrbitKind, map: PeriodMap) -> Regular:
    """Return the part of a regular motion that is continued to the next value."""
    last = motion.period or 1
    return Regular(
        motion.period,
        motion.impacts,
        dict(zip(map.names, motion.state.tolist(), strict=True)),
        motion.orbit.displacement[:, -last:],
        motion.orbit.velocity[:, -last:],
        motion.sightings,
    )


def _taken_on(
    sweep: Sweep, map: PeriodMap, known: Known, brought: Sequence[Regular]
) -> tuple[list[OrbitKind], list[tuple[int, int]]]:
    """New motions at this value that those of a neighbour lead to; period and sightings of all that were continued."""
    new: list[OrbitKind] = []
    arrived: list[tuple[int, int]] = []
    for one in sorted(brought, key=lambda regular: regular.period or np.inf):
        motion = _next(sweep, map, one, settled=known.settled or bool(new))
        if motion is None:
            continue
        regular = regular_of(motion, map)
        arrived.append((motion.period, one.sightings))
        if not any(_same(regular, other) for other in (*known.regular, *(regular_of(other, map) for other in new))):
            new.append(motion)
    return new, arrived


def _next(sweep: Sweep, map: PeriodMap, one: Regular, settled: bool) -> OrbitKind | None:
    """Motion at this value that a neighbour's leads to; None without one, and for a torus where a start has settled."""
    state = begun(map, one.state)
    if 0 < one.period <= longest_affordable(map, state):
        size = float(np.abs(state / map.scale).max()) or 1.0
        cycle = attracting_cycle(map, state, one.period, MAX_STATE_CHANGE * size)
        motion = kind_of_cycle(map, cycle, sweep.cycles) if cycle is not None else None
    else:
        motion = None if settled else kind_of_run(map, state, sweep.settle // 2, sweep.cycles)
    return replace(motion, share=0.0, sightings=0) if motion is not None and motion.regular else None


def _same_branch(one: Regular, other: Regular) -> bool:
    """Whether two motions of neighbouring values lie on one branch, as far as their sections show."""
    same_return = (one.period, one.impacts) == (other.period, other.impacts)
    return same_return and (not one.period or one.apart(other) <= SAME_BRANCH_DISTANCE)


def _same(one: Regular, other: Regular) -> bool:
    """Whether two motions of one value are the same; the sections of two tori cannot be distinguished."""
    return one.period == other.period and (not one.period or one.apart(other) < SAME_MOTION_DISTANCE)
