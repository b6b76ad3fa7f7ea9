"""What can be hidden: for each effect the direction in which its parameters leave their null, and what they hold."""

import math
from collections.abc import Mapping
from typing import NamedTuple

from hidden.system import System

from calib import plugins

Power = tuple[int, int]  # of metre, and of second
NUMBER, METRE, SECOND, SPEED, RATE, ACCELERATION = (0, 0), (1, 0), (0, 1), (1, -1), (0, -1), (1, -2)

TURN = 2.0 * math.pi


class Cause(NamedTuple):
    """An effect as it is hidden.

    Attributes
    ----------
    grows : parameter -> (power of its unit, weight); the first one is the effect's size, in SI, and the others keep
        their weights to it, in natural scales
    holds : parameter -> (power of its unit, value in natural scales)
    derived : whether the records have a derivative where it is absent
    step : of a derivative, in natural scales of the size, of a system whose steps are the usual ones
    most : largest size, SI
    """

    grows: Mapping[str, tuple[Power, float]]
    holds: Mapping[str, tuple[Power, float]] = {}
    derived: bool = True
    step: float = 1e-5
    most: float = math.inf


CAUSES = {
    "linear_drag": Cause({"c1": (RATE, 1.0)}),
    "quadratic_drag": Cause({"c2": ((-1, 0), 1.0)}),
    "coulomb_friction": Cause({"friction": (ACCELERATION, 1.0)}, {"friction_slip": (SPEED, 0.01)}),
    "presliding": Cause({"dahl_force": (ACCELERATION, 1.0)}, {"dahl_distance": (METRE, 0.1)}),
    "bouc_wen": Cause(
        {"hysteresis_force": (ACCELERATION, 1.0)},
        {"hysteresis_distance": (METRE, 0.3), "hysteresis_exponent": (NUMBER, 2.0), "hysteresis_shape": (NUMBER, 0.5)},
    ),
    "stribeck": Cause(
        {"stribeck_force": (ACCELERATION, 1.0)},
        {"stribeck_distance": (METRE, 0.1), "stribeck_rise": (NUMBER, 0.8), "stribeck_speed": (SPEED, 0.4)},
    ),
    "power_law_damping": Cause({"power_damping": (ACCELERATION, 1.0)}, {"power_exponent": (NUMBER, 2.6)}),
    "magnetic_attraction": Cause({"magnet_strength": ((3, -2), 1.0)}, {"magnet_distance": (METRE, 4.5)}),
    "damping_drift": Cause({"damping_rise": ((0, -2), 1.0)}),
    "cubic_stiffness": Cause({"k3": ((-2, -2), 1.0)}),
    "quadratic_stiffness": Cause({"k2": ((-1, -2), 1.0)}),
    "softening": Cause({"kx": ((-1, -2), 1.0)}),
    "preload": Cause({"preload": (ACCELERATION, 1.0)}),
    "support": Cause({"support_stiffness": ((0, -2), 1.0), "support_damping": (RATE, 0.1)}),
    "glue_bond": Cause({"bond": (NUMBER, 1.0)}),
    "added_mass": Cause({"added_mass": (NUMBER, 1.0)}),
    "detuning_drift": Cause({"detuning": ((0, -3), 1.0)}),
    "extra_mode": Cause(
        {"mode_mass": (NUMBER, 1.0)}, {"mode_frequency": (RATE, 1.7 / TURN), "mode_damping": (NUMBER, 0.02)}
    ),
    "drive_harmonic_2": Cause({"h2_cos": (NUMBER, 1.0), "h2_sin": (NUMBER, 0.5)}),
    "drive_harmonic_3": Cause({"h3_cos": (NUMBER, 1.0), "h3_sin": (NUMBER, 0.5)}),
    "drive_modulation": Cause({"modulation": (RATE, 1.0)}),
    "backlash": Cause(
        {"backlash_stiffness": ((0, -2), 1.0)},
        {"backlash_width": (METRE, 0.3), "backlash_force": (ACCELERATION, 10.0)},
        step=1e-3,
    ),
    "gap_offset": Cause({"dg": (METRE, 1.0)}),
    "adhesion": Cause({"adhesion": ((2, -2), 1.0)}),
    "rate_restitution": Cause({"rate_exponent": (NUMBER, 1.0)}, {"rate_speed": (NUMBER, 1.0)}),
    "squeeze_film": Cause({"squeeze": (RATE, 1.0)}, step=3e-7),
    "channel_gain": Cause({"gain_velocity": (NUMBER, 1.0), "gain_displacement": (NUMBER, 0.0)}),
    "channel_nonlinearity": Cause({"cubic_velocity": ((-2, 2), 1.0), "cubic_displacement": ((-2, 0), 0.0)}),
    "channel_offset": Cause({"offset_displacement": (METRE, 1.0), "offset_velocity": (SPEED, 0.5)}),
    "channel_drift": Cause({"drift_displacement": (SPEED, 1.0), "drift_velocity": (ACCELERATION, 0.5)}),
    "channel_lag": Cause({"lag": (SECOND, 1.0)}),
    "velocity_lowpass": Cause({"lowpass": (SECOND, 1.0)}, step=1e-3),
    "velocity_differencing": Cause({"differencing": (NUMBER, 1.0)}, most=1.0),
    "plot_shear": Cause({"shear": (SECOND, 1.0)}),
    "plot_scale": Cause({"plot_scale": (NUMBER, 1.0)}),
    "axis_tilt": Cause({"tilt": (NUMBER, 1.0)}),
    "clipping": Cause({"clip_velocity": (NUMBER, 1.0)}, derived=False, step=0.05),  # share of the peak cut off
    "quantisation": Cause(
        {"quantum_displacement": (METRE, 1.0), "quantum_velocity": (SPEED, 1.0)}, derived=False, step=0.05
    ),
    "outliers": Cause({"outlier_share": (NUMBER, 1.0)}, derived=False),
}


def scale(system: System, power: tuple[float, float]) -> float:
    """Natural scale of a unit: lengths in the system's, times in 1 / omega."""
    return system.length ** power[0] * system.omega ** -power[1]


def natural(system: System, effect: str) -> float:
    """Natural scale of the size of an effect, SI."""
    return scale(system, next(iter(CAUSES[effect].grows.values()))[0])


def first_step(system: System, effect: str) -> float:
    """Step of a derivative by the size of an effect, or of a secant, SI."""
    cause = CAUSES[effect]
    return cause.step * natural(system, effect) * (system.step / System.step if cause.derived else 1.0)


def one_sided(effect: str) -> bool:
    """Whether the size of an effect must not be negative, as the library bounds it."""
    size = next(iter(CAUSES[effect].grows))
    return any(p.low >= 0.0 for p in plugins.load("calib.effects", effect).parameters if p.name == size)


def parameters(
    system: System, effect: str, size: float, weights: Mapping[str, float] | None = None
) -> dict[str, float]:
    """Parameters of an effect by name, SI; the size is that of the first one.

    weights : of its parameters to one another, in natural scales, in place of its own
    """
    cause = CAUSES[effect]
    held = {name: value * scale(system, power) for name, (power, value) in cause.holds.items()}
    weights = weights or {name: weight for name, (_, weight) in cause.grows.items()}
    relative = size / natural(system, effect)
    grown = {name: relative * weights[name] * scale(system, power) for name, (power, _) in cause.grows.items()}
    return held | grown
