"""The stationary motion of an FMU under a harmonic excitation: periods until it has settled, then those recorded."""

from typing import Protocol

import numpy as np

PROBES = 8  # samples a period while the motion settles
MAX_SETTLED_RETURN = 4  # periods after which a settled motion is looked for again
MAX_SETTLED_CHANGE = 1e-5  # largest change of a settled motion, over the peak-to-peak value of each output
MAX_SETTLING = 300  # periods; whether a motion that goes on changing has settled is judged by its section


class Advancing(Protocol):
    """What runs an FMU on."""

    def advance(self, times: np.ndarray) -> np.ndarray:
        """Outputs (time, output) at increasing times (time,) [s], the first of them not before the last one so far."""
        ...


def settled_motion(run: Advancing, period: float, samples: int, periods: int, settle: int | None) -> np.ndarray:
    """Outputs (periods * samples, output) at equal intervals from phase zero on, after the motion has settled.

    Parameters
    ----------
    run : at time 0
    period : of the excitation  [s]
    settle : periods to drop first; None: until the motion returns after 1 to 4 periods, at most `MAX_SETTLING`
    """
    dropped = _settle(run, period) if settle is None else settle
    return run.advance(period * (dropped * samples + np.arange(periods * samples)) / samples)


def _settle(run: Advancing, period: float) -> int:
    """Run on until the motion has settled; number of periods that this took."""
    cycles = list[np.ndarray]()
    for number in range(MAX_SETTLING):
        cycle = run.advance(period * (number * PROBES + np.arange(1, PROBES + 1)) / PROBES)
        size = np.ptp(cycle, axis=0)
        if any((np.abs(cycle - before) <= MAX_SETTLED_CHANGE * size).all() for before in cycles):
            return number + 1
        cycles = [*cycles[-MAX_SETTLED_RETURN + 1 :], cycle]
    return MAX_SETTLING
