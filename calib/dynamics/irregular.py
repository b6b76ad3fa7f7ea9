"""The kind of a motion that does not return: by its largest Lyapunov exponent and the 0-1 test."""

import math
from dataclasses import dataclass, replace

import numpy as np

from calib.dynamics.exponents import Exponent, extended, largest_exponent
from calib.dynamics.orbit_kind import CHAOTIC, NEUTRAL_EXPONENT, QUASI_PERIODIC, OrbitKind
from calib.dynamics.orbits import attracting_cycle
from calib.dynamics.pseudo_orbit import pseudo_tangent
from calib.dynamics.recurrence import (
    MAX_LAG_PERIODS,
    MIN_DRIFT,
    NEAR_CYCLE_DISTANCE,
    SECTION_BLOCKS,
    block_maxima,
    likely_period,
    recurrence_of,
    returned_after,
    size_of,
)
from calib.dynamics.settling import CONTRACTING_RETURN_DISTANCE, failed, run, run_irregular
from calib.dynamics.tangent import longest_affordable
from calib.dynamics.zero_one import zero_one
from calib.modelling.orbit import PeriodMap
from calib.records import OK
from calib.records.cycles.motion import UNDECIDED

MIN_CHAOTIC_EXPONENT = 1e-3  # where the 0-1 test agrees  [1/period]
MAX_STEADY_ERROR = 0.01  # of an exponent, over the exponent: below it growth is the same in every period
EXPONENT_SIGMAS = 3.0  # standard errors that an exponent has to differ from zero by
GROWTH_SIGMAS = 2.0  # standard errors that the exponent of chaos has to be above zero by, where the 0-1 test agrees
MAX_REGULAR_K = 0.2  # of the 0-1 test: below it a series is not chaotic
FIRST_EXPONENT_PERIODS = 400  # over which the exponent is taken at first
MAX_EXPONENT_PERIODS = 3200  # at most, and for quasi-periodic motion
MAX_INTERMITTENT_PERIODS = 25600  # where long regular stretches interrupt a chaotic section
MIN_SECTION_POINTS = 1000  # for the 0-1 test


def kind_of_irregular(map: PeriodMap, motion: OrbitKind) -> OrbitKind:
    """Decide the kind of a motion that does not return by its exponent, over more periods until it decides, and K."""
    exponent = largest_exponent(map, motion.state, FIRST_EXPONENT_PERIODS, pseudo_tangent)
    while exponent.complete:
        missing = max(1, MIN_SECTION_POINTS - len(motion.visited) - len(exponent.states))
        orbit = run_irregular(map, exponent.states[-1], missing)
        if orbit.status != OK:
            return failed(orbit, exponent.states[-1], motion.dropped + len(exponent.states))
        visited = np.concatenate([motion.visited, exponent.states, orbit.states])
        evidence = _evidence_of(visited / map.scale, exponent)
        longest = MAX_INTERMITTENT_PERIODS if evidence.interrupted else MAX_EXPONENT_PERIODS
        long = returned_after(visited / map.scale, CONTRACTING_RETURN_DISTANCE)
        if long > MAX_LAG_PERIODS and (cycle := _long_cycle(map, motion, visited, long)) is not None:
            return cycle
        if evidence.kind != UNDECIDED or _shrinking(exponent) or len(exponent.logarithms) >= longest:
            return replace(
                motion,
                visited=visited,
                kind=evidence.kind,
                evidence=evidence.evidence,
                exponent=exponent.value,
                error=exponent.error,
                zero_one=evidence.zero_one,
                laminar=evidence.laminar,
            )
        exponent = extended(map, exponent, len(exponent.logarithms), pseudo_tangent)
    orbit = run(map, motion.state, len(exponent.states) + 1)
    if orbit.status != OK:
        return failed(orbit, motion.state, motion.dropped + len(motion.orbit.states))
    return replace(motion, evidence="kind unknown: no Lyapunov exponent, because small differences fail")


def _long_cycle(map: PeriodMap, motion: OrbitKind, visited: np.ndarray, periods: int) -> OrbitKind | None:
    """Motion that returns after more than 64 periods, where its multipliers show that it attracts; None elsewhere."""
    end = visited[-1]
    if periods > longest_affordable(map, end):
        return None
    cycle = attracting_cycle(map, end, periods, NEAR_CYCLE_DISTANCE * size_of(visited / map.scale))
    if cycle is None or cycle.periods != periods:
        return None
    orbit = run(map, cycle.state, len(motion.orbit.states))
    if orbit.status != OK:
        return None
    text = (
        f"returns after {periods} period(s), by Newton's method to {cycle.residual:.0e} of the scale, {len(visited)} "
        f"periods evaluated after {motion.dropped}; {cycle.impacts} impact(s) a return; exponent {cycle.exponent:.3g} "
        "a period"
    )
    dropped = motion.dropped + len(visited)
    return OrbitKind(
        f"period-{periods}", text, orbit, orbit.states[-1], dropped, periods, cycle.impacts, cycle.exponent, 0.0
    )


@dataclass(frozen=True, eq=False)
class _Evidence:
    """Evidence by which the kind of a motion that does not return is decided.

    Attributes
    ----------
    exponent : with its error
    zero_one : K of the section, NaN where the motion plainly settles still
    lag, recurrence : the return that is best, and the largest difference there as a share of the motion's size
    returned : periods after which the end of the section does return, 0 where it does not
    drifting : whether returns become better, or worse, all along the section: the motion is still settling
    likely : period that it is settling to, 0 where it is not identified
    """

    exponent: Exponent
    zero_one: float
    lag: int
    recurrence: float
    returned: int
    drifting: bool
    likely: int

    @property
    def kind(self) -> str:
        value, least = self.exponent.value, max(GROWTH_SIGMAS * self.exponent.error, MIN_CHAOTIC_EXPONENT)
        if self.returned or self.laminar:
            return UNDECIDED
        if value > least and self.zero_one > MAX_REGULAR_K:
            return CHAOTIC
        enough = len(self.exponent.logarithms) >= MAX_EXPONENT_PERIODS  # chaos may pause for long
        neutral = abs(value) <= NEUTRAL_EXPONENT and enough
        if neutral and self.zero_one < MAX_REGULAR_K and not self.drifting:
            return QUASI_PERIODIC
        return UNDECIDED

    @property
    def laminar(self) -> bool:
        """Whether the motion is still near an unstable cycle: close returns that grow all along, or at a steady rate.

        Chaos of a map whose slope is the same everywhere grows steadily too, but its K is near 1.
        """
        value, error = self.exponent.value, self.exponent.error
        growing = value > EXPONENT_SIGMAS * error and self.recurrence <= NEAR_CYCLE_DISTANCE
        return growing and (self.drifting or (error < MAX_STEADY_ERROR * value and not self.zero_one > MAX_REGULAR_K))

    @property
    def interrupted(self) -> bool:
        """Whether the 0-1 test or the exponent indicates chaos, and the error of the other does not exclude it.

        Long regular stretches keep the exponent's error large, and K small.
        """
        highest = self.exponent.value + GROWTH_SIGMAS * self.exponent.error
        signs = self.zero_one > MAX_REGULAR_K or (self.zero_one >= 0.0 and self.exponent.value > MIN_CHAOTIC_EXPONENT)
        return not self.returned and not self.laminar and signs and highest > MIN_CHAOTIC_EXPONENT

    @property
    def evidence(self) -> str:
        e = self.exponent
        text = f"exponent {e.value:.3g} +- {e.error:.1g} a period over {len(e.logarithms)} periods"
        if not math.isnan(self.zero_one):
            text += f", K = {self.zero_one:.2f} in the 0-1 test"
        text += (
            f"; best return within {MAX_LAG_PERIODS} periods after {self.lag}: "
            f"{self.recurrence:.1e} of the motion's size"
        )
        if self.drifting:
            text += ", still settling"
        if self.likely:
            text += f": likely period-{self.likely}"
        elif self.returned:
            text += f"; at the end it returns after {self.returned} period(s)"
        return text


def _evidence_of(section: np.ndarray, exponent: Exponent) -> _Evidence:
    """Evidence from a section (n, dimension) in units of the scale."""
    recurrence = recurrence_of(section)
    lag = int(np.argmin(recurrence)) + 1
    maxima = block_maxima(section, lag)
    one_way = abs(np.sign(np.diff(maxima)).sum()) == SECTION_BLOCKS - 1
    drifting = bool(one_way and np.ptp(maxima) > MIN_DRIFT * maxima[0])
    settling = _shrinking(exponent) or (drifting and exponent.value <= MIN_CHAOTIC_EXPONENT)
    return _Evidence(
        exponent,
        math.nan if settling else _second_opinion(section[-MAX_EXPONENT_PERIODS:], lag),
        lag,
        float(recurrence[lag - 1]),
        returned_after(section),
        drifting,
        likely_period(section, lag, exponent.value) if drifting else 0,
    )


def _shrinking(exponent: Exponent) -> bool:
    return exponent.value < -max(EXPONENT_SIGMAS * exponent.error, NEUTRAL_EXPONENT)


def _second_opinion(section: np.ndarray, lag: int) -> float:
    """K of the component that moves most, the mean of each of its `lag` bands taken out.

    A chaotic motion that visits bands in turn is a periodic one, which the 0-1 test sees, with a small chaotic one on
    it, which it would miss.
    """
    series = section[:, np.argmax(np.ptp(section, axis=0))].copy()
    for band in range(lag):
        series[band::lag] -= series[band::lag].mean()
    return zero_one(series)
