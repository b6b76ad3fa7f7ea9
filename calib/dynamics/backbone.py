"""Backbones and constant-response curves of a body, by harmonic balance, directly: without responses at many levels.

Frequency and level of the excitation are both unknown, and a condition on the body's first harmonic H_1 stands beside
the equations of `calib.dynamics.harmonic_balance`. Phase resonance: H_1 lags the excitation by a quarter of a period,
so that a force does as much work as damping takes (Peeters, Kerschen, Golinval, Journal of Sound and Vibration 330
(2011) 486). Constant response: the modulus of H_1 is held, as a shaker's controller holds it; there a response that
folds at constant level is a curve without folds.
"""

import math
from collections.abc import Sequence

import numpy as np

from calib.dynamics.harmonic_condition import ReadHarmonic, modulus, quadrature
from calib.dynamics.held_curve import HeldBalance, HeldBranch
from calib.dynamics.level_curve import LevelCurve
from calib.dynamics.setting import Setting
from calib.errors import CalibError

RESONANCE_FREQUENCIES = 2000  # of the linear motion, between which its phase passes a quarter of a period
LEVEL_RANGE = 1e-3, 1e3  # of the levels of a constant response, over the least and largest of the linear one
LINEAR_LEVEL_FREQUENCIES = 200  # of a window, at which those are asked for  [count]


def backbones(
    setting: Setting,
    body: str,
    window: tuple[float, float],
    levels: tuple[float, float],
    *,
    harmonics: int = 7,
    most: int = 400,
) -> tuple[HeldBranch, ...]:
    """Motions in phase resonance, one curve for each resonance of the linear motion in the window.

    Parameters
    ----------
    setting : whose period map tells its modal system
    body : whose first harmonic lags the excitation by a quarter of a period
    window : lowest and highest frequency  [Hz]
    levels : lowest and highest amplitude of the excitation, in its unit
    harmonics, most : of the series; points of a curve

    Raises
    ------
    CalibError : an unknown body, an empty window, levels that do not rise from above 0, a simulator that harmonic
        balance does not serve, no resonance in the window, or none that can be followed from the lowest level
    """
    held = HeldBalance(setting, body, window, levels, harmonics)
    frequencies = np.linspace(*window, RESONANCE_FREQUENCIES)
    first = np.array([held.first_harmonic(held.linear(f, levels[0]), f, levels[0]) for f in frequencies.tolist()])
    lagging = np.flatnonzero((first.real[:-1] > 0.0) & (first.real[1:] <= 0.0) & (first.imag[:-1] < 0.0))
    if not lagging.size:
        low, high = window
        raise CalibError(
            f"{body} has no resonance from {low:g} to {high:g} Hz at {levels[0]:g} {held.unit}: nowhere does its first "
            "harmonic begin to lag by a quarter of a period; widen the window"
        )
    found, reasons = [], []
    for place in lagging.tolist():
        share = first.real[place] / (first.real[place] - first.real[place + 1])
        frequency = float(frequencies[place] + share * (frequencies[place + 1] - frequencies[place]))
        try:
            begin = held.linear(frequency, levels[0]), frequency, levels[0]
            found.append(held.followed(quadrature, begin, vary=0, most=most))
        except CalibError as error:
            reasons.append(f"at {frequency:.5g} Hz {error}")
    if not found:
        raise CalibError(
            f"no resonance of {body} can be followed from {levels[0]:g} {held.unit}: {'; '.join(reasons)}; lower the "
            "level"
        )
    return tuple(found)


def constant_responses(
    setting: Setting,
    body: str,
    amplitudes: Sequence[float],
    window: tuple[float, float],
    *,
    harmonics: int = 7,
    most: int = 400,
) -> tuple[HeldBranch, ...]:
    """Motions at held amplitudes of a body over the frequency: the level that each takes.

    Parameters
    ----------
    amplitudes : of the body's first harmonic  [m]
    setting, body, window, harmonics, most : as those of `backbones`

    Raises
    ------
    CalibError : as `backbones`, amplitudes that are not above 0, or one that cannot be held where the window begins
    """
    for amplitude in amplitudes:
        if not (amplitude > 0.0 and math.isfinite(amplitude)):
            raise CalibError(f"expected amplitudes of {body} above 0, got {amplitude:g} m")
    curves = (LevelCurve(np.array(window), np.full(2, size)) for size in amplitudes)
    return tuple(held_response(setting, body, own, window, harmonics=harmonics, most=most) for own in curves)


def held_response(
    setting: Setting,
    body: str,
    amplitude: LevelCurve,
    window: tuple[float, float],
    *,
    read: ReadHarmonic | None = None,
    harmonics: int = 7,
    most: int = 400,
) -> HeldBranch:
    """Motions at an amplitude of a body that may change with the frequency: the level that each takes.

    Parameters
    ----------
    amplitude : of the body's first harmonic over the frequency  [m]
    read : first harmonic that is measured, which has this amplitude; None: that of the motion
    setting, body, window, harmonics, most : as those of `backbones`

    Raises
    ------
    CalibError : as `backbones`, or an amplitude that cannot be held where the window begins
    """
    begin = window[0]
    size, linear = amplitude(begin), _linear_levels(setting, body, amplitude, window, read)
    held = HeldBalance(setting, body, window, _level_window(linear), harmonics)
    try:
        y, level = held.held_at(amplitude, read, begin, float(linear[0]))
        return held.followed(modulus(amplitude, read), (y, begin, level), vary=1, most=most)
    except CalibError as error:
        raise CalibError(
            f"{body} cannot be held at {size:g} m from {begin:g} Hz, where the curve begins: {error}; "
            "begin the window elsewhere, or lower the amplitude"
        ) from error


def held_response_beside(
    known: HeldBranch,
    setting: Setting,
    body: str,
    amplitude: LevelCurve,
    window: tuple[float, float],
    *,
    read: ReadHarmonic | None = None,
    to_first_order: bool = False,
) -> HeldBranch | None:
    """Motions as those of `held_response` beside known ones of other parameters; None where they are sought without.

    Parameters
    ----------
    known : with as many harmonics as are sought
    to_first_order : in the change of parameters, as derivatives need it
    setting, body, amplitude, window, read : as those of `held_response`

    Raises
    ------
    CalibError : an unknown body, or one that the excitation does not move
    """
    levels = _level_window(_linear_levels(setting, body, amplitude, window, read))
    held = HeldBalance(setting, body, window, levels, (known.coefficients.shape[-1] - 1) // 2)
    return held.beside(modulus(amplitude, read), known, to_first_order)


def _level_window(linear: np.ndarray) -> tuple[float, float]:
    """Window of the levels of a constant response, by those of the linear one."""
    return LEVEL_RANGE[0] * float(linear.min()), LEVEL_RANGE[1] * float(linear.max())


def _linear_levels(
    setting: Setting, body: str, amplitude: LevelCurve, window: tuple[float, float], read: ReadHarmonic | None
) -> np.ndarray:
    """Levels that hold the linear motion at an amplitude: over a window, at resonances in it, and at its begin first.

    Raises
    ------
    CalibError : the excitation does not move the body
    """
    held = HeldBalance(setting, body, window, (0.5, 1.0), 1)
    resonances = np.sqrt(held.balance.system.stiffness) / (2.0 * math.pi)
    inside = resonances[(resonances > window[0]) & (resonances < window[1])]
    frequencies = np.append(np.linspace(*window, LINEAR_LEVEL_FREQUENCIES), inside)
    moved = held.per_level(frequencies)
    if read is not None:
        moved = np.array([read(*own, 1.0) for own in zip(moved.tolist(), frequencies.tolist(), strict=True)])
    size = np.abs(moved)
    size[size == 0.0] = math.inf
    levels = np.array([amplitude(frequency) for frequency in frequencies.tolist()]) / size
    if not (levels > 0.0).any():
        raise CalibError(f"the excitation does not move {body}: no level holds its amplitude")
    return levels[levels > 0.0]
