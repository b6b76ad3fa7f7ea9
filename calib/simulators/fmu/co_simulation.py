"""A co-simulation: the FMU integrates itself, from one communication step to the next."""

import math

import numpy as np

from calib.simulators.fmu.instance import Instance, RunFailed
from calib.simulators.fmu.signals import Signal

ON_GRID = 1e-6  # of a step: so near to a communication point, an output time is taken to be there


class CoSimulation:
    """Advances an instance by equal communication steps.

    The inputs are constant over a step, with their values in its middle; where the FMU interpolates its inputs, they
    get the value at its beginning and their mean rate. Outputs between communication points are interpolated linearly.

    Parameters
    ----------
    start : time of the initial state  [s]
    step : communication step  [s]
    budget : largest number of steps
    """

    def __init__(
        self, instance: Instance, signal: Signal, interpolates: bool, start: float, step: float, budget: int
    ) -> None:
        self._instance, self._signal, self._interpolates = instance, signal, interpolates
        self._start, self._step, self._budget = start, step, budget
        self._taken = 0
        self._row = self._before = self._checked(instance.read())

    def advance(self, times: np.ndarray) -> np.ndarray:
        """Outputs (time, output) at increasing times (time,) [s], none before the last communication step."""
        return np.array([self._at(float(time)) for time in times])

    def _at(self, time: float) -> np.ndarray:
        place = (time - self._start) / self._step  # in steps
        point = math.ceil(place - ON_GRID)
        while self._taken < point:
            self._advance(read=self._taken + 1 >= point - 1)
        share = place - (point - 1)
        return self._row if share >= 1.0 - ON_GRID else (1.0 - share) * self._before + share * self._row

    def _advance(self, read: bool) -> None:
        if self._taken >= self._budget:
            raise RunFailed("step budget", f"more than {self._budget} communication steps of {self._step:.3g} s")
        now, step = self._start + self._taken * self._step, self._step
        if self._interpolates:
            begin, end = self._signal(now), self._signal(now + step)
            self._instance.set_inputs(begin, [(b - a) / step for a, b in zip(begin, end, strict=True)])
        else:
            self._instance.set_inputs(self._signal(now + 0.5 * step))
        self._instance.step(now, step)
        self._taken += 1
        if read:
            self._before, self._row = self._row, self._checked(self._instance.read())

    def _checked(self, row: np.ndarray) -> np.ndarray:
        if not np.isfinite(row).all():
            raise self._instance.failed(
                "diverged", f"an output is no finite number at {self._start + self._taken * self._step:.6g} s"
            )
        return row
