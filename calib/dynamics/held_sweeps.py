"""Sweeps at a held amplitude: motions of that amplitude and the level that each takes, by harmonic balance.

The amplitude is the one that was measured point by point (`calib.records.held_response`). There the response to a set
level may have several motions, stable ones and others: at a held amplitude it has one, so that neither the direction of
the sweep nor where it began matters (Renson et al., J. Sound Vib. 367 (2016) 145).
"""

from collections.abc import Iterator, Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from calib.dynamics.backbone import held_response, held_response_beside
from calib.dynamics.harmonic_condition import ReadHarmonic
from calib.dynamics.held_curve import HeldBranch
from calib.dynamics.level_curve import HeldAmplitude, LevelCurve
from calib.dynamics.response import AMPLITUDE
from calib.dynamics.setting import Setting
from calib.dynamics.swept_paths import stops_of
from calib.dynamics.swept_series import MAX_LEFT_OUT, SERIES_HARMONICS
from calib.errors import CalibError
from calib.records.response import HELD, HELD_AMPLITUDE, complex_amplitude, make_response, sweeps

MAX_REMEMBERED_SWEEPS = 32  # sweeps whose amplitude over frequency is remembered: each simulation asks for the same
MAX_HELD_POINTS = 2000  # of one curve  [count]
READ_FREQUENCIES = 400  # of a window, at which is asked what is measured of a motion  [count]
LINEARITY_TOLERANCE = 1e-9  # of what is measured, over its size: rounding  [1]


class HeldSweep(NamedTuple):
    """Motions of one sweep: its number, its direction, and the curve that it is on, upwards."""

    sweep: float
    direction: float
    branch: HeldBranch


def held_sweeps(
    setting: Setting,
    measured: xr.Dataset,
    known: Mapping[float, HeldBranch] = MappingProxyType({}),
    to_first_order: bool = False,
) -> Iterator[HeldSweep]:
    """Motions at the amplitudes that sweeps of a measured response held, beyond its ends by a margin.

    Parameters
    ----------
    measured : see `calib.records.held_response.at_one_level`
    known : curves of other parameters by the number of the sweep, beside which these are sought first
    to_first_order : whether they are wanted to first order in what differs from the known ones, for a derivative

    Raises
    ------
    CalibError : a simulator that harmonic balance does not serve, or an amplitude that cannot be held
    """
    body = str(measured.attrs[HELD])
    if body not in setting.model.bodies:
        raise CalibError(f"no body {body!r}, whose amplitude was held; there are {', '.join(setting.model.bodies)}")
    for sweep, points in sweeps(measured):
        frequency, amplitude = (measured[name].values[points] for name in ("frequency", HELD_AMPLITUDE))
        stops = stops_of(frequency, 1.0)
        window = float(stops[0]), float(stops[-1])
        read = _read(setting, body, np.linspace(*window, READ_FREQUENCIES), float(amplitude[0]))
        curve, near = _held_amplitude(frequency.tobytes(), amplitude.tobytes()), known.get(sweep)
        beside = None
        if near is not None:
            beside = held_response_beside(near, setting, body, curve, window, read=read, to_first_order=to_first_order)
        is_described = beside is not None and beside.left_out.max() <= MAX_LEFT_OUT
        branch = beside if beside is not None and is_described else _described(setting, body, curve, window, read)
        reached = float(branch.frequency.max())
        if reached < frequency.max():
            raise CalibError(f"{body} is not held beyond {reached:g} Hz: {branch.end}")
        yield HeldSweep(sweep, float(measured["direction"][points[0]]), branch)


@lru_cache(maxsize=MAX_REMEMBERED_SWEEPS)
def _held_amplitude(frequency: bytes, amplitude: bytes) -> HeldAmplitude:
    """Amplitude that a sweep held over the frequency, of readings whose float64 these are."""
    return HeldAmplitude(np.frombuffer(frequency), np.frombuffer(amplitude))


def _described(
    setting: Setting, body: str, amplitude: LevelCurve, window: tuple[float, float], read: ReadHarmonic | None
) -> HeldBranch:
    """Curve of as many harmonics as the motions need, at most the most of `SERIES_HARMONICS`."""
    for harmonics in SERIES_HARMONICS:
        branch = held_response(setting, body, amplitude, window, read=read, harmonics=harmonics, most=MAX_HELD_POINTS)
        if branch.left_out.max() <= MAX_LEFT_OUT:
            break
    return branch


def _read(setting: Setting, body: str, frequency: np.ndarray, amplitude: float) -> ReadHarmonic | None:
    """First harmonic that is measured of a body at frequencies (n,) [Hz]; None where it is that of the motion.

    amplitude : of the motions by which it is found  [m]

    Raises
    ------
    CalibError : it is not linear in motion and level, as where an effect on what is measured saturates
    """
    level = setting.excitation.amplitude or 1.0
    motion, other, further = (
        _measured_of(setting, body, frequency, *own)
        for own in ((amplitude, level), (amplitude, 2.0 * level), (2.0j * amplitude, level))
    )
    if np.array_equal(motion, np.full(frequency.size, amplitude + 0.0j)) and np.array_equal(motion, other):
        return None
    by_level, by_motion = (other - motion) / level, (further - motion) / ((2.0j - 1.0) * amplitude)
    left = motion - by_motion * amplitude - by_level * level
    if np.abs(left).max() > LINEARITY_TOLERANCE * np.abs(motion).max():
        raise CalibError(
            f"what effects have measured of {body} is not linear in motion and level, so that no simulation holds its "
            "amplitude; leave the effect out, or the key held"
        )
    return ReadHarmonic(CubicSpline(frequency, by_motion), CubicSpline(frequency, by_level))


def _measured_of(setting: Setting, body: str, frequency: np.ndarray, amplitude: complex, level: float) -> np.ndarray:
    """Complex amplitudes (n,) that effects at the site "response" have measured of motions at a level  [m]."""
    bodies = setting.model.bodies
    record = make_response(
        frequency, bodies, np.full((len(bodies), frequency.size), amplitude), level, setting.unit(AMPLITUDE),
        place=setting.excitation.place, quantity=setting.excitation.quantity,
    )  # fmt: skip
    measured = setting.model.measured_response(record, setting.values)
    return complex_amplitude(measured)[list(bodies).index(body)]
