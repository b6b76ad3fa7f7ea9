"""Damping that grows with a power of the velocity."""

import numpy as np

from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.parameter import Parameter


@force
def damper(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the force per unit mass [m/s^2] at the velocity v [m/s]: -a |v / (1 m/s)|^n sgn v."""
    size = p[0] * abs(v) ** p[1]  # v over 1 m/s
    return -size if v > 0.0 else size


EFFECT = Effect(
    name="power_law_damping",
    site="force",
    law=damper,
    parameters=(
        Parameter("power_damping", "m/s^2", 0.0, "force per unit mass at 1 m/s", null=0.0, low=0.0),
        Parameter("power_exponent", "1", 1.5, "exponent n: 1 is viscous, 2 quadratic", low=0.0),
    ),
    meaning="an orifice, a seal or a joint: loss per cycle ~ amplitude^(1 + n), odd harmonics",
    equation="-power_damping |v / (1 m/s)|^power_exponent sgn v",
    group="damping",
    confused=("quadratic_drag", "linear_drag", "coulomb_friction"),
    generalises=("linear_drag", "quadratic_drag"),
    special_cases={
        "linear_drag": {"power_damping": "c1", "power_exponent": 1.0},
        "quadratic_drag": {"power_damping": "c2", "power_exponent": 2.0},
    },
    natural={"power_damping": (0.01, 0.1, 1.0), "power_exponent": (1.5, 3.0)},
    cite="Ruzicka & Derby, Influence of Damping in Vibration Isolation (1971)",
)
