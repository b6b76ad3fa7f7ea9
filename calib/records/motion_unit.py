"""Units of the amplitude of a motion: displacement, velocity or acceleration, alone or over the excitation's."""

import re
from typing import NamedTuple

import numpy as np

from calib.errors import CalibError
from calib.units import to_si

MOTIONS = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s^2"}  # each the rate of the one before it
GRAVITY = re.compile(r"\b(m?)g\b")  # g and mg of an acceleration: the registry takes them as gram and milligram
EXAMPLES = "'mm', 'mm/s', 'm/s^2' or 'g'"


class MotionUnit(NamedTuple):
    """Unit of the amplitude of a motion.

    Attributes
    ----------
    factor : from its numbers to SI
    rates : how often the displacement is differentiated: 0 displacement, 1 velocity, 2 acceleration
    level : SI unit of the excitation's amplitude that it is divided by, as of a receptance or an accelerance; "" if not
    """

    factor: float
    rates: int
    level: str = ""

    def displacement(self, values: np.ndarray, omega: np.ndarray) -> np.ndarray:
        """Complex amplitudes (..., point) of the displacement [m] of those in this unit, at omega (point,) [rad/s]."""
        return self.factor * values / (1j * omega) ** self.rates


def motion_unit(unit: str, scale: str | float = 1.0, per: tuple[str, ...] = ()) -> MotionUnit:
    """Read the unit of an amplitude; "g" is the acceleration of gravity.

    Parameters
    ----------
    scale : factor on the numbers, a number or a sensitivity such as "100 mm/s/V"
    per : SI units of the excitation's amplitude, by which the motion may be divided

    Raises
    ------
    CalibError : neither displacement, velocity nor acceleration
    """
    found = _motion(f"1 {unit}" if scale == 1.0 else f"1 {unit} * ({scale})", per)
    if found is not None:
        return found
    ratio = f", or one of these over a unit of the excitation, such as 'mm/{per[0]}'," if per else ","
    times = "" if scale == 1.0 else f" times the scale {scale!r}"
    raise CalibError(
        f"expected a unit of displacement, velocity or acceleration, such as {EXAMPLES}{ratio} got {unit!r}{times}"
    )


def motion_quantity(quantity: str, per: tuple[str, ...] = ()) -> MotionUnit:
    """Read a quantity such as "0.02 g"; `factor` is its value in SI, `per` and errors are as in `motion_unit`."""
    found = _motion(quantity, per)
    if found is None:
        raise CalibError(f"expected a displacement, velocity or acceleration, such as '0.02 g', got {quantity!r}")
    return found


def with_gravity(quantity: str) -> str:
    """Name the acceleration of gravity in an acceleration, "0.02 g" or "9.80665 m/s^2/g", as the registry does."""
    return GRAVITY.sub(_gravity, quantity)


def is_length(unit: str) -> bool:
    """Whether a unit is one of length."""
    try:
        to_si(f"1 {unit}", MOTIONS["displacement"])
    except CalibError:
        return False
    return True


def _motion(written: str, per: tuple[str, ...]) -> MotionUnit | None:
    written = with_gravity(written)
    for level in ("", *per):
        for rates, si in enumerate(MOTIONS.values()):
            try:
                return MotionUnit(to_si(written, f"{si}/{level}" if level else si), rates, level)
            except CalibError:
                continue
    return None


def _gravity(match: re.Match[str]) -> str:
    return "millistandard_gravity" if match[1] else "standard_gravity"
