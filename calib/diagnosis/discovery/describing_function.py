"""Describing function of a force that was found: its first harmonic under a harmonic motion, over the amplitude.

Equivalent stiffness and damping: see `calib.diagnosis.equivalent_linearisation`.
"""

import math

import numpy as np

from calib.diagnosis.discovery.document import DescribingFunctionResult
from calib.diagnosis.discovery.formula import Formula
from calib.diagnosis.discovery.free_force import DISPLACEMENT, VELOCITY
from calib.diagnosis.discovery.outcome import Discovery
from calib.diagnosis.equivalent_linearisation import INSTANTS, TAU, equivalent_weights

AMPLITUDES = 12  # up to the largest that is visited  [count]


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
    x = np.multiply.outer(amplitudes, np.cos(TAU)).ravel()
    v = np.multiply.outer(amplitudes, -omega * np.sin(TAU)).ravel()
    weights = equivalent_weights(amplitudes, omega)

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
