"""The kind of motion that one run of a period map settles to: periodic, quasi-periodic or chaotic."""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from calib.dynamics.contract import PeriodMap
from calib.dynamics.escape import EscapeTime
from calib.dynamics.exponents import ALIGNMENT, Exponent, extended, largest_exponent
from calib.dynamics.orbits import Cycle, attracting_cycle
from calib.dynamics.pseudo_orbit import pseudo_orbit, pseudo_tangent
from calib.dynamics.tangent import jacobian, longest_affordable, tangent
from calib.dynamics.zero_one import zero_one
from calib.errors import CalibError
from calib.modelling.orbit import Orbit
from calib.records import OK
from calib.records.cycles.motion import NO_CONTACT, UNDECIDED

QUASI_PERIODIC, CHAOTIC, FAILED = "quasi-periodic", "chaotic", "failed"

LAGS = 64  # the longest return that is called periodic by its section alone, in periods
CYCLES = 96  # a return after 64 periods is then seen by a third of the cycles
CHUNK = 64  # periods at once while the motion settles
RETURNING = 1e-4  # of its size, within which a motion returns that forgets its last digits by itself
TAIL = 448  # periods of a motion that has not settled after twice as many, which count as its own
CONVERGED = 1e-9  # a motion that returns so well has no transient left; a share of its size, above a map's rounding
TOLERANCE = 1e-6  # how well a periodic motion returns, as a share of its size
NEARBY = 1e-2  # how near a stable cycle has to be, as a share of the motion's size, for a motion to be led to it
REST = 1e-6  # of the map's scale: a smaller motion is at rest, and is measured as if it had this size
TO_GO = 0.05  # how far a motion may yet move, as a share of what tells its period from a shorter one
NEUTRAL = 1e-3  # an exponent that is indistinguishable from zero: some 1/n of a torus over n = 3200 periods  [1/period]
GROWING = 1e-3  # the least exponent of chaos, where the 0-1 test agrees  [1/period]
STEADY = 0.01  # error of an exponent, as a share of it, below which growth is the same in every period
SIGMAS = 3.0  # standard errors that an exponent has to differ from zero by
GROWTH_SIGMAS = 2.0  # standard errors that the exponent of chaos has to be above zero by, where the 0-1 test agrees
REGULAR = 0.2  # K of the 0-1 test below which a series is not chaotic
PERIODS, LONGEST = 400, 3200  # over which the exponent is taken: at first; at most, and for quasi-periodic motion
INTERMITTENT = 25600  # periods over which it is taken where a chaotic section is interrupted by long regular stretches
POINTS = 1000  # of the section for the 0-1 test, at least
PATIENCE = 5  # times `settle` that a motion gets to settle before it is given up as undecided
BLOCKS = 8  # falling maxima of so many blocks of a section are hardly chance: 1 in 8!
DRIFT = 0.02  # by how much they have to fall, or to rise: those of a torus that is all but filled differ by less


@dataclass(frozen=True, eq=False)
class OrbitKind:
    """Kind of the motion that a map settles to from a state, with what tells it.

    Attributes
    ----------
    kind : "no contact" (period-1, at a stop it never touches), "period-1" (2, ...), "quasi-periodic", "chaotic",
        "undecided" or "failed"
    evidence : one sentence with the numbers
    orbit : the kept cycles; of a failed motion, the piece that failed
    state : (dimension,) the last one; of a failed motion, the one that the piece that failed begins with
    dropped : periods before the kept ones
    period : periods of the excitation after which the motion returns, 0 where it does not
    impacts : in one return, the mean rounded where it varies; -1 where it does not return
    exponent : largest one; of a periodic motion from its multipliers; NaN where unknown, -inf where a phase of contact
        wipes all differences out  [1/period]
    error : standard error of the exponent, 0 for a periodic motion  [1/period]
    zero_one : K of the 0-1 test, NaN where it was not needed  [1]
    status, reason : of the orbit
    visited : (n, dimension) states at the section, one a period, by which an irregular motion was judged
    lingers : whether it is undecided because it is yet beside an unstable cycle
    runs, share : from starts that differ imperceptibly, and the share of them that led to this motion; 0 where it was
        found by Newton's method, or from a neighbouring value of a sweep, alone  [1]
    sightings : independent ones of a regular motion, by runs and by Newton's method; 3 are enough for it to be certain
    coexisting : the other motions that were met
    escape : lifetime of the irregular motion that leads to this one or lies beside it; None where there is none
    certain : whether another rounding would have led to the same kind
    run_state : (dimension,) the last state of the run from the given start, which may stay irregular where a stable
        motion beside it gives the kind; None where that is `state`
    """

    kind: str
    evidence: str
    orbit: Orbit
    state: np.ndarray
    dropped: int
    period: int = 0
    impacts: int = -1
    exponent: float = math.nan
    error: float = math.nan
    zero_one: float = math.nan
    status: str = OK
    reason: str = ""
    visited: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    lingers: bool = False
    runs: int = 1
    share: float = 1.0
    sightings: int = 3
    coexisting: tuple["OrbitKind", ...] = ()
    escape: EscapeTime | None = None
    certain: bool = True
    run_state: np.ndarray | None = None

    @property
    def regular(self) -> bool:
        """Whether the motion is a stable periodic or a quasi-periodic one."""
        return self.kind == QUASI_PERIODIC or bool(self.period and not self.exponent > NEUTRAL)

    @property
    def impacts_per_period(self) -> float:
        """Impacts per period of the excitation over the kept cycles, in whole returns; NaN without any cycle."""
        if not len(self.orbit.states):
            return math.nan
        whole = self.period if 0 < self.period <= len(self.orbit.states) else 1
        return _impacts(self.orbit, whole)

    @property
    def contact(self) -> float:
        """Share of the kept cycles spent in permanent contact [1]."""
        return self.orbit.contact

    @property
    def label(self) -> str:
        """Impacts over periods of one return, such as "3/2"; the kind where the motion does not return."""
        return f"{self.impacts}/{self.period}" if self.period else self.kind


def kind_of_run(map: PeriodMap, state: np.ndarray, settle: int = 1000, cycles: int = 100) -> OrbitKind:
    """Say what kind of motion one run settles to from a state.

    1. The transient is dropped: until the state returns after 1..64 periods within 1e-9 of the motion's size, at most
       `settle` periods. A motion that comes ever closer to a stable cycle is taken there by Newton's method.
    2. `cycles` periods are kept. The smallest n = 1..64 after which all of them return within 1e-6 is the period,
       unless the multipliers say that what is left of the transient could still lead to a shorter one.
    3. Otherwise the largest exponent over 400 periods (up to 3200 while it decides nothing, and to 25600 where one of
       the two says chaos) and the 0-1 test on the section have to agree: chaotic above zero, quasi-periodic at zero. A
       motion that still settles is neither; one that returns after more than 64 periods is periodic where its
       multipliers show that it attracts.
    4. What neither says gets 5 times `settle` periods more, pushed off an unstable cycle that it lingers at, and is
       undecided after that.

    A motion that does not return is followed as a pseudo-orbit (`calib.dynamics.pseudo_orbit`), which is the same one
    on all processors though it is chaotic.

    The size of a motion is the largest component of its section in units of the map's scale.

    Parameters
    ----------
    state : (dimension,) to start from
    settle : periods dropped at most before the first verdict
    cycles : periods kept, 96 or more

    Raises
    ------
    CalibError : fewer than 96 cycles
    """
    if cycles < CYCLES:
        raise CalibError(f"expected at least {CYCLES} cycles to keep, got {cycles}; a return after {LAGS} needs them")
    found = settled_orbit(map, state, settle, cycles)
    if found.kind != UNDECIDED:
        return found
    found = _irregular(map, found)
    if found.kind != UNDECIDED or len(found.visited) > INTERMITTENT:
        return found
    start, gone = _beyond_laminar_phase(map, found), found.dropped + cycles
    again = settled_orbit(map, start, PATIENCE * settle, cycles, gone)
    if again.kind == FAILED and start is not found.state:  # pushed to where there is no motion
        again = settled_orbit(map, found.state, PATIENCE * settle, cycles, gone)
    return again if again.kind != UNDECIDED else _irregular(map, again)


def _beyond_laminar_phase(map: PeriodMap, found: OrbitKind) -> np.ndarray:
    """State (dimension,) from which an undecided motion goes on: its own, or off an unstable cycle that it lingers at.

    A run that comes near such a cycle by chance stays for as many periods as 1 / exponent, many times over, and none of
    them tells what motion it belongs to (laminar phase of intermittency: Pomeau and Manneville, Communications in
    Mathematical Physics 74 (1980) 189). It is pushed along the direction that grows most, to the side to which it goes.
    """
    if not found.lingers:
        return found.state
    section = found.visited[-TAIL:] / map.scale
    lag = int(np.argmin(_recurrence(section))) + 1
    grown = tangent(map, found.state, np.ones((found.state.size, 1)), ALIGNMENT + 2 * lag)
    if len(grown.states) < ALIGNMENT + 2 * lag:
        return found.state
    direction, going = grown.vectors[:, 0], (grown.states[-1] - grown.states[-1 - 2 * lag]) / map.scale
    side = -1.0 if going @ direction < 0.0 else 1.0  # after twice the lag, a cycle that flips is on the same side
    return grown.states[-1] + side * NEARBY * _size(section) * direction * map.scale


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
        state, more, before, broken = _converged(map, state, last - dropped)
        dropped += more
        orbit = broken or (_run if before is None else _run_irregular)(map, state, cycles)
        if orbit.status != OK:
            return _failed(orbit, state, dropped)
        found = _periodic(map, state, orbit, dropped)
        if not found.period:
            earlier = [] if before is None else [before]
            found = replace(found, visited=np.concatenate([*earlier, orbit.states]))
        # a chance return ends by itself, and so does rest on an unstable cycle: they get all the time to do so
        if dropped >= last or (found.period and not found.exponent > NEUTRAL):
            return found
        state, dropped = found.state, dropped + cycles


def kind_of_cycle(map: PeriodMap, cycle: Cycle, cycles: int = 100) -> OrbitKind:
    """Kind of the motion of a stable cycle; undecided where rounding drives the map off it."""
    orbit = _run(map, cycle.state, cycles)
    return _periodic(map, cycle.state, orbit, 0) if orbit.status == OK else _failed(orbit, cycle.state, 0)


def _converged(
    map: PeriodMap, state: np.ndarray, periods: int
) -> tuple[np.ndarray, int, np.ndarray | None, Orbit | None]:
    """Go on until the state returns, at most `periods` periods.

    Where the motion comes closer and closer to a stable cycle, what is left of the way is left out.

    Returns
    -------
    the state, the periods gone, the piece that failed; and before that the last states (n, dimension) of a motion that
    does not return after twice as many periods, None of one that does return
    """
    gone, tried, wait, cycle = 0, 0, 0, None
    last: list[np.ndarray] = []
    run = _run_irregular
    while gone < periods:
        orbit = run(map, state, min(CHUNK, periods - gone))
        if orbit.status != OK:
            return state, gone, None, orbit
        gone += len(orbit.states)
        last = [*last[-(TAIL // CHUNK) :], orbit.states]
        section = np.vstack([state, orbit.states]) / map.scale
        back = _largest(section[:-1] - section[-1])[::-1] / _size(section)
        run = _run if back.min() <= RETURNING else _run_irregular
        if back.min() <= CONVERGED:
            return orbit.states[-1], gone, None, None
        if cycle is not None and _approached(section, cycle.state / map.scale, cycle.periods):
            return cycle.state, gone, None, None
        state, cycle, wait = orbit.states[-1], None, wait - 1
        if wait < 0 and (lag := _closing_in(section, back)) and lag <= longest_affordable(map, state):
            cycle = _attracting(map, section, lag)
            tried, wait = tried + 1, 2**tried  # ever seldomer where it is not led there
    if run is _run:
        return state, gone, None, None
    return state, gone, np.concatenate(last)[-TAIL:] if gone >= 2 * TAIL else np.zeros((0, state.size)), None


def _closing_in(section: np.ndarray, back: np.ndarray) -> int:
    """Smallest lag at which a section (n, dimension) returns nearly, and ever better; 0 where it does not.

    back : (n - 1,) difference of the last state from those 1, 2, ... before it, as a share of the motion's size
    """
    near = np.flatnonzero(back[: len(back) // 3] <= NEARBY)
    if not near.size:
        return 0
    lag = int(near[0]) + 1
    returns = _largest(section[lag:] - section[:-lag])
    middle = (len(returns) - lag) // 2
    first, second, third = (returns[start : start + lag].max() for start in (0, middle, len(returns) - lag))
    return lag if third < second < first else 0


def _attracting(map: PeriodMap, section: np.ndarray, lag: int) -> Cycle | None:
    """Stable cycle of `lag` periods beside the end of a section (n, dimension); None where there is none."""
    return attracting_cycle(map, section[-1] * map.scale, lag, NEARBY * _size(section))


def _approached(section: np.ndarray, place: np.ndarray, periods: int) -> bool:
    """Whether a section (n, dimension) that begins beside `place` is closer to it after each third of its returns."""
    distance = _largest(section[::periods] - place)
    thirds = np.linspace(0, len(distance) - 1, 4).astype(int)
    return len(distance) > 3 and bool((np.diff(distance[thirds]) < 0.0).all())


def _run(map: PeriodMap, state: np.ndarray, periods: int) -> Orbit:
    return _finite(map.orbit(state, periods))


def _run_irregular(map: PeriodMap, state: np.ndarray, periods: int) -> Orbit:
    return _finite(pseudo_orbit(map, state, periods))


def _finite(orbit: Orbit) -> Orbit:
    if orbit.status == OK and not np.isfinite(orbit.states).all():
        return orbit._replace(status="diverged", reason="the state is no longer finite")
    return orbit


def _failed(orbit: Orbit, state: np.ndarray, dropped: int) -> OrbitKind:
    text = f"{orbit.status} within {len(orbit.states) + 1} period(s) after {dropped}: {orbit.reason}"
    return OrbitKind(FAILED, text, orbit, state, dropped, status=orbit.status, reason=orbit.reason)


def _periodic(map: PeriodMap, state: np.ndarray, orbit: Orbit, dropped: int) -> OrbitKind:
    """Period of the kept cycles that begin at `state`; undecided where they do not return."""
    section = np.vstack([state, orbit.states]) / map.scale
    recurrence, end = _recurrence(section), orbit.states[-1]
    returning = np.flatnonzero(recurrence <= TOLERANCE)
    if not returning.size:
        return OrbitKind(UNDECIDED, "", orbit, end, dropped)
    n = int(returning[0]) + 1
    radius = _spectral_radius(jacobian(map, end, n)[1])
    # a slow return within the tolerance may yet go far: d, d r, d r^2, ... add up to d / (1 - r)
    to_go = recurrence[n - 1] / max(1.0 - radius, TOLERANCE)
    apart = min((recurrence[m - 1] for m in range(1, n) if n % m == 0), default=math.inf)
    if to_go > TO_GO * apart:
        return OrbitKind(UNDECIDED, "", orbit, end, dropped)
    exponent = math.log(radius) / n if radius != 0.0 else -math.inf
    free = map.impacting and len(orbit.impacts) == 0 and orbit.contact == 0.0
    impacts = round(n * _impacts(orbit, n))
    text = (
        f"returns after {n} period(s) within {recurrence[n - 1]:.1e} of the motion's size over {len(orbit.states)} "
        f"periods, {dropped} dropped; {impacts} impact(s) a return; exponent {exponent:.3g} a period"
    )
    if exponent > NEUTRAL:
        text += ": unstable, the slightest push ends it"
    kind = NO_CONTACT if free and n == 1 else f"period-{n}"
    return OrbitKind(kind, text, orbit, end, dropped, n, impacts, exponent, 0.0)


def _irregular(map: PeriodMap, found: OrbitKind) -> OrbitKind:
    """Call a motion that does not return by its exponent, over ever more periods until it decides, and by K."""
    exponent = largest_exponent(map, found.state, PERIODS, pseudo_tangent)
    while exponent.complete:
        missing = max(1, POINTS - len(found.visited) - len(exponent.states))
        orbit = _run_irregular(map, exponent.states[-1], missing)
        if orbit.status != OK:
            return _failed(orbit, exponent.states[-1], found.dropped + len(exponent.states))
        visited = np.concatenate([found.visited, exponent.states, orbit.states])
        signs = _signs(visited / map.scale, exponent)
        longest = INTERMITTENT if signs.interrupted else LONGEST
        long = _returned(visited / map.scale, RETURNING)
        if long > LAGS and (cycle := _long_cycle(map, found, visited, long)) is not None:
            return cycle
        if signs.kind != UNDECIDED or _shrinking(exponent) or len(exponent.logarithms) >= longest:
            return replace(
                found,
                visited=visited,
                kind=signs.kind,
                evidence=signs.evidence,
                exponent=exponent.value,
                error=exponent.error,
                zero_one=signs.zero_one,
                lingers=signs.lingers,
            )
        exponent = extended(map, exponent, len(exponent.logarithms), pseudo_tangent)
    orbit = _run(map, found.state, len(exponent.states) + 1)
    if orbit.status != OK:
        return _failed(orbit, found.state, found.dropped + len(found.orbit.states))
    return replace(found, evidence="small differences from the orbit fail: no exponent to tell its kind by")


def _long_cycle(map: PeriodMap, found: OrbitKind, visited: np.ndarray, periods: int) -> OrbitKind | None:
    """Motion that returns after more than 64 periods, where its multipliers show that it attracts; None elsewhere."""
    end = visited[-1]
    if periods > longest_affordable(map, end):
        return None
    cycle = attracting_cycle(map, end, periods, NEARBY * _size(visited / map.scale))
    if cycle is None or cycle.periods != periods:
        return None
    orbit = _run(map, cycle.state, len(found.orbit.states))
    if orbit.status != OK:
        return None
    text = (
        f"returns after {periods} period(s), by Newton's method to {cycle.residual:.0e} of the scale, {len(visited)} "
        f"periods seen after {found.dropped}; {cycle.impacts} impact(s) a return; exponent {cycle.exponent:.3g} a "
        "period"
    )
    dropped = found.dropped + len(visited)
    return OrbitKind(
        f"period-{periods}", text, orbit, orbit.states[-1], dropped, periods, cycle.impacts, cycle.exponent, 0.0
    )


@dataclass(frozen=True, eq=False)
class _Signs:
    """What tells the kind of a motion that does not return.

    Attributes
    ----------
    exponent : with its error
    zero_one : K of the section, NaN where the motion plainly settles still
    lag, recurrence : the return that is best, and the largest difference there as a share of the motion's size
    returned : periods after which the end of the section does return, 0 where it does not
    drifting : whether returns become better, or worse, all along the section: the motion is still settling
    likely : period that it is settling to, 0 where that cannot be seen
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
        value, least = self.exponent.value, max(GROWTH_SIGMAS * self.exponent.error, GROWING)
        if self.returned or self.lingers:
            return UNDECIDED
        if value > least and self.zero_one > REGULAR:
            return CHAOTIC
        neutral = abs(value) <= NEUTRAL and len(self.exponent.logarithms) >= LONGEST  # chaos may pause for long
        if neutral and self.zero_one < REGULAR and not self.drifting:
            return QUASI_PERIODIC
        return UNDECIDED

    @property
    def lingers(self) -> bool:
        """Whether the motion is yet beside an unstable cycle: near returns, that grow all along or at a steady rate.

        Chaos of a map whose slope is the same everywhere grows steadily too, but its K is near 1.
        """
        value, error = self.exponent.value, self.exponent.error
        growing = value > SIGMAS * error and self.recurrence <= NEARBY
        return growing and (self.drifting or (error < STEADY * value and not self.zero_one > REGULAR))

    @property
    def interrupted(self) -> bool:
        """Whether the 0-1 test or the exponent says chaos, and the other's error does not exclude it.

        Long regular stretches keep the exponent's error large, and K small.
        """
        highest = self.exponent.value + GROWTH_SIGMAS * self.exponent.error
        signs = self.zero_one > REGULAR or (self.zero_one >= 0.0 and self.exponent.value > GROWING)
        return not self.returned and not self.lingers and signs and highest > GROWING

    @property
    def evidence(self) -> str:
        e = self.exponent
        text = f"exponent {e.value:.3g} +- {e.error:.1g} a period over {len(e.logarithms)} periods"
        if not math.isnan(self.zero_one):
            text += f", K = {self.zero_one:.2f} in the 0-1 test"
        text += f"; best return within {LAGS} periods after {self.lag}: {self.recurrence:.1e} of the motion's size"
        if self.drifting:
            text += ", still settling"
        if self.likely:
            text += f": likely period-{self.likely}"
        elif self.returned:
            text += f"; at the end it returns after {self.returned} period(s)"
        return text


def _signs(section: np.ndarray, exponent: Exponent) -> _Signs:
    """Read the signs of a section (n, dimension) in units of the scale."""
    recurrence = _recurrence(section)
    lag = int(np.argmin(recurrence)) + 1
    maxima = _maxima(section, lag)
    one_way = abs(np.sign(np.diff(maxima)).sum()) == BLOCKS - 1
    drifting = bool(one_way and np.ptp(maxima) > DRIFT * maxima[0])
    settling = _shrinking(exponent) or (drifting and exponent.value <= GROWING)
    return _Signs(
        exponent,
        math.nan if settling else _second_opinion(section[-LONGEST:], lag),
        lag,
        float(recurrence[lag - 1]),
        _returned(section),
        drifting,
        _likely(section, lag, exponent.value) if drifting else 0,
    )


def _returned(section: np.ndarray, within: float = TOLERANCE) -> int:
    """Smallest n, long ones too, after which the last n states of a section return, 0 where there is none.

    within : how well, as a share of the section's extent
    """
    near = within * np.ptp(section, axis=0).max()  # of its spread: a small torus about a cycle is no return to it
    # one state alone comes back by chance, the sooner the longer the section
    for n in np.flatnonzero(_largest(section[:-1] - section[-1])[::-1] <= near) + 1:
        if 2 * n <= len(section) and _largest(section[-n:] - section[-2 * n : -n]).max() <= near:
            return int(n)
    return 0


def _maxima(section: np.ndarray, lag: int) -> np.ndarray:
    """Largest differences (8,) of states `lag` periods apart in 8 blocks of the section."""
    count = (len(section) - lag) // BLOCKS
    return _largest(section[lag:] - section[:-lag])[-count * BLOCKS :].reshape(BLOCKS, count).max(axis=1)


def _likely(section: np.ndarray, lag: int, exponent: float) -> int:
    """Period that a drifting motion is settling to, 0 where its returns do not fall as its exponent says.

    Returns after a multiple of the period fall with the exponent; those that are none fall to what they will be.
    """
    maxima = np.maximum([_maxima(section, n) for n in range(1, lag + 1)], np.finfo(float).tiny)
    fall = np.log(maxima[:, -1] / maxima[:, 0])
    due = exponent * len(section) * (1.0 - 1.0 / BLOCKS)
    if not 2.0 * due < fall[-1] < 0.5 * due < 0.0:
        return 0
    return int(np.flatnonzero(fall <= 0.5 * fall[-1])[0]) + 1


def _shrinking(exponent: Exponent) -> bool:
    return exponent.value < -max(SIGMAS * exponent.error, NEUTRAL)


def _second_opinion(section: np.ndarray, lag: int) -> float:
    """K of the component that moves most, the mean of each of its `lag` bands taken out.

    A chaotic motion that visits bands in turn is a periodic one, which the 0-1 test sees, with a small chaotic one on
    it, which it would miss.
    """
    series = section[:, np.argmax(np.ptp(section, axis=0))].copy()
    for band in range(lag):
        series[band::lag] -= series[band::lag].mean()
    return zero_one(series)


def _recurrence(section: np.ndarray) -> np.ndarray:
    """Differences (64,) of the states (n, dimension) 1..64 periods apart, the largest, as a share of the size."""
    return np.array([np.abs(section[n:] - section[:-n]).max() for n in range(1, LAGS + 1)]) / _size(section)


def _largest(differences: np.ndarray) -> np.ndarray:
    return np.abs(differences).max(axis=1)


def _size(section: np.ndarray) -> float:
    return max(float(np.abs(section).max()), REST)


def _spectral_radius(matrix: np.ndarray) -> float:
    return float(np.abs(np.linalg.eigvals(matrix)).max()) if np.isfinite(matrix).all() else math.nan


def _impacts(orbit: Orbit, period: int) -> float:
    """Impacts per period of the excitation, over the whole returns."""
    whole = len(orbit.states) // period * period
    return float((orbit.impacts[:, 0] < whole).sum()) / whole
