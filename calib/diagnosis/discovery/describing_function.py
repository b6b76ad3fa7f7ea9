"""Describing function of a force that was found: its first harmonic under a harmonic motion, over the amplitude.

With x = a cos tau and v = -a omega sin tau, the force per unit mass f(x, v) has the equivalent stiffness
-<2 f cos tau> / a and the equivalent damping <2 f sin tau> / (a omega), means over a period (Gelb & Vander Velde,
Multiple-Input Describing Functions and Nonlinear System Design, 1968, section 2.2).
"""

import math

import numpy as np

from calib.diagnosis.discovery.document import DescribingFunctionResult
from calib.diagnosis.discovery.formula import Formula
from calib.diagnosis.discovery.free_force import DISPLACEMENT, VELOCITY
from calib.diagnosis.discovery.outcome import Discovery

AMPLITUDES, INSTANTS = 12, 256  # up to the largest that is visited; of a period  [count]


def describing_function(discovery: Discovery) -> DescribingFunctionResult | None:
    """Describing function of the force of a search, without what calibration absorbs.

    None without a force, or a frequency response among the records, and at an interface, whose clearance has a mean.
    """
    chosen, states, band = discovery.chosen, discovery.states, discovery.frequencies
    if chosen is None or states is None or band is None or chosen.place.gap:
        return None
    largest, fastest = (float(np.abs(own).max()) for own in (states.x, states.v))
    omega = fastest / largest
    amplitudes = largest * np.arange(1, AMPLITUDES + 1) / AMPLITUDES
    tau = 2.0 * math.pi * np.arange(INSTANTS) / INSTANTS
    x = np.multiply.outer(amplitudes, np.cos(tau)).ravel()
    v = np.multiply.outer(amplitudes, -omega * np.sin(tau)).ravel()
    stiffness = -2.0 * np.cos(tau) / (INSTANTS * amplitudes[:, None])
    damping = 2.0 * np.sin(tau) / (INSTANTS * omega * amplitudes[:, None])
    weights = np.stack([stiffness, damping])  # (2, amplitude, instant)

    def averaged(values: np.ndarray) -> np.ndarray:
        """Both means (2 * amplitude, k) of values (amplitude * instant, k)."""
        return np.einsum("dai,aik->dak", weights, values.reshape(AMPLITUDES, INSTANTS, -1)).reshape(2 * AMPLITUDES, -1)

    def of_formula(formula: Formula) -> np.ndarray:
        return averaged(formula.values(x, v))[:, 0]

    rows, partial = averaged(chosen.fitted.model.matrix(x, v)), discovery.partial_spline
    both = chosen.fitted.combination(rows) if partial is None else partial.combination(rows, of_formula)
    (k, c), (k_error, c_error) = (np.split(own, 2) for own in both)
    if DISPLACEMENT not in chosen.all_arguments:  # a function of velocity has no equivalent stiffness
        k, k_error = np.zeros((2, AMPLITUDES))
    if VELOCITY not in chosen.all_arguments:  # one of displacement has no hysteresis
        c, c_error = np.zeros((2, AMPLITUDES))
    known = (tuple(own.tolist()) for own in (amplitudes, k, k_error, c, c_error))
    return DescribingFunctionResult(omega / (2.0 * math.pi), band, *known)
