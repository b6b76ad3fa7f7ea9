"""One run of a period map: its transient dropped, and its kept cycles tested for their return."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from calib.dynamics.orbit_kind import FAILED, NEUTRAL_EXPONENT, OrbitKind, mean_impacts
from calib.dynamics.orbits import Cycle, attracting_cycle
from calib.dynamics.pseudo_orbit import pseudo_orbit
from calib.dynamics.recurrence import (
    NEAR_CYCLE_DISTANCE,
    RETURN_TOLERANCE,
    approaches,
    closing_in,
    largest,
    recurrence_of,
    size_of,
)
from calib.dynamics.tangent import jacobian, longest_affordable
from calib.modelling.orbit import Orbit, PeriodMap
from calib.records import OK
from calib.records.cycles.motion import NO_CONTACT, UNDECIDED

SETTLING_CHUNK_PERIODS = 64  # periods at once while the motion settles
CONTRACTING_RETURN_DISTANCE = 1e-4  # of the motion's size: one that returns so well forgets its last digits by itself
TAIL_PERIODS = 448  # last ones of a motion that has not settled after twice as many, which count as its own
CONVERGED_RETURN_DISTANCE = 1e-9  # of the motion's size, above a map's rounding: no transient is left
MAX_REMAINING_MOTION = 0.05  # of a transient, over the distance that distinguishes its period from a shorter one


def settled_orbit(
    map: PeriodMap, state: np.ndarray, settle: int = 1000, cycles: int = 100, dropped: int = 0
) -> OrbitKind:
    """Drop at most `settle` periods and keep `cycles`; a motion that does not return then is undecided.

    Parameters
    ----------
    state : (dimension,) to start from
    dropped : periods that were dropped before
    """
    last = dropped + settle
    while True:
        settled = _converged(map, state, last - dropped)
        state, dropped, before = settled.state, dropped + settled.periods, settled.tail
        orbit = settled.broken or (run if before is None else run_irregular)(map, state, cycles)
        if orbit.status != OK:
            return failed(orbit, state, dropped)
        motion = _periodic(map, state, orbit, dropped)
        if not motion.period:
            earlier = [] if before is None else [before]
            motion = replace(motion, visited=np.concatenate([*earlier, orbit.states]))
        # a chance return ends by itself, and so does rest on an unstable cycle: they get all the time to do so
        if dropped >= last or (motion.period and not motion.exponent > NEUTRAL_EXPONENT):
            return motion
        state, dropped = motion.state, dropped + cycles


def kind_of_cycle(map: PeriodMap, cycle: Cycle, cycles: int = 100) -> OrbitKind:
    """Kind of the motion of a stable cycle; undecided where rounding drives the map off it."""
    orbit = run(map, cycle.state, cycles)
    return _periodic(map, cycle.state, orbit, 0) if orbit.status == OK else failed(orbit, cycle.state, 0)


class _Settled(NamedTuple):
    """Where a transient ends.

    Attributes
    ----------
    state : (dimension,) the last one
    periods : dropped
    tail : (n, dimension) last states of a motion that does not return after twice as many periods; None of one that
        does return, or fails
    broken : the piece that failed; None where none did
    """

    state: np.ndarray
    periods: int
    tail: np.ndarray | None = None
    broken: Orbit | None = None


def _converged(map: PeriodMap, state: np.ndarray, periods: int) -> _Settled:
    """Go on until the state returns, at most `periods` periods.

    Where the motion comes closer and closer to a stable cycle, the remaining transient is left out.
    """
    gone, tried, wait, cycle = 0, 0, 0, None
    last: list[np.ndarray] = []
    go_on = run_irregular
    while gone < periods:
        orbit = go_on(map, state, min(SETTLING_CHUNK_PERIODS, periods - gone))
        if orbit.status != OK:
            return _Settled(state, gone, broken=orbit)
        gone += len(orbit.states)
        last = [*last[-(TAIL_PERIODS // SETTLING_CHUNK_PERIODS) :], orbit.states]
        section = np.vstack([state, orbit.states]) / map.scale
        back = largest(section[:-1] - section[-1])[::-1] / size_of(section)
        go_on = run if back.min() <= CONTRACTING_RETURN_DISTANCE else run_irregular
        if back.min() <= CONVERGED_RETURN_DISTANCE:
            return _Settled(orbit.states[-1], gone)
        if cycle is not None and approaches(section, cycle.state / map.scale, cycle.periods):
            return _Settled(cycle.state, gone)
        state, cycle, wait = orbit.states[-1], None, wait - 1
        if wait < 0 and (lag := closing_in(section, back)) and lag <= longest_affordable(map, state):
            cycle = _attracting(map, section, lag)
            tried, wait = tried + 1, 2**tried  # ever seldomer where it is not led there
    if go_on is run:
        return _Settled(state, gone)
    tail = np.concatenate(last)[-TAIL_PERIODS:] if gone >= 2 * TAIL_PERIODS else np.zeros((0, state.size))
    return _Settled(state, gone, tail)


def _attracting(map: PeriodMap, section: np.ndarray, lag: int) -> Cycle | None:
    """Stable cycle of `lag` periods beside the end of a section (n, dimension); None where there is none."""
    return attracting_cycle(map, section[-1] * map.scale, lag, NEAR_CYCLE_DISTANCE * size_of(section))


def run(map: PeriodMap, state: np.ndarray, periods: int) -> Orbit:
    """Go on from a state (dimension,); an orbit that is no longer finite has diverged."""
    return _finite(map.orbit(state, periods))


def run_irregular(map: PeriodMap, state: np.ndarray, periods: int) -> Orbit:
    """Go on from a state (dimension,) along the pseudo-orbit, which is the same one on all processors."""
    return _finite(pseudo_orbit(map, state, periods))


def _finite(orbit: Orbit) -> Orbit:
    if orbit.status == OK and not np.isfinite(orbit.states).all():
        return orbit._replace(status="diverged", reason="the state is no longer finite")
    return orbit


def failed(orbit: Orbit, state: np.ndarray, dropped: int) -> OrbitKind:
    """Describe a motion whose piece from `state` (dimension,) on, after `dropped` periods, failed."""
    text = f"{orbit.status} within {len(orbit.states) + 1} period(s) after {dropped}: {orbit.reason}"
    return OrbitKind(FAILED, text, orbit, state, dropped, status=orbit.status, reason=orbit.reason)


def _periodic(map: PeriodMap, state: np.ndarray, orbit: Orbit, dropped: int) -> OrbitKind:
    """Period of the kept cycles that begin at `state`; undecided where they do not return."""
    section = np.vstack([state, orbit.states]) / map.scale
    recurrence, end = recurrence_of(section), orbit.states[-1]
    returning = np.flatnonzero(recurrence <= RETURN_TOLERANCE)
    if not returning.size:
        return OrbitKind(UNDECIDED, "", orbit, end, dropped)
    n = int(returning[0]) + 1
    radius = _spectral_radius(jacobian(map, end, n)[1])
    # a slow return within the tolerance may yet go far: d, d r, d r^2, ... add up to d / (1 - r)
    to_go = recurrence[n - 1] / max(1.0 - radius, RETURN_TOLERANCE)
    apart = min((recurrence[m - 1] for m in range(1, n) if n % m == 0), default=math.inf)
    if to_go > MAX_REMAINING_MOTION * apart:
        return OrbitKind(UNDECIDED, "", orbit, end, dropped)
    exponent = math.log(radius) / n if radius != 0.0 else -math.inf
    free = map.impacting and len(orbit.impacts) == 0 and orbit.contact == 0.0
    impacts = round(n * mean_impacts(orbit, n))
    text = (
        f"returns after {n} period(s) within {recurrence[n - 1]:.1e} of the motion's size over {len(orbit.states)} "
        f"periods, {dropped} dropped; {impacts} impact(s) a return; exponent {exponent:.3g} a period"
    )
    if exponent > NEUTRAL_EXPONENT:
        text += ": unstable, the slightest push ends it"
    kind = NO_CONTACT if free and n == 1 else f"period-{n}"
    return OrbitKind(kind, text, orbit, end, dropped, n, impacts, exponent, 0.0)


def _spectral_radius(matrix: np.ndarray) -> float:
    return float(np.abs(np.linalg.eigvals(matrix)).max()) if np.isfinite(matrix).all() else math.nan
