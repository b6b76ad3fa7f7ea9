"""Equivalent damping and stiffness of a force law, by `calib.diagnosis.equivalent_linearisation`."""

import math
from dataclasses import dataclass

import numpy as np

from calib.diagnosis.equivalent_linearisation import INSTANTS, equivalent_weights
from calib.modelling.laws import STATES, BoundLaw

MAX_LAW_PERIODS = 12  # until internal states repeat  [count]
MAX_PERIOD_CHANGE = 1e-3  # of internal states that repeat, from one period to the next, over the largest  [1]
MIN_HARMONIC_SHARE = 1e-3  # of a harmonic of the force that counts, over its rms  [1]
RUNGE_KUTTA_STAGES = ((0.0, 0), (0.5, 1), (0.5, 1), (1.0, 2))  # share of a step [1], half steps of the motion [count]


@dataclass(frozen=True)
class EquivalentLaw:
    """Equivalent damping and stiffness of a law at amplitudes (n,), per unit mass  [1/s], [1/s^2]."""

    amplitude: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray

    @property
    def damping_power(self) -> float | None:
        """Power of the amplitude that the damping goes with; None where it is zero or changes its sign."""
        first, last = self.damping[[0, -1]]
        if not first * last > 0.0:
            return None
        return math.log(last / first) / math.log(self.amplitude[-1] / self.amplitude[0])

    @property
    def changes(self) -> tuple[int, int]:
        """Signs of the changes of damping and stiffness from the first to the last amplitude, 0 where there is none."""
        return _change(self.damping), _change(self.stiffness)


def _change(values: np.ndarray) -> int:
    change = float(values[-1] - values[0])
    return int(math.copysign(1.0, change)) if abs(change) > MIN_HARMONIC_SHARE * np.abs(values).max() else 0


def equivalent_law(law: BoundLaw, amplitude: np.ndarray, omega: float) -> EquivalentLaw | None:
    """Equivalent damping and stiffness of a force law on a body at amplitudes (n,) and an angular frequency.

    None where its internal states do not repeat, or the force is not finite. Harmonics that are rounding beside the
    force count as zero.
    """
    damping, stiffness = np.zeros((2, amplitude.size))
    weights = equivalent_weights(amplitude, omega)
    for index, own in enumerate(amplitude.tolist()):
        force = _forces(law, own, omega)
        if force is None or not np.isfinite(force).all():
            return None
        least = MIN_HARMONIC_SHARE * math.sqrt(float(np.mean(force**2)))
        k, c = (weights[:, index] @ force).tolist()
        stiffness[index] = k if abs(k) * own > least else 0.0
        damping[index] = c if abs(c) * own * omega > least else 0.0
    return EquivalentLaw(amplitude, damping, stiffness)


def _forces(law: BoundLaw, amplitude: float, omega: float) -> np.ndarray | None:
    """Force (INSTANTS,) over a period, whose internal states repeat; None where they do not."""
    halves = math.pi * np.arange(2 * INSTANTS + 1) / INSTANTS
    x, v = (amplitude * np.cos(halves)).tolist(), (-amplitude * omega * np.sin(halves)).tolist()
    h = 2.0 * math.pi / omega / INSTANTS
    z, rates = np.zeros(STATES), np.zeros((len(RUNGE_KUTTA_STAGES), STATES))
    force = np.zeros(INSTANTS)
    for _ in range(MAX_LAW_PERIODS if law.states else 1):
        before, largest = z.copy(), np.zeros(STATES)
        for k in range(INSTANTS):
            for stage, (share, half) in enumerate(RUNGE_KUTTA_STAGES if law.states else RUNGE_KUTTA_STAGES[:1]):
                at, here = 2 * k + half, z + share * h * rates[stage - 1] if stage else z
                answer = law.function((k + 0.5 * half) * h, x[at], v[at], law.p, here, rates[stage])
                force[k] = force[k] if stage else answer
            z = z + h / 6.0 * (rates[0] + 2.0 * rates[1] + 2.0 * rates[2] + rates[3]) if law.states else z
            largest = np.maximum(largest, np.abs(z))
        if (np.abs(z - before) <= MAX_PERIOD_CHANGE * largest).all():
            return force
    return None
