"""The kind of motion that a period map settles to, and the motions that coexist with it."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from calib.dynamics.escape import EscapeTime
from calib.dynamics.irregular import MAX_REGULAR_K, MIN_CHAOTIC_EXPONENT
from calib.dynamics.orbit_kind import CHAOTIC, FAILED, QUASI_PERIODIC, OrbitKind
from calib.dynamics.orbits import Cycle, attracting_cycle
from calib.dynamics.pseudo_orbit import pseudo_orbit
from calib.dynamics.recurrence import MIN_DRIFT, NEAR_CYCLE_DISTANCE, SAME_MOTION_DISTANCE, SECTION_BLOCKS
from calib.dynamics.settling import kind_of_cycle, settled_orbit
from calib.dynamics.single_run import kind_of_run
from calib.dynamics.tangent import longest_affordable, tangent
from calib.dynamics.zero_one import MIN_SERIES_POINTS, zero_one
from calib.modelling.orbit import PeriodMap
from calib.records import OK
from calib.records.cycles.motion import UNDECIDED

PERTURBED_RUNS = 6  # from starts that differ by `PERTURBATION`, the given one among them
PERTURBATION = 1e-6  # by which those starts differ, as a share of the map's scale
MAX_SHORT_LAG = 6  # periods; the 6 / n closest returns after n of them are guesses of a stable cycle
PASSAGE_PERIODS = 30  # periods, in which close returns belong to one passage by a cycle
MAX_LONG_LAG, MAX_LONG_LAG_GUESSES = 64, 3  # periods, count: the best three of the returns after longer lags
MAX_RETURN_RATIO = 0.5  # of the distance after a lag to that after a part of the lag, for a return after the lag
MAX_SHIFT = 0.15  # of a close return by Newton's method, over the extent of the motion
MIN_SHIFT = 1e-6  # over the size of the motion: allowed where it has all but returned, and has no extent
MAX_TORUS_K = 0.05  # of the 0-1 test over the kept cycles: below it a run may have come to a quasi-periodic motion
START_UP_PERIODS = 64  # periods in which a run from rest comes to the irregular motion
TRANSIENT_STARTS = 12  # further starts from which a lasting chaotic transient is sought
MIN_TRANSIENT_PERIODS = 32  # in fewer, chaos does not separate starts that differ by `PERTURBATION`
MAX_STRETCHES = 5  # of an irregular motion in which further close returns to a stable motion are sought
MAX_PERIOD_BESIDE_CHAOS = 32  # a section of 64 periods shows a longer return only once, and chaos nearly returns too
MIN_SIGHTINGS = 3  # independent ones of a motion, so that the probability to have missed it, exp(-3), is 5 %


def kind_of_orbit(
    map: PeriodMap,
    state: np.ndarray | None = None,
    settle: int = 1000,
    cycles: int = 100,
    runs: int = PERTURBED_RUNS,
    explore: bool = True,
) -> OrbitKind:
    """Return the kind of the motion that the map settles to from a state, and of those that rounding could lead to.

    A periodic motion of one run (`calib.dynamics.single_run.kind_of_run`), or one that fails, is that, unless the
    transient that led to it is chaotic. Beside any other a stable motion is sought:

    1. Newton's method starts from the 6 / n closest returns of the motion after n = 1..6 periods, and from the three
       closest ones after 7..64. A motion that is not chaotic and comes ever closer to a cycle found so has its kind.
       Where none is found, or one less than three times, they start again from twice `settle` periods more; where one
       is, from up to five such stretches.
    2. Where the motion is irregular, or was until it came to a regular one, `runs` - 1 more runs of half of `settle`
       periods, from starts that differ by 1e-6 of the scale, may leave chaos too.

    The kind is that of a regular motion which was met three times independently, so that another rounding would not
    miss it, and returns after 32 periods at most - of several the one of the shortest period, before a quasi-periodic
    one -, else that of the irregular motion. All others are in `coexisting`; `escape` holds the mean time in which
    runs leave the irregular motion.

    Parameters
    ----------
    state : (dimension,) to start from, None for the map's `initial`
    settle : periods dropped at most before the first verdict of a run
    cycles : periods kept, 96 or more
    runs : from starts that differ imperceptibly, the given one among them
    explore : whether the search goes on where Newton's method has found no stable cycle at first

    Raises
    ------
    CalibError : fewer than 96 cycles
    """
    state = np.asarray(map.initial if state is None else state, dtype=float)
    first = kind_of_run(map, state, settle, cycles)
    by_chance = first.regular and rounding_decides(map, state, first.dropped)
    if first.kind == FAILED or (first.period and not by_chance):
        return first
    observed = _arrival(map, state, first) if by_chance else first.dropped + len(first.visited)
    coexisting = CoexistingMotions(
        map, [ObservedMotion(first, first.orbit.states, 1, MIN_SIGHTINGS if first.regular and not by_chance else 1)]
    )
    if not first.period:
        for cycle in stable_cycles(map, first.visited):
            coexisting.add_cycle(cycle, cycles)
        if first.kind != CHAOTIC and (stable := coexisting.settled_to()) is not None:
            return stable
        if first.regular and not by_chance:
            return coexisting.verdict(1, None)
    if explore and not first.regular:
        _search_longer(coexisting, first.state, 2 * settle, cycles)
    runs = runs if explore or by_chance or _is_interrupted(first) or len(coexisting.motions) > 1 else 1
    more, escapes = _further_runs(coexisting, state, runs - 1, settle // 2, cycles)
    if by_chance and not coexisting.established():
        _search_beside_transient(coexisting, state, 2 * settle if explore else 0, cycles)
    return coexisting.verdict(runs, EscapeTime(observed + more, escapes + int(by_chance)))


def _further_runs(
    coexisting: "CoexistingMotions", state: np.ndarray, runs: int, settle: int, cycles: int
) -> tuple[int, int]:
    """Add the motions of runs from perturbed starts; periods of irregular motion in them, and number that left it."""
    observed, escapes = 0, 0
    for start in perturbed(coexisting.map, state, runs):
        motion, lasted = _member(coexisting.map, start, settle, cycles)
        observed += lasted
        if motion.kind != FAILED:
            escapes += motion.regular
            coexisting.add(motion)
    return observed, escapes


def _search_beside_transient(coexisting: "CoexistingMotions", state: np.ndarray, periods: int, cycles: int) -> None:
    """Add the chaotic motion of a transient from `state`, and the stable ones beside it, sought over `periods`."""
    if coexisting.irregular() is None:
        starts = (
            TRANSIENT_STARTS if all(one.motion.period > MAX_PERIOD_BESIDE_CHAOS for one in coexisting.motions) else 0
        )
        coexisting.add_transient([state, *perturbed(coexisting.map, state, starts)], cycles)
    if periods and (chaos := coexisting.irregular()) is not None:
        _search_longer(coexisting, chaos.motion.state, periods, cycles)


def _search_longer(coexisting: "CoexistingMotions", state: np.ndarray, periods: int, cycles: int) -> None:
    """Start Newton's method from further stretches of the irregular motion until none or enough cycles are found."""
    for _ in range(MAX_STRETCHES):
        if coexisting.established():
            return
        longer = pseudo_orbit(coexisting.map, state, periods)
        for cycle in stable_cycles(coexisting.map, longer.states):
            coexisting.add_cycle(cycle, cycles)
        if longer.status != OK or len(coexisting.motions) == 1:
            return
        state = longer.states[-1]


def perturbed(map: PeriodMap, state: np.ndarray, count: int) -> Iterator[np.ndarray]:
    """Starts (dimension,) that differ from `state` by a share of 1e-6 of the scale, each in another direction."""
    for k in range(1, count + 1):
        yield state + PERTURBATION * map.scale * np.cos(k * np.arange(1.0, state.size + 1.0))


def stable_cycles(map: PeriodMap, visited: np.ndarray) -> Iterator[Cycle]:
    """Stable cycles beside the closest returns of an irregular motion; the same one may come several times.

    Parameters
    ----------
    visited : (n, dimension) its states at the section, one a period

    Source: Auerbach et al., Physical Review Letters 58 (1987) 2387-2389 (close returns as guesses of cycles).
    """
    if len(visited) <= MAX_LONG_LAG:
        return
    section = visited / map.scale
    reach = max(MAX_SHIFT * float(np.ptp(section, axis=0).max()), MIN_SHIFT * float(np.abs(section).max()))
    for lag, at in _closest_returns(section, min(MAX_LONG_LAG, longest_affordable(map, visited[-1]))):
        cycle = attracting_cycle(map, visited[at], lag, reach)
        if cycle is not None:
            yield cycle


def _closest_returns(section: np.ndarray, longest: int = MAX_LONG_LAG) -> list[tuple[int, int]]:
    """Lag and index of the returns of a section (n, dimension) that Newton's method starts from.

    A state beside a cycle of a part of the lag returns after that part already, and is no guess of a longer one.
    """
    apart = [np.abs(section[lag:] - section[:-lag]).max(axis=1) for lag in range(1, longest + 1)]
    short, long = list[tuple[float, int, int]](), list[tuple[float, int, int]]()
    for lag, distance in enumerate(apart, 1):
        parts = [apart[part - 1][: distance.size] for part in range(1, lag) if lag % part == 0]
        later = np.any([distance >= MAX_RETURN_RATIO * part for part in parts], axis=0) if parts else False
        distance = np.where(later, np.inf, distance)
        for _ in range(max(1, MAX_SHORT_LAG // lag)):  # so that each lag costs as much
            at = int(np.argmin(distance))
            if distance[at] < np.inf:
                (short if lag <= MAX_SHORT_LAG else long).append((float(distance[at]), lag, at))
                distance[max(0, at - PASSAGE_PERIODS) : at + PASSAGE_PERIODS] = np.inf
    return [(lag, at) for _, lag, at in (*short, *sorted(long)[:MAX_LONG_LAG_GUESSES])]


def _member(map: PeriodMap, start: np.ndarray, settle: int, cycles: int) -> tuple[OrbitKind, int]:
    """Motion that a further run comes to, undecided where it stays irregular; and how long it was irregular."""
    cycles = max(cycles, MIN_SERIES_POINTS)
    motion = settled_orbit(map, start, settle, cycles)
    if motion.kind == FAILED or motion.regular:
        return motion, _arrival(map, start, motion)
    lasted = motion.dropped + cycles
    later = settled_orbit(map, motion.state, 0, cycles)  # it may have left within the cycles that were kept
    if later.kind == FAILED or later.regular:
        return later, lasted
    section = motion.orbit.states / map.scale
    if zero_one(section[:, np.argmax(np.ptp(section, axis=0))]) < MAX_TORUS_K:
        torus = kind_of_run(map, motion.state, 0, cycles)
        if torus.regular:
            return torus, lasted
    return motion, lasted


def _arrival(map: PeriodMap, start: np.ndarray, settled: OrbitKind) -> int:
    """Periods after which a run from a state stays beside the motion that it settles to; those dropped, of a torus."""
    if not (settled.period and settled.dropped):
        return settled.dropped
    states = pseudo_orbit(map, start, settled.dropped).states
    returns = settled.orbit.states[-settled.period :]
    apart = np.min([np.abs((states - own) / map.scale).max(axis=1) for own in returns], axis=0)
    far = np.flatnonzero(apart > NEAR_CYCLE_DISTANCE * float(np.abs(returns / map.scale).max()))
    return int(far[-1]) + 1 if far.size else 0


@dataclass(eq=False)
class ObservedMotion:
    """A motion with its sightings.

    Attributes
    ----------
    states : (n, dimension) of it at the section
    runs : that led to it
    sightings : by runs, and by Newton's method from different returns; enough of a motion that no rounding could miss
    """

    motion: OrbitKind
    states: np.ndarray
    runs: int
    sightings: int


@dataclass(eq=False)
class CoexistingMotions:
    """The motions observed on one map; that of the first run comes first."""

    map: PeriodMap
    motions: list[ObservedMotion]

    def add(self, motion: OrbitKind) -> None:
        """Count the motion of a run; one that has not settled counts only where it is chaotic."""
        known = self.irregular()
        if not motion.regular and (known is None or _is_interrupted(known.motion)):
            motion = kind_of_run(self.map, motion.state, 0, len(motion.orbit.states))
            if motion.kind == CHAOTIC and known is not None:  # another stretch decides
                known.motion = motion
        one = self._known(motion.kind, motion.period, motion.state) if motion.regular else known
        if one is None and motion.kind != CHAOTIC and not motion.regular:
            return
        if one is None:
            self.motions.append(ObservedMotion(motion, motion.orbit.states, 1, 1))
        else:
            one.runs += 1
            one.sightings += 1

    def add_cycle(self, cycle: Cycle, cycles: int) -> None:
        """Count a stable cycle that Newton's method found, unless rounding ends its motion."""
        one = self._known(f"period-{cycle.periods}", cycle.periods, cycle.state)
        if one is not None:
            one.sightings += 1
            return
        motion = kind_of_cycle(self.map, cycle, cycles)
        if motion.regular:
            self.motions.append(ObservedMotion(motion, motion.orbit.states, 0, 1))

    def _known(self, kind: str, period: int, state: np.ndarray) -> ObservedMotion | None:
        return next((one for one in self.motions if self._same(one, kind, period, state)), None)

    def add_transient(self, starts: Iterable[np.ndarray], cycles: int) -> None:
        """Add the motion on which the first of the runs was at first whose transient lasts long enough to be chaotic.

        No run has stayed on it.
        """
        for start in starts:
            begun = kind_of_run(self.map, start, START_UP_PERIODS, cycles)
            if begun.kind == CHAOTIC:
                self.motions.append(ObservedMotion(begun, begun.orbit.states, 0, 0))
                return

    def established(self) -> list[ObservedMotion]:
        """Regular motions with enough sightings that another rounding would not miss them, and that a section shows."""
        return [one for one in self.motions if one.motion.regular and gives_kind(one.motion.period, one.sightings)]

    def irregular(self) -> ObservedMotion | None:
        """The irregular motion; None where there is none."""
        return next((one for one in self.motions if not one.motion.regular), None)

    def _same(self, one: ObservedMotion, kind: str, period: int, state: np.ndarray) -> bool:
        if kind == QUASI_PERIODIC:  # a section does not tell two tori apart
            return one.motion.kind == kind
        if one.motion.period != period:
            return False
        apart = np.abs((one.states[-period:] - state) / self.map.scale)
        return bool(apart.max(axis=1).min() < SAME_MOTION_DISTANCE)

    def settled_to(self) -> OrbitKind | None:
        """Stable cycle that the first run, which has not returned, comes ever closer to; None where it does not."""
        first, *cycles = self.motions
        for one in sorted(cycles, key=lambda one: rank(one.motion)):
            if self._settles_to(first.motion.visited, one.motion):
                gone = first.motion.dropped + len(first.motion.visited)
                text = f"{one.motion.evidence}; a run comes closer to it for {gone} periods and has not reached it"
                return replace(one.motion, evidence=text, dropped=gone)
        return None

    def _settles_to(self, visited: np.ndarray, cycle: OrbitKind) -> bool:
        """Whether states at the section (n, dimension) come closer to a cycle from each of 8 blocks to the next."""
        returns = cycle.orbit.states[-cycle.period :]
        nearest = returns[np.argmin(np.abs((returns - visited[-1]) / self.map.scale).max(axis=1))]
        apart = np.abs((visited[:: -cycle.period] - nearest) / self.map.scale).max(axis=1)
        if len(apart) < SECTION_BLOCKS:
            return False
        back = np.array([block.max() for block in np.array_split(apart, SECTION_BLOCKS)])
        return bool((np.diff(back) > 0.0).all() and np.ptp(back) > MIN_DRIFT * back.max())

    def verdict(self, runs: int, escape: EscapeTime | None) -> OrbitKind:
        """Return the most regular motion with enough sightings, else the irregular one, with all others as coexisting.

        escape : from the irregular motion that runs stayed on at first; None where there is none
        """
        first = self.motions[0]
        established = self.established()
        if established:
            chosen = min(established, key=lambda one: rank(one.motion))
        else:
            chosen = self.irregular() or max(self.motions, key=lambda one: one.sightings)
        others = sorted((one for one in self.motions if one is not chosen), key=lambda one: rank(one.motion))
        text = chosen.motion.evidence
        if others:
            text += f"; {chosen.runs} of {runs} runs lead to it, from starts {PERTURBATION:.0e} of the scale apart"
            text += "" if chosen is first else f", the first is {first.motion.kind}"
        if escape and (escape.escapes or first.motion.kind == CHAOTIC):
            text += f"; {escape}"
        alone = len(self.motions) == 1 and first.motion.kind != UNDECIDED
        return replace(
            chosen.motion,
            evidence=text,
            runs=runs,
            share=chosen.runs / runs,
            sightings=chosen.sightings,
            coexisting=tuple(
                replace(one.motion, runs=runs, share=one.runs / runs, sightings=one.sightings) for one in others
            ),
            escape=escape,
            certain=bool(established) or alone,
            run_state=None if chosen is first else first.motion.state,
        )


def gives_kind(period: int, sightings: int) -> bool:
    """Whether a regular motion beside chaos gives the kind: three sightings, and a period that a section shows.

    period : 0 of a quasi-periodic one
    """
    return sightings >= MIN_SIGHTINGS and period <= MAX_PERIOD_BESIDE_CHAOS


def _is_interrupted(motion: OrbitKind) -> bool:
    """Whether a motion is undecided because long regular stretches interrupt what else looks like chaos."""
    return motion.kind == UNDECIDED and motion.zero_one > MAX_REGULAR_K and motion.exponent > MIN_CHAOTIC_EXPONENT


def rank(motion: OrbitKind) -> tuple[bool, float, int]:
    """Order of preference where rounding decides: the shortest stable period, a torus, an irregular motion."""
    return not motion.regular, motion.period or math.inf, motion.impacts


def rounding_decides(map: PeriodMap, state: np.ndarray, dropped: int) -> bool:
    """Whether starts that differ by 1e-6 of the scale separate on the way to a motion: its transient is chaotic.

    Parameters
    ----------
    state : (dimension,) to start from
    dropped : length of the transient  [periods]
    """
    if dropped < MIN_TRANSIENT_PERIODS:
        return False
    growth = tangent(map, state, np.ones((state.size, 1)), dropped).growth[:, 0, 0]
    with np.errstate(divide="ignore"):
        return bool(np.cumsum(np.log(growth)).max(initial=0.0) > math.log(MAX_SHIFT / PERTURBATION))
