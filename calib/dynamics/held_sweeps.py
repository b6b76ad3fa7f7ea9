"""Sweeps at a held amplitude: motions of that amplitude and the level that each takes, by harmonic balance.

The amplitude is the one that was measured point by point (`calib.records.held_response`). There the response to a set
level may have several motions, stable ones and others: at a held amplitude it has one, so that neither the direction of
the sweep nor where it began matters (Renson et al., J. Sound Vib. 367 (2016) 145).
"""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from calib.dynamics.arclength import EDGE_ROUNDING, MAX_ARCLENGTH_STEP
from calib.dynamics.backbone import HeldBranch, held_response
from calib.dynamics.level_curve import LevelCurve
from calib.dynamics.response import AMPLITUDE
from calib.dynamics.setting import Setting
from calib.dynamics.swept_paths import stops_of
from calib.dynamics.swept_series import MAX_LEFT_OUT, MAX_STRETCH_LENGTH, SERIES_HARMONICS
from calib.errors import CalibError
from calib.records.response import HELD, HELD_AMPLITUDE, complex_amplitude, make_response, sweeps

MAX_HELD_ROUNDS = 4  # of the amplitude of a body for that which is measured of it
HELD_TOLERANCE = 1e-3  # of the measured amplitude, from the one that was held  [1]


class HeldSweep(NamedTuple):
    """Motions of one sweep: its number, its direction, and the curve that it is on, upwards.

    whole : whether the curve reaches the end of the sweep's window
    """

    sweep: float
    direction: float
    branch: HeldBranch
    whole: bool


def held_sweeps(setting: Setting, measured: xr.Dataset) -> Iterator[HeldSweep]:
    """Motions at the amplitudes that sweeps of a measured response held, beyond its ends by a margin.

    Parameters
    ----------
    measured : see `calib.records.held_response.at_one_level`

    Raises
    ------
    CalibError : a simulator that harmonic balance does not serve, or an amplitude that cannot be held
    """
    body = str(measured.attrs[HELD])
    for sweep, points in sweeps(measured):
        frequency, amplitude = (measured[name].values[points] for name in ("frequency", HELD_AMPLITUDE))
        stops = stops_of(frequency, 1.0)
        branch = _held(setting, body, LevelCurve(frequency, amplitude), (float(stops[0]), float(stops[-1])))
        whole = float(branch.frequency[-1]) >= float(stops[-1]) * (1.0 - EDGE_ROUNDING)
        yield HeldSweep(sweep, float(measured["direction"][points[0]]), branch, whole)


def _held(setting: Setting, body: str, wanted: LevelCurve, window: tuple[float, float]) -> HeldBranch:
    """Curve on which the amplitude that is measured of the body is the wanted one.

    The body's own amplitude is that over the ratio of the two, which is found anew on each curve.
    """
    choices: Sequence[int] = SERIES_HARMONICS
    target, before = wanted, math.inf
    for _ in range(MAX_HELD_ROUNDS):
        branch, choices = _described(setting, body, target, window, choices)
        read = branch.amplitude * _as_measured(setting, branch)
        excess = read / np.array([wanted(own) for own in branch.frequency.tolist()])
        apart = float(np.abs(excess - 1.0).max())
        if apart <= HELD_TOLERANCE:
            break
        if apart > before:
            raise CalibError(
                f"what is measured of {body} cannot be held at a set amplitude from {window[0]:g} to {window[1]:g} Hz: "
                f"it departs by {apart:.2g} of it; effects on what is measured are as large as the motion"
            )
        target, before = LevelCurve(branch.frequency, branch.amplitude / excess), apart
    return branch


def _described(
    setting: Setting, body: str, target: LevelCurve, window: tuple[float, float], choices: Sequence[int]
) -> tuple[HeldBranch, Sequence[int]]:
    """Curve of as many harmonics as the motions need, and the choices from there on.

    choices : numbers of harmonics, of which the last is taken where none suffices
    """
    most = math.ceil(MAX_STRETCH_LENGTH / MAX_ARCLENGTH_STEP)
    for harmonics in choices:
        branch = held_response(setting, body, target, window, harmonics=harmonics, most=most)
        if branch.left_out.max() <= MAX_LEFT_OUT:
            break
    return branch, [more for more in choices if more >= harmonics]


def _as_measured(setting: Setting, branch: HeldBranch) -> np.ndarray:
    """Amplitude (m,) of the body as effects at the site "response" have it measured, over its own  [1]."""
    row, own = branch.bodies.index(branch.body), branch.harmonics[:, 1]
    record = make_response(
        branch.frequency, branch.bodies, own, branch.level, setting.unit(AMPLITUDE),
        place=setting.excitation.place, quantity=setting.excitation.quantity,
    )  # fmt: skip
    read = complex_amplitude(setting.model.measured_response(record, setting.values))
    return np.asarray(np.abs(read[row] / own[row]))
