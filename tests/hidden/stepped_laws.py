"""The forces that are hidden in stepped sines, written without the library."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numba import njit

BOUC_WEN_SHAPE = 0.6  # share of the loop that depends on the direction; exponent 2
STRIBECK_RISE, BRISTLE = 0.6, 5e-4  # friction at rest over that of sliding, less 1; m
FRACTIONAL_BAND = 0.2, 2e3  # rad/s, of the sections of a springpot
FRACTIONAL_SECTIONS = 16  # of first order  [count]
FRACTIONAL_FREQUENCY = 20.0  # rad/s, at which `size` is the modulus of a springpot

# x, v, internal states, size, form, rates of the states (written) -> force
Force = Callable[[float, float, np.ndarray, float, float, np.ndarray], float]


@njit
def _cubic(x: float, v: float, z: np.ndarray, size: float, form: float, dz: np.ndarray) -> float:
    return -size * x**3


@njit
def _odd_square(x: float, v: float, z: np.ndarray, size: float, form: float, dz: np.ndarray) -> float:
    return size * x * abs(x)


@njit
def _drag(x: float, v: float, z: np.ndarray, size: float, form: float, dz: np.ndarray) -> float:
    return -size * v * abs(v)


@njit
def _coulomb(x: float, v: float, z: np.ndarray, size: float, form: float, dz: np.ndarray) -> float:
    return -size * np.tanh(v / form)


@njit
def _dahl(x: float, v: float, z: np.ndarray, size: float, form: float, dz: np.ndarray) -> float:
    dz[0] = (v - z[0] * abs(v)) / form
    return -size * z[0]


@njit
def _square(x: float, v: float, z: np.ndarray, size: float, form: float, dz: np.ndarray) -> float:
    return -size * x * x


@njit
def _power(x: float, v: float, z: np.ndarray, size: float, form: float, dz: np.ndarray) -> float:
    return -size * np.sign(v) * abs(v) ** form


@njit
def _bouc_wen(x: float, v: float, z: np.ndarray, size: float, form: float, dz: np.ndarray) -> float:
    turning = BOUC_WEN_SHAPE * (1.0 if v * z[0] > 0.0 else -1.0) + 1.0 - BOUC_WEN_SHAPE
    dz[0] = v / form * (1.0 - z[0] * z[0] * turning)
    return -size * z[0]


@njit
def _stribeck(x: float, v: float, z: np.ndarray, size: float, form: float, dz: np.ndarray) -> float:
    at_rest = 1.0 + STRIBECK_RISE * np.exp(-((v / form) ** 2))
    dz[0] = (v - z[0] * abs(v) / at_rest) / BRISTLE
    return -size * z[0]


@njit
def _iwan(x: float, v: float, z: np.ndarray, size: float, form: float, dz: np.ndarray) -> float:
    """Sliders of one stiffness that slip at displacements spread evenly up to 2 form; `size` is their whole force."""
    total = 0.0
    for k in range(z.size):
        limit = 2.0 * form * (k + 0.5) / z.size
        total += z[k]
        dz[k] = 0.0 if abs(z[k]) >= limit and v * z[k] > 0.0 else v
    return -size * total / (z.size * form)


@njit
def _play(x: float, v: float, z: np.ndarray, size: float, form: float, dz: np.ndarray) -> float:
    """Spring of the stiffness `size` behind a dead zone of half the width `form`."""
    return -size * (x - min(form, max(-form, x)))


@njit
def _magnet(x: float, v: float, z: np.ndarray, size: float, form: float, dz: np.ndarray) -> float:
    """Attraction by a magnet at the displacement -form, which is `size` where the body is at zero."""
    return -size * (form / (form + x)) ** 2


@njit
def _springpot(x: float, v: float, z: np.ndarray, size: float, form: float, dz: np.ndarray) -> float:
    """Derivative of the order `form` by a cascade of sections (s + zero) / (s + pole) (Oustaloup 2000).

    The sections beyond the fastest are 1 + s times the sum of 1 / zero - 1 / pole, to first order.
    """
    slowest, fastest = FRACTIONAL_BAND
    ratio = (fastest / slowest) ** (1.0 / FRACTIONAL_SECTIONS)
    beyond = (ratio ** (0.5 * form) - ratio ** (-0.5 * form)) * ratio**0.5 / (ratio - 1.0) / fastest
    passed = size * (fastest / FRACTIONAL_FREQUENCY) ** form * (x + beyond * v)
    for k in range(FRACTIONAL_SECTIONS):
        zero, pole = slowest * ratio ** (k + 0.5 - 0.5 * form), slowest * ratio ** (k + 0.5 + 0.5 * form)
        dz[k] = passed - pole * z[k]
        passed += (zero - pole) * z[k]
    return -passed


class Cause(NamedTuple):
    """A hidden force per unit mass.

    Attributes
    ----------
    force : of displacement, velocity, internal states, size and form
    sizes : least and greatest, drawn on a logarithmic scale, in the unit of the law: 1/(m^2 s^2) of the cubic spring,
        1/(m s^2) of those of second order, 1/s^2 of play and of the springpot, 1/m of drag, m/s^2 of friction, of the
        magnet and of the power law at 1 m/s
    form : second parameter, drawn likewise: m/s of Coulomb's and Stribeck's friction, m of Dahl's, Bouc and Wen's and
        Iwan's, of play and of the magnet's distance, exponent of the power law, order of the springpot, otherwise idle
    accepted : effects that are the right answer
    states : number of internal states
    special : cause that this one is where its form is a certain one, or nearly; "" for none
    """

    force: Force
    sizes: tuple[float, float]
    form: tuple[float, float]
    accepted: tuple[str, ...]
    states: int = 1
    special: str = ""


CAUSES: Mapping[str, Cause] = {
    "cubic_stiffness": Cause(_cubic, (6e4, 4e5), (1.0, 1.0), ("cubic_stiffness",)),
    "softening": Cause(_odd_square, (1.5e3, 5e3), (1.0, 1.0), ("softening",)),
    "quadratic_drag": Cause(_drag, (1.5, 6.0), (1.0, 1.0), ("quadratic_drag",)),
    "coulomb_friction": Cause(_coulomb, (0.02, 0.06), (2e-3, 4e-3), ("coulomb_friction",)),
    "presliding": Cause(_dahl, (0.05, 0.15), (2e-3, 8e-3), ("presliding",)),
    "quadratic_stiffness": Cause(_square, (2e3, 4e3), (1.0, 1.0), ("quadratic_stiffness",)),
    "power_law_damping": Cause(_power, (1.0, 4.0), (2.5, 3.3), ("power_law_damping",)),
    "bouc_wen": Cause(_bouc_wen, (0.2, 0.6), (2e-3, 3.5e-3), ("bouc_wen",), special="presliding"),
    "stribeck": Cause(_stribeck, (0.03, 0.08), (0.05, 0.2), ("stribeck",), special="presliding"),
    "iwan": Cause(_iwan, (0.25, 0.6), (4e-3, 8e-3), ("iwan",), states=20, special="bouc_wen"),
    "backlash": Cause(_play, (20.0, 80.0), (3e-3, 1.2e-2), ("backlash",)),
    "magnetic_attraction": Cause(_magnet, (1.2, 1.8), (0.08, 0.1), ("magnetic_attraction",)),
    "fractional_damping": Cause(
        _springpot, (75.0, 90.0), (0.6, 0.7), ("fractional_damping",), states=FRACTIONAL_SECTIONS
    ),
}
