"""The full kernel with its state, period by period."""

import math

import numpy as np
from numba import njit

from calib.record import OK
from calib.simulators import slots
from calib.simulators.delaminated_beam import explicit
from calib.simulators.delaminated_beam.explicit import Plan, Seen, State
from calib.simulators.delaminated_beam.stationary import Contact, Period

CAPACITY = 4096  # impacts that are noted


@njit(cache=True, nogil=True)
def drive_table(times, period, amplitude, phase, functions, parameters, count):
    """Displacement of the driven node at the times (n,), with the laws of the excitation  [m]."""
    table = np.empty(len(times))
    for k in range(len(times)):
        cycles = times[k] / period
        angle = 2.0 * math.pi * (cycles - math.floor(cycles)) + phase
        x = amplitude * math.cos(angle)
        table[k] = x
        for law in range(count):
            table[k] += slots.excitation(functions[law], times[k], angle, amplitude, x, parameters[law])
    return table


class Full:
    """The full kernel as an `Engine`.

    Parameters
    ----------
    plan, start : see `explicit`
    period, steps : of the drive [s], and how many steps it is divided into
    drive : amplitude [m] and phase [rad], then functions, parameters and count of the laws of the excitation
    budget : steps at most
    """

    def __init__(self, plan: Plan, start: State, period: float, steps: int, drive: tuple, budget: int):
        self.plan = plan
        self.now = start
        self._period, self._steps, self._drive, self._budget = period, steps, drive, budget
        self._table = None
        self.begin_notes()

    def period(self, samples: int) -> Period:
        """Go on by one period; see `stationary.Period`."""
        at = np.arange(samples) * (self._steps / samples)
        step = np.floor(at + 0.5).astype(np.int64)
        rows = np.zeros((samples, 5))
        done = int(self.now.count[0])
        if done + self._steps > self._budget:
            reason = f"{self._budget} steps were spent in period {done // self._steps + 1}, at {self._steps} a period"
            return Period("step budget", reason, rows[:, :4], rows[:, 4])
        seen = self._seen._replace(at=step, shift=at - step, samples=rows)
        time = done // self._steps * self._period
        code = explicit.advance(self.plan, self.now, time, self.drive(done // self._steps), seen)
        if code == explicit.UNSTABLE:
            reason = (
                f"velocities grew beyond {self.plan.limit:.3g} m/s in period {done // self._steps + 1} at a step of "
                f"{self.plan.step:.4g} s"
            )
            return Period("unstable step", reason, rows[:, :4], rows[:, 4])
        return Period(OK, "", rows[:, :4], rows[:, 4] * (samples / self._period))

    def drive(self, period: int) -> np.ndarray:
        """Where the driven node stands at the ends of the steps of a period  [m]."""
        if self._table is None or self._drive[4]:
            times = (period + np.arange(1, self._steps + 1) / self._steps) * self._period
            self._table = drive_table(times, self._period, *self._drive)
        return self._table

    def state(self) -> np.ndarray:
        """State at the end of the last period, over its largest displacement and velocity."""
        u = self.now.w - self.plan.beta * self.now.v
        largest = max(abs(u).max(), 1e-300), max(abs(self.now.v).max(), 1e-300)
        return np.concatenate([u / largest[0], self.now.v / largest[1]])

    def begin_notes(self) -> None:
        """Forget what contact did so far."""
        pairs = len(self.plan.slave)
        self._since = int(self.now.count[0])
        self._seen = Seen(
            at=np.zeros(0, dtype=np.int64),
            shift=np.zeros(0),
            samples=np.zeros((0, 5)),
            impacts=np.zeros((CAPACITY, 2)),
            central=np.zeros((CAPACITY, 2)),
            closed=np.zeros(pairs, dtype=np.int64),
            total=np.zeros(6),
            nearest=np.zeros(0),
            passes=np.full(3, np.inf),
        )

    def noted(self, periods: int) -> Contact:
        """What contact did since `begin_notes`."""
        seen, steps = self._seen, periods * self._steps
        impacts, central = seen.impacts[: int(seen.total[0])].copy(), seen.central[: int(seen.total[1])].copy()
        for rows in (impacts, central):
            rows[:, 0] = (rows[:, 0] - self._since) * self.plan.step
        return Contact(
            impacts, central, seen.closed / steps, float(seen.total[2] / steps), float(seen.total[3]),
            float(seen.total[4]),
        )  # fmt: skip
