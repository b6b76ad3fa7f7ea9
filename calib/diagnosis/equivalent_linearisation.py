"""Equivalent linearisation: stiffness and damping whose force has the first harmonic of a force, in a harmonic motion.

With x = a cos tau and v = -a omega sin tau the force per unit mass f has the equivalent stiffness -<2 f cos tau> / a
and the equivalent damping <2 f sin tau> / (a omega), means over a period (Gelb & Vander Velde, Multiple-Input
Describing Functions and Nonlinear System Design, 1968, section 2.2).
"""

import math

import numpy as np

INSTANTS = 256  # of a period  [count]
TAU = 2.0 * math.pi * np.arange(INSTANTS) / INSTANTS  # phases of the instants  [rad]


def equivalent_weights(amplitudes: np.ndarray, omega: float) -> np.ndarray:
    """Weights (2, n, instant) of forces per unit mass at amplitudes (n,) [m] that give stiffness and damping.

    omega : angular frequency  [rad/s]
    """
    stiffness = -2.0 * np.cos(TAU) / (INSTANTS * amplitudes[:, None])
    damping = 2.0 * np.sin(TAU) / (INSTANTS * omega * amplitudes[:, None])
    return np.stack([stiffness, damping])
