"""The paths of the sweeps of a measured response: what a sweep of each level and direction runs through.

Where a sweep turns back from the one before, the motion may have gone on from there: if it is another one than a sweep
from rest meets, the sweep begins with that of the two whose amplitude is nearer to the first measured.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial

import numpy as np
import xarray as xr

from calib.dynamics.held_curve import HeldBranch
from calib.dynamics.level_curve import LevelCurve
from calib.dynamics.response import AMPLITUDE, FREQUENCY
from calib.dynamics.setting import Setting
from calib.dynamics.swept_path import SweptPath, harmonics_of_piece, swept_path
from calib.dynamics.swept_series import SAME_MOTION, SeriesStretch, SeriesSweep, series_sweep
from calib.modelling.orbit import PeriodMap
from calib.records.response import complex_amplitude, sweeps

WINDOW_MARGIN = 0.05  # beyond the measured frequencies of a sweep, over their range  [1]
SINGLE_POINT_MARGIN = 0.01  # the same of a single point, over its frequency  [1]
MIN_SWEEP_STEP = 0.002  # between two frequencies, over the window  [1]
MAX_TURN_STEPS = 2.0  # from the last frequency of a sweep to the first of the way back, over its mean step  [1]
MAX_TURN_LEVEL_STEP = 0.1  # of the level between those, relative  [1]

KnownSweeps = Mapping[float, SeriesStretch | HeldBranch]  # by the number of the sweep


def swept_paths(
    setting: Setting, bodies: Sequence[str], measured: xr.Dataset, known: KnownSweeps, to_first_order: bool
) -> Iterator[tuple[float, float, LevelCurve, SweptPath]]:
    """Yield number, direction, level over frequency, and path of each sweep.

    Those of the same points are followed once from rest.

    to_first_order : whether paths beside known ones are wanted to first order in what differs from these
    """
    frequency, levels, number = (measured[name].values for name in ("frequency", "level", "sweep"))
    from_rest: dict[tuple[bytes, float], SweptPath] = {}
    passed: dict[float, tuple[SweptPath, float]] = {}  # path and last stop, by the number of the sweep
    for sweep, points in sweeps(measured):
        direction, first = float(measured["direction"][points[0]]), int(points[0])
        level = LevelCurve(frequency[points], levels[points])
        stops = stops_of(frequency[points], direction)
        series, maps = series_sweep(setting, level, stops), partial(_map, setting, level)
        near = known.get(sweep)
        beside = None
        if series and isinstance(near, SeriesStretch):
            beside = series.beside_to_first_order(near) if to_first_order else series.beside(near)
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
    level: LevelCurve,
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
    setting: Setting, level: LevelCurve, frequency: float, sizes: Mapping[int, float], path: SweptPath
) -> float:
    """Distance of a path from amplitudes measured at a frequency [Hz]: logarithms of their ratios  [1]."""
    piece = next((one for one in path.pieces if min(one.frequency) <= frequency <= max(one.frequency)), path.pieces[0])
    order = np.argsort(piece.frequency)
    amplitudes = np.abs(harmonics_of_piece(setting, level, piece, 1)[:, :, 1])[order]
    tiny = np.finfo(float).tiny
    own = {body: float(np.interp(frequency, piece.frequency[order], amplitudes[:, body])) for body in sizes}
    return sum(abs(math.log(max(own[body], tiny) / size)) for body, size in sizes.items())


def stops_of(frequency: np.ndarray, direction: float) -> np.ndarray:
    """Frequencies (n,) at which a sweep stops, in its direction: those measured, and one beyond either end."""
    low, high = float(frequency.min()), float(frequency.max())
    margin = WINDOW_MARGIN * (high - low) or SINGLE_POINT_MARGIN * high
    low, high = max(low - margin, 0.5 * low), high + margin
    stops = [low]
    for own in np.unique(frequency).tolist():
        if min(own - stops[-1], high - own) > MIN_SWEEP_STEP * (high - low):
            stops.append(own)
    return np.array([*stops, high])[:: int(direction)]


def _map(setting: Setting, level: LevelCurve, frequency: float) -> PeriodMap:
    return setting.map({FREQUENCY: frequency, AMPLITUDE: level(frequency)})
