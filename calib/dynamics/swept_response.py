"""The response that a measured sweep would have met: what a sweep of its level and direction runs through.

A sweep begins with the motion that Newton's method finds from rest, or, where that is not stable, with the one that a
run settles to. Where it turns back from the sweep before, the motion may have gone on from there: if it is another one,
the sweep begins with that of the two whose amplitude is nearer to the first measured.

Where the simulator tells its modal system, the motion is followed by harmonic balance as far as that describes it
(`calib.dynamics.swept_series`). Otherwise, at each measured frequency Newton's method begins at what the two before it
extrapolate to; steps are halved where the motion bends, and where it loses its stability or grazes, the point is found
by pseudo-arclength continuation. The sweep goes on with what a run settles to from there.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from itertools import pairwise
from types import MappingProxyType

import numpy as np
import xarray as xr

from calib.dynamics.branch import MAPS_KEPT, Branch, Special, follow
from calib.dynamics.level_curve import level_over_frequency
from calib.dynamics.orbits import shoot
from calib.dynamics.response import (
    AMPLITUDE,
    BEYOND_GRAZING,
    FREQUENCY,
    MAX_SUBHARMONIC,
    harmonics_of_cycle,
    sampled,
)
from calib.dynamics.setting import Setting
from calib.dynamics.settling import settled_orbit
from calib.dynamics.swept_series import SAME_MOTION, SeriesStretch, SeriesSweep, series_sweep
from calib.modelling.model import Model
from calib.modelling.orbit import PeriodMap
from calib.records import OK, failed
from calib.records.excitation import Excitation
from calib.records.response import complex_amplitude, make_response, sweeps

WINDOW_MARGIN = 0.05  # beyond the measured frequencies of a sweep, over their range  [1]
SINGLE_POINT_MARGIN = 0.01  # the same of a single point, over its frequency  [1]
MAX_PIECES = 16  # stable stretches of one sweep
MAX_HALVINGS = 5  # of a step between two frequencies
MAX_BEND = 0.2  # distance of a motion from the extrapolated one, over that from the one before  [1]
NEGLIGIBLE_BEND = 1e-3  # the same over the size of the motion  [1]
MIN_SWEEP_STEP = 0.002  # between two frequencies, over the window  [1]
MAX_END_POINTS = 60  # one way of the curve on which the end of a stretch is found
MAX_TURN_STEPS = 2.0  # from the last frequency of a sweep to the first of the way back, over its mean step  [1]
MAX_TURN_LEVEL_STEP = 0.1  # of the level between those, relative  [1]
MAX_SWEEP_CORRECTIONS = 8  # Newton steps at one frequency

NOT_PERIODIC = "not periodic"  # status of a response one of whose sweeps meets no periodic motion

KnownSweeps = Mapping[float, SeriesStretch]  # by the number of the sweep


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


def swept_response(
    model: Model, values: Mapping[str, float], excitation: Excitation, measured: xr.Dataset
) -> xr.Dataset:
    """Return the response of `swept_curves`, sought without a known one."""
    return swept_curves(model, values, excitation, measured)[0]


def swept_curves(
    model: Model,
    values: Mapping[str, float],
    excitation: Excitation,
    measured: xr.Dataset,
    known: KnownSweeps = MappingProxyType({}),
) -> tuple[xr.Dataset, KnownSweeps]:
    """Response that sweeps of the levels and directions of a measured one run through, beyond its ends by a margin.

    Parameters
    ----------
    values : SI; the nominal value stands in for what they lack
    excitation : its place and quantity count; frequency and level are those of the record
    measured : frequency response, see `calib.records.response`
    known : curves that this function gave for other values: those of these values are sought beside them

    Returns
    -------
    response of the same sweeps, with the points of the continuation, as effects at the site "response" have it
    measured; `piece` (point,) numbers its stable stretches, and the attribute `jumps` says where they end. A sweep ends
    where motions are not periodic; a failed record where none of it is, or nothing could move.
    curves of those sweeps that are one stretch of series

    Raises
    ------
    CalibError : an unknown parameter, or a simulator without a period map that samples its motion
    """
    setting = setting_of_sweeps(model, values, excitation, measured)
    try:
        bodies = sampled(setting, setting.map()).bodies
    except ValueError as error:  # nothing that could move
        return failed(model.bodies, "impossible value", str(error)), {}
    rows: dict[str, list[np.ndarray]] = {key: [] for key in ("frequency", "amplitude", "level", "sweep", "piece")}
    directions, jumps, curves = list[np.ndarray](), list[str](), dict[float, SeriesStretch]()
    for sweep, direction, level, path in swept_paths(setting, bodies, measured, known):
        if path.reason:
            return failed(bodies, NOT_PERIODIC, f"sweep {sweep:g}: {path.reason}"), {}
        if len(path.pieces) == 1 and isinstance(path.pieces[0], SeriesStretch):
            curves[sweep] = path.pieces[0]
        jumps += [f"sweep {sweep:g}: {kind} at {at:.9g} Hz" for kind, at in path.jumps]
        for piece in path.pieces:
            own = piece.frequency
            rows["frequency"].append(own)
            rows["amplitude"].append(harmonics_of_piece(setting, level, piece, 1)[:, :, 1].T)
            rows["level"].append(np.array([level(f) for f in own.tolist()]))
            rows["sweep"].append(np.full(own.size, sweep))
            rows["piece"].append(np.full(own.size, float(len(directions))))
            directions.append(np.full(own.size, direction))
    joined = {key: np.concatenate(parts, axis=-1) for key, parts in rows.items()}
    record = make_response(
        joined["frequency"], bodies, joined["amplitude"], joined["level"], str(measured["level"].attrs["units"]),
        joined["sweep"], np.concatenate(directions), jumps="; ".join(jumps),
        source=f"simulated by {model.simulator.name}", place=excitation.place, quantity=excitation.quantity,
    )  # fmt: skip
    return model.measured_response(record.assign(piece=("point", joined["piece"])), values), curves


def setting_of_sweeps(
    model: Model, values: Mapping[str, float], excitation: Excitation, measured: xr.Dataset
) -> Setting:
    """Return the setting of a model, under the excitation of the first point of a measured response."""
    frequency, level = float(measured["frequency"][0]), float(measured["level"][0])
    return Setting(model, replace(excitation, frequency=frequency, amplitude=level, phase=0.0), values)


def swept_paths(
    setting: Setting, bodies: Sequence[str], measured: xr.Dataset, known: KnownSweeps
) -> Iterator[tuple[float, float, Callable[[float], float], SweptPath]]:
    """Yield number, direction, level over frequency, and path of each sweep.

    Those of the same points are followed once from rest.
    """
    frequency, levels, number = (measured[name].values for name in ("frequency", "level", "sweep"))
    from_rest: dict[tuple[bytes, float], SweptPath] = {}
    passed: dict[float, tuple[SweptPath, float]] = {}  # path and last stop, by the number of the sweep
    for sweep, points in sweeps(measured):
        direction, first = float(measured["direction"][points[0]]), int(points[0])
        level = level_over_frequency(frequency[points], levels[points])
        stops = _stops(frequency[points], direction)
        series, maps = series_sweep(setting, level, stops), partial(_map, setting, level)
        near = known.get(sweep)
        beside = series.beside(near) if series and near else None
        if beside:
            path = SweptPath([beside])
        else:
            asked = _points(frequency[points], levels[points])
            path = from_rest.get((asked, direction)) or _from_rest(
                maps, stops, series, from_rest.get((asked, -direction))
            )
            from_rest[asked, direction] = path
            before, end = passed[number[first - 1]] if _turns_back(measured, first) else (None, 0.0)
            if before and math.isclose(before.pieces[-1].frequency[-1], end):  # it was followed to where it turns
                onward = _gone_on(setting, level, stops, series, path, before)
                distance = partial(_distance, setting, level, float(frequency[first]), _sizes(measured, first, bodies))
                path = min((one for one in (onward, path) if one and one.pieces), key=distance, default=path)
        passed[sweep] = path, float(stops[-1])
        yield sweep, direction, level, path


def _points(frequency: np.ndarray, level: np.ndarray) -> bytes:
    """Frequencies and levels of a sweep, whichever way it passes them."""
    return np.column_stack([frequency, level])[np.lexsort((level, frequency))].tobytes()


def _turns_back(measured: xr.Dataset, first: int) -> bool:
    """Whether a sweep, by its first point, begins the other way where the one before ended, at the level of that."""
    if first == 0:
        return False
    frequency, level, direction = (measured[name].values for name in ("frequency", "level", "direction"))
    before = np.unique(frequency[:first][measured["sweep"].values[:first] == measured["sweep"].values[first - 1]])
    step = np.ptp(before) / max(before.size - 1, 1)
    return bool(
        direction[first] == -direction[first - 1]
        and abs(frequency[first] - frequency[first - 1]) <= MAX_TURN_STEPS * step
        and abs(level[first] / level[first - 1] - 1.0) <= MAX_TURN_LEVEL_STEP
    )


def _from_rest(
    maps: Callable[[float], PeriodMap], stops: np.ndarray, series: SeriesSweep | None, there: SweptPath | None
) -> SweptPath:
    """Path of a sweep from rest, along that of the same points and levels the other way where it is whole."""
    back = None
    if series and there and there.pieces and isinstance(there.pieces[0], SeriesStretch):
        back = series.backward(there.pieces[0])
    return SweptPath([back]) if back else swept_path(maps, stops, series)


def _gone_on(
    setting: Setting,
    level: Callable[[float], float],
    stops: np.ndarray,
    series: SeriesSweep | None,
    rest: SweptPath,
    before: SweptPath,
) -> SweptPath | None:
    """Path that goes on from the last motion of the sweep before; None where that from rest begins with the same."""
    last = before.pieces[-1]
    if rest.pieces and rest.pieces[0].periods == last.periods:
        begin, end = (
            harmonics_of_piece(setting, level, *own)[:, :, 1] for own in ((rest.pieces[0], 1, 0), (last, 1, -1))
        )
        if np.abs(begin - end).max() <= SAME_MOTION * np.abs(end).max():
            return None
    return swept_path(partial(_map, setting, level), stops, series, before.last)


def _sizes(measured: xr.Dataset, point: int, bodies: Sequence[str]) -> dict[int, float]:
    """Amplitude at a measured point by the number of the body  [m]; none of a point that is yet to be measured."""
    sizes = np.abs(complex_amplitude(measured)[:, point]).tolist()
    names = map(str, measured.body.values)
    return {bodies.index(name): size for name, size in zip(names, sizes, strict=True) if name in bodies and size > 0.0}


def _distance(
    setting: Setting, level: Callable[[float], float], frequency: float, sizes: Mapping[int, float], path: SweptPath
) -> float:
    """Distance of a path from amplitudes measured at a frequency [Hz]: logarithms of their ratios  [1]."""
    piece = next((one for one in path.pieces if min(one.frequency) <= frequency <= max(one.frequency)), path.pieces[0])
    order = np.argsort(piece.frequency)
    amplitudes = np.abs(harmonics_of_piece(setting, level, piece, 1)[:, :, 1])[order]
    tiny = np.finfo(float).tiny
    own = {body: float(np.interp(frequency, piece.frequency[order], amplitudes[:, body])) for body in sizes}
    return sum(abs(math.log(max(own[body], tiny) / size)) for body, size in sizes.items())


def _stops(frequency: np.ndarray, direction: float) -> np.ndarray:
    """Frequencies (n,) at which a sweep stops, in its direction: those measured, and one beyond either end."""
    low, high = float(frequency.min()), float(frequency.max())
    margin = WINDOW_MARGIN * (high - low) or SINGLE_POINT_MARGIN * high
    low, high = max(low - margin, 0.5 * low), high + margin
    stops = [low]
    for own in np.unique(frequency).tolist():
        if min(own - stops[-1], high - own) > MIN_SWEEP_STEP * (high - low):
            stops.append(own)
    return np.array([*stops, high])[:: int(direction)]


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


def _map(setting: Setting, level: Callable[[float], float], frequency: float) -> PeriodMap:
    return setting.map({FREQUENCY: frequency, AMPLITUDE: level(frequency)})


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
