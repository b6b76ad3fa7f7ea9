"""The reduced kernel with its state, period by period."""

from collections.abc import Callable

import numpy as np

from calib.records import OK
from calib.simulators.delaminated_beam.reduced.plan import ReducedPlan, ReducedState, ReducedTrace
from calib.simulators.delaminated_beam.reduced.stepping import DIVERGED, advance
from calib.simulators.delaminated_beam.stationary import MAX_IMPACTS, Contact, Period, normalised


class ReducedEngine:
    """The reduced kernel as an `Engine`.

    Parameters
    ----------
    plan : see `reduced`
    period : of the drive  [s]
    table : period number -> (steps * parts + 1, 3) X, X', X'' + alpha X' at the ends of all parts, see `drive`
    state : (2 n,) modal coordinates and rates
    budget : steps and parts at most
    """

    def __init__(
        self, plan: ReducedPlan, period: float, table: Callable[[int], np.ndarray], state: np.ndarray, budget: int
    ) -> None:
        n, m = len(plan.flight.qq), len(plan.clearance)
        self.plan = plan
        self.now = ReducedState(
            q=np.append(state[:n], 0.0),
            v=np.append(state[n:], 0.0),
            push=np.zeros(m),
            kick=np.zeros(n),
            near=np.zeros(m, dtype=np.int64),
            last=np.full(2, -np.inf),
            counters=np.zeros(1, dtype=np.int64),
        )
        self._period, self._table, self._budget = period, table, budget
        self._done = 0
        self.begin_record()

    def period(self, samples: int) -> Period:
        """Go on by one period; see `stationary.Period`."""
        rows = np.zeros((samples, 5))
        if self.now.counters[0] >= self._budget:
            reason = (
                f"{self._budget} steps were spent by period {self._done + 1}; raise step_budget, or lower settle_limit"
            )
            return Period("step budget", reason, rows[:, :4], rows[:, 4])
        trace = self._trace._replace(times=np.arange(samples) * (self._period / samples), samples=rows)
        self.now.push[:] = 0.0  # no part of the state: what the modes left out yields anew
        code = advance(self.plan, self.now, self._done * self._period, self._table(self._done), trace)
        self._done += 1
        if code == DIVERGED:
            reason = f"the motion grew beyond {self.plan.limit:.3g} m in period {self._done}"
            return Period("diverged", reason, rows[:, :4], rows[:, 4])
        return Period(OK, "", rows[:, :4], rows[:, 4] * (samples / self._period))

    def state(self) -> np.ndarray:
        """State at the end of the last period, over its largest displacement and velocity."""
        return normalised(self.now.q[:-1], self.now.v[:-1])

    def map_state(self) -> np.ndarray:
        """Modal coordinates and rates (2 n,)."""
        return np.concatenate([self.now.q[:-1], self.now.v[:-1]])

    def carried(self, count: int) -> np.ndarray:
        """State in so many modes, at least as many as there are: the further ones at rest."""
        state = np.zeros((2, count))
        state[:, : len(self.now.q) - 1] = self.map_state().reshape(2, -1)
        return state.ravel()

    def middle(self) -> np.ndarray:
        """Displacements and velocities (4,) of beam and layer in the middle, at the end of the last period."""
        q, v, layer = self.now.q, self.now.v, self.plan.layer
        return np.array([q[-1], layer @ q, v[-1], layer @ v])

    def near_misses(self, minima: np.ndarray) -> int:
        """Write the local minima of the clearance over one period [m]; return how many there are."""
        trace = self._trace._replace(nearest=minima)
        advance(self.plan, self.now, self._done * self._period, self._table(self._done), trace)
        return int(trace.passes[2])

    def begin_record(self) -> None:
        """Begin the record of contact anew."""
        self._since = self._done * self._period
        self._trace = ReducedTrace(
            times=np.zeros(0),
            samples=np.zeros((0, 5)),
            impacts=np.zeros((MAX_IMPACTS, 2)),
            central=np.zeros((MAX_IMPACTS, 2)),
            closed=np.zeros(len(self.plan.clearance)),
            total=np.zeros(5),
            nearest=np.zeros(0),
            passes=np.array([np.inf, np.inf, 0.0]),
        )

    def contact_recorded(self, periods: int) -> Contact:
        """Contact since `begin_record`."""
        return Contact.of(self._trace, self._since, periods * self._period)
