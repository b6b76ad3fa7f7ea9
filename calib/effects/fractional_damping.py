"""A viscoelastic element between spring and damper: a derivative of fractional order."""

import math

import numpy as np

from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.parameter import ABOVE_ZERO, Parameter

DIFFUSIVE_POLES = 4  # nodes that are states
POLE_RATIO = 7.0  # of neighbouring poles: within 1.5 % over five times the middle frequency either way, 4 % over twenty


@force(states=4)
def springpot(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the force per unit mass [m/s^2]: -k (d/dt)^a x / w^a, w = 2 pi fractional_frequency.

    By the diffusive representation, sin(pi a) / pi times the integral of xi^(a - 1) z over xi with z' = v - xi z, and
    the trapezoidal rule over log xi: of its nodes four about w are states, the sum of the slower ones is a spring, that
    of the faster ones a dashpot.
    """
    w = 2.0 * math.pi * p[2]
    a, growth = p[1], POLE_RATIO ** p[1]
    pole = POLE_RATIO ** (-0.5 * (DIFFUSIVE_POLES - 1))  # the slowest, over w
    weight = math.sin(math.pi * a) / math.pi * math.log(POLE_RATIO) * pole**a
    pull = weight / (growth - 1.0) * x
    for k in range(DIFFUSIVE_POLES):
        dz[k] = v - pole * w * z[k]
        pull += weight * z[k]
        pole *= POLE_RATIO
        weight *= growth
    pull += weight / (1.0 - growth / POLE_RATIO) * v / (pole * w)
    return -p[0] * pull


EFFECT = Effect(
    name="fractional_damping",
    site="force",
    law=springpot,
    parameters=(
        Parameter("fractional_stiffness", "1/s^2", 0.0, "modulus over mass at the middle frequency", null=0.0, low=0.0),
        Parameter("fractional_order", "1", 0.5, "order a: 0 is a spring, 1 a damper", low=0.05, high=0.95),
        Parameter(
            "fractional_frequency", "Hz", 10.0, "middle of the approximated band", kind="numerical", low=ABOVE_ZERO
        ),
    ),
    meaning="rubber, polymer or glue: stiffness and loss grow with a power of the frequency",
    equation="-fractional_stiffness (d/dt)^a x / (2 pi fractional_frequency)^a, four poles, a = fractional_order",
    group="damping",
    confused=("linear_drag", "power_law_damping", "extra_mode"),
    generalises=("linear_drag",),
    natural={"fractional_frequency": (1.0 / (2.0 * math.pi),)},
    cite="Bagley & Torvik, A Theoretical Basis for the Application of Fractional Calculus to Viscoelasticity, "
    "J. Rheology 27 (1983) 201",
)
