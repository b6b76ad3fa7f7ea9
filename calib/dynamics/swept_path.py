"""The path of one sweep: the stable stretches that it runs through one after another, and where it leaves each.

A sweep begins with the motion that Newton's method finds from rest, or, where that is not stable, with the one that a
run settles to. Where the simulator tells its modal system, the motion is followed by harmonic balance as far as that
describes it (`calib.dynamics.swept_series`). Otherwise, at each measured frequency Newton's method begins at what the
two before it extrapolate to; steps are halved where the motion bends, and where it loses its stability or grazes, the
point is found by pseudo-arclength continuation. The sweep goes on with what a run settles to from there.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise

import numpy as np

from calib.dynamics.branch import MAPS_KEPT, Branch, Special, follow
from calib.dynamics.orbits import shoot
from calib.dynamics.response import BEYOND_GRAZING, MAX_SUBHARMONIC, harmonics_of_cycle
from calib.dynamics.setting import Setting
from calib.dynamics.settling import settled_orbit
from calib.dynamics.swept_series import SeriesStretch, SeriesSweep
from calib.modelling.orbit import PeriodMap
from calib.records import OK

MAX_PIECES = 16  # stable stretches of one sweep
MAX_HALVINGS = 5  # of a step between two frequencies
MAX_BEND = 0.2  # distance of a motion from the extrapolated one, over that from the one before  [1]
NEGLIGIBLE_BEND = 1e-3  # the same over the size of the motion  [1]
MAX_END_POINTS = 60  # one way of the curve on which the end of a stretch is found
MAX_SWEEP_CORRECTIONS = 8  # Newton steps at one frequency


@dataclass(frozen=True, eq=False)
class Piece:
    """A stable stretch of one branch in the order swept, m cycles.

    frequency (m,) [Hz]; states (m, dimension) of the section; periods of one return
    """

    frequency: np.ndarray
    states: np.ndarray
    periods: int


@dataclass
class SweptPath:
    """Stretches that a sweep runs through, and what ends them.

    Attributes
    ----------
    pieces : in the order swept
    jumps : kind of the point and its frequency [Hz] at which each stretch but the last is left
    reason : why nothing was followed, or ""
    """

    pieces: list[Piece | SeriesStretch] = field(default_factory=list)
    jumps: list[tuple[str, float]] = field(default_factory=list)
    reason: str = ""

    @property
    def last(self) -> tuple[np.ndarray, int]:
        """State (dimension,) of the section at the last motion, and its period."""
        piece = self.pieces[-1]
        return piece.last if isinstance(piece, SeriesStretch) else piece.states[-1], piece.periods


def swept_path(
    maps: Callable[[float], PeriodMap],
    stops: np.ndarray,
    series: SeriesSweep | None = None,
    begin: tuple[np.ndarray, int] | None = None,
) -> SweptPath:
    """Path of a sweep.

    maps : the map at a frequency
    stops : frequencies (n,), n >= 2, that rise or fall  [Hz]
    series : harmonic balance over them, where it serves the simulator
    begin : state (dimension,) of the section and period of the motion with which it begins; None from rest
    """
    return _Sweep(maps, stops, series, begin).path


class _Sweep:
    """A sweep on its way."""

    def __init__(
        self,
        maps: Callable[[float], PeriodMap],
        stops: np.ndarray,
        series: SeriesSweep | None,
        begin: tuple[np.ndarray, int] | None,
    ) -> None:
        self.maps, self.stops, self.path = lru_cache(MAPS_KEPT)(maps), stops, SweptPath()
        self.series = series
        self.direction, self.width = float(np.sign(stops[-1] - stops[0])), float(np.ptp(stops))
        found = self._begin(float(stops[0])) if begin is None else self._begun(float(stops[0]), *begin)
        while found is not None and len(self.path.pieces) < MAX_PIECES:
            found = self._stretch(*found)
        if self.path.pieces:
            self.path.reason = ""

    def _begin(self, frequency: float) -> tuple[float, np.ndarray, int] | None:
        first = None if self.series is None else self.series.first(frequency)
        if first is not None:
            return frequency, first, 1
        map = self.maps(frequency)
        cycle = shoot(map, map.initial)
        if cycle.converged and cycle.stable:
            return frequency, cycle.state, 1
        return self._settled(frequency, map.initial)

    def _begun(self, frequency: float, state: np.ndarray, periods: int) -> tuple[float, np.ndarray, int] | None:
        """Begin with the stable motion of this period at a state; None where there is none."""
        cycle = shoot(self.maps(frequency), state, periods)
        return (frequency, cycle.state, periods) if cycle.converged and cycle.stable else None

    def _settled(self, frequency: float, state: np.ndarray) -> tuple[float, np.ndarray, int] | None:
        """Go on to the next frequency at which a run settles to a periodic motion; None where there is none."""
        while self.direction * (self.stops[-1] - frequency) >= 0.0:
            motion = settled_orbit(self.maps(frequency), state)
            if motion.status != OK:
                self.path.reason = f"the motion at {frequency:.6g} Hz fails ({motion.evidence})"
                return None
            if 0 < motion.period <= MAX_SUBHARMONIC:
                return frequency, motion.state, motion.period
            self.path.reason = (
                f"the motion at {frequency:.6g} Hz does not repeat after 1 to {MAX_SUBHARMONIC} periods, "
                f"{motion.dropped} periods after it was reached"
            )
            ahead = self._next_stop(frequency)
            if ahead is None:
                return None
            frequency, state = ahead, motion.state
        return None

    def _next_stop(self, frequency: float) -> float | None:
        ahead = self.stops[self.direction * (self.stops - frequency) > 0.0]
        return float(ahead[0]) if ahead.size else None

    def _stretch(self, frequency: float, state: np.ndarray, periods: int) -> tuple[float, np.ndarray, int] | None:
        """Follow a stable motion to its end; return from where the sweep goes on, None at the end of the window."""
        stretch = None if self.series is None or periods > 1 else self.series.stretch(frequency, state)
        if stretch is not None:
            self.path.pieces.append(stretch)
            return self._jumped(stretch.end, float(stretch.frequency[-1]), stretch.last) if stretch.end else None
        known, states = [frequency], [state]
        while (stop := self._next_stop(known[-1])) is not None:
            for halving in range(MAX_HALVINGS + 1):
                ahead = known[-1] + 0.5**halving * (stop - known[-1])
                reached = self._reached(ahead, known, states, periods)
                if reached is not None:
                    known.append(ahead)
                    states.append(reached)
                    break
            else:
                return self._ended(known, states, periods)
        self.path.pieces.append(Piece(np.array(known), np.array(states), periods))
        return None

    def _reached(self, ahead: float, known: list[float], states: list[np.ndarray], periods: int) -> np.ndarray | None:
        """Stable motion at a frequency, on the branch of those before; None where it is not reached in one step."""
        map, guess = self.maps(ahead), states[-1]
        if len(known) > 1:
            guess = guess + (ahead - known[-1]) / (known[-1] - known[-2]) * (states[-1] - states[-2])
        cycle = shoot(map, guess, periods, MAX_SWEEP_CORRECTIONS)
        if not (cycle.converged and cycle.stable):
            return None
        bend, moved, size = (np.abs(x / map.scale).max() for x in (
            cycle.state - guess, cycle.state - states[-1], cycle.state))  # fmt: skip
        straight = len(known) == 1 or bend <= MAX_BEND * moved + NEGLIGIBLE_BEND * size
        return cycle.state if straight else None

    def _ended(
        self, known: list[float], states: list[np.ndarray], periods: int
    ) -> tuple[float, np.ndarray, int] | None:
        """Find the point at which a stretch ends, and what the sweep goes on with beyond it."""
        at, state = known[-1], states[-1]
        reach = self.width / len(self.stops)
        extent = max(1.0, float(np.abs(state / self.maps(at).scale).max()))
        branch = follow(self.maps, state, at, (at - reach, at + reach), periods, MAX_END_POINTS, extent)
        kind, onward = "loss", _onward(branch, at, self.direction)
        for before, index in pairwise(onward.tolist()):
            special = next((point for point in branch.points if point.index in (before, index)), None)
            if special is None and branch.stable[index]:
                known.append(float(branch.parameter[index]))
                states.append(branch.states[index])
                continue
            break
        special = _first_special(branch, onward)
        if special is not None and self.direction * (special.parameter - known[-1]) >= 0.0:
            kind = special.kind
            known.append(special.parameter)
            states.append(special.state)
        self.path.pieces.append(Piece(np.array(known), np.array(states), branch.periods))
        if special is None and onward.size > 1 and branch.stable[onward].all():
            return known[-1], states[-1], branch.periods  # it only bends: on from there
        return self._jumped(kind, known[-1], states[-1])

    def _jumped(self, kind: str, frequency: float, state: np.ndarray) -> tuple[float, np.ndarray, int] | None:
        """Go on beyond the end of a stretch with what a run settles to."""
        self.path.jumps.append((kind, frequency))
        return self._settled(frequency + self.direction * BEYOND_GRAZING * self.width, state)


def _first_special(branch: Branch, onward: np.ndarray) -> Special | None:
    """Point that a sweep meets first along a curve."""
    place = {index: i for i, index in enumerate(onward.tolist())}
    met = [point for point in branch.points if point.index in place]
    return min(met, key=lambda point: place[point.index], default=None)


def _onward(branch: Branch, frequency: float, direction: float) -> np.ndarray:
    """Places of a curve's points from where it was begun, in the direction of the sweep."""
    if not branch.parameter.size:
        return np.zeros(0, dtype=int)
    begin = int(np.argmin(np.abs(branch.parameter - frequency)))
    for order in (np.arange(begin, branch.parameter.size), np.arange(begin, -1, -1)):
        if len(order) > 1 and direction * (branch.parameter[order[1]] - branch.parameter[begin]) > 0.0:
            return order
    return np.array([begin])


def harmonics_of_piece(
    setting: Setting, level: Callable[[float], float], piece: Piece | SeriesStretch, highest: int, at: int | None = None
) -> np.ndarray:
    """Complex amplitudes (m, body, highest + 1) of the displacement of a stretch, or of its motion `at`  [m].

    highest : harmonic, at most the lowest of `calib.dynamics.swept_series.SERIES_HARMONICS`
    """
    chosen = slice(None) if at is None else [at]
    if isinstance(piece, SeriesStretch):
        return piece.harmonics[chosen, :, : highest + 1]
    pairs = zip(piece.frequency[chosen].tolist(), piece.states[chosen], strict=True)
    return np.array([harmonics_of_cycle(setting, piece.periods, highest, f, level(f), x)[0] for f, x in pairs])
