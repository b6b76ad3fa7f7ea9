"""The full kernel with its state, period by period."""

from collections.abc import Callable

import numpy as np

from calib.records import OK
from calib.simulators.delaminated_beam.explicit.energy import audit
from calib.simulators.delaminated_beam.explicit.plan import STEPS_DONE, ExplicitPlan, ExplicitState, ExplicitTrace
from calib.simulators.delaminated_beam.explicit.stepping import UNSTABLE, advance
from calib.simulators.delaminated_beam.stationary import MAX_IMPACTS, Contact, Period, normalised


class FullEngine:
    """The full kernel as an `Engine`.

    Parameters
    ----------
    plan, start : see `explicit`
    gather : the kernel's order -> nodal values (n, 2)
    free : freedoms of the nodes that are neither held nor driven
    still : (2 n,) displacements and velocities of the static shape at phase zero  [m], [m/s]
    period, steps : of the drive [s], and how many steps it is divided into
    drive : (period, steps) -> displacements of the driven node at the ends of its steps  [m]
    budget : steps at most
    """

    def __init__(
        self,
        plan: ExplicitPlan,
        start: ExplicitState,
        gather: Callable[[np.ndarray], np.ndarray],
        free: np.ndarray,
        still: tuple[np.ndarray, np.ndarray],
        period: float,
        steps: int,
        drive: Callable[[int, int], np.ndarray],
        budget: int,
    ) -> None:
        self.plan = plan
        self.now = start
        self._gather, self._free, self._still = gather, free, still
        self._period, self._steps, self._drive, self._budget = period, steps, drive, budget
        self.begin_record()

    def period(self, samples: int) -> Period:
        """Go on by one period; see `stationary.Period`."""
        at = np.arange(samples) * (self._steps / samples)
        step = np.floor(at + 0.5).astype(np.int64)
        rows = np.zeros((samples, 5))
        done = int(self.now.counters[STEPS_DONE])
        if done + self._steps > self._budget:
            reason = (
                f"{self._budget} steps were spent in period {done // self._steps + 1}, at {self._steps} a period; "
                "raise step_budget or dt, or lower settle_limit"
            )
            return Period("step budget", reason, rows[:, :4], rows[:, 4])
        trace = self._trace._replace(at=step, shift=at - step, samples=rows)
        time = done // self._steps * self._period
        code = advance(self.plan, self.now, time, self._drive(done // self._steps, self._steps), trace)
        if code == UNSTABLE:
            reason = (
                f"velocities grew beyond {self.plan.limit:.3g} m/s in period {done // self._steps + 1} at a step of "
                f"{self.plan.step:.4g} s"
            )
            return Period("unstable step", reason, rows[:, :4], rows[:, 4])
        return Period(OK, "", rows[:, :4], rows[:, 4] * (samples / self._period))

    def state(self) -> np.ndarray:
        """State at the end of the last period, over its largest displacement and velocity."""
        u = self.now.w - self.plan.beta * self.now.v
        return normalised(u, self.now.v)

    def map_state(self) -> np.ndarray:
        """Displacements and velocities (2 * free,) of the free nodes beyond the static shape, after a period."""
        u = self._gather(self.now.w - self.plan.beta * self.now.v).ravel() - self._still[0]
        v = self._gather(self.now.v).ravel() - self._still[1]
        return np.concatenate([u[self._free], v[self._free]])

    def middle(self) -> np.ndarray:
        """Displacements and velocities (4,) of beam and layer in the middle, at the end of the last period."""
        ahead = ExplicitState(*(array.copy() for array in self.now))
        trace = self._empty()._replace(at=np.zeros(1, dtype=np.int64), shift=np.zeros(1), samples=np.zeros((1, 5)))
        done = int(self.now.counters[STEPS_DONE]) // self._steps
        first = self._drive(done, self._steps)[:1]
        advance(self.plan, ahead, done * self._period, first, trace)
        return trace.samples[0, :4]

    def balance(self, elastic: Callable[[np.ndarray], float]) -> dict[str, float]:
        """Go on by a period and return its energy balance  [J].

        Parameters
        ----------
        elastic : displacements of the nodes (n, 2) [m] -> elastic energy [J]

        Returns
        -------
        work of the drive, what alpha, beta and contact took of it, what the beam holds more of at the end, and what is
        not accounted for: the work of force laws, and the error of the sum
        """
        energies, stored = np.zeros((2, 6)), np.zeros(2)
        done = int(self.now.counters[STEPS_DONE]) // self._steps
        drive = self._drive(done, self._steps), self._drive(done + 1, self._steps)[:1]
        for k in range(2):  # one more step, for the kinetic energy at the end
            now = self.now if k == 0 else ExplicitState(*(array.copy() for array in self.now))
            stored[k] = elastic(self._gather(now.w - self.plan.beta * now.v))
            audit(self.plan, now, (done + k) * self._period, drive[k], energies[k])
        work, alpha, beta, contact = energies[0, :4]
        change = energies[1, 4] + stored[1] - energies[0, 4] - stored[0]
        return {
            "work_of_drive": work,
            "lost_to_alpha": alpha,
            "lost_to_beta": beta,
            "lost_in_contact": contact,
            "energy_gained": change,
            "energy_unaccounted": work - alpha - beta - contact - change,
        }

    def near_misses(self, minima: np.ndarray) -> int:
        """Write the local minima of the clearance over one period [m]; return how many there are."""
        trace = self._trace._replace(nearest=minima)
        done = int(self.now.counters[STEPS_DONE]) // self._steps
        advance(self.plan, self.now, done * self._period, self._drive(done, self._steps), trace)
        return int(trace.passes[2])

    def begin_record(self) -> None:
        """Begin the record of contact anew."""
        self._since = int(self.now.counters[STEPS_DONE])
        self._trace = self._empty()

    def _empty(self) -> ExplicitTrace:
        return ExplicitTrace(
            at=np.zeros(0, dtype=np.int64),
            shift=np.zeros(0),
            samples=np.zeros((0, 5)),
            impacts=np.zeros((MAX_IMPACTS, 2)),
            central=np.zeros((MAX_IMPACTS, 2)),
            closed=np.zeros(len(self.plan.slave), dtype=np.int64),
            total=np.zeros(5),
            nearest=np.zeros(0),
            passes=np.array([np.inf, np.inf, 0.0]),
        )

    def contact_recorded(self, periods: int) -> Contact:
        """Contact since `begin_record`."""
        return Contact.of(self._trace, self._since, periods * self._steps, self.plan.step)
