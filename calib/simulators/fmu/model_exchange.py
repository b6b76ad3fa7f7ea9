"""A model exchange: the FMU gives derivatives and event indicators, and scipy's solvers integrate."""

import numpy as np
from scipy.integrate import BDF, DOP853, RK45, OdeSolver, Radau

from calib.errors import CalibError
from calib.simulators.fmu.instance import Instance, RunFailed
from calib.simulators.fmu.signals import Signal

SOLVERS: dict[str, type[OdeSolver]] = {"RK45": RK45, "DOP853": DOP853, "Radau": Radau, "BDF": BDF}
ABSOLUTE_SHARE = 1e-3  # absolute tolerance of a state, over the relative one times its nominal value  [1]
EVENT_INTERVAL = 1e-13  # s: width of the interval in which an event is located
MAX_BISECTIONS = 60  # of a step, where the rounding of time is wider than that


class ModelExchange:
    """Integrates the continuous states of an instance, locates its events and updates its discrete states there.

    Parameters
    ----------
    reports_steps : whether each step is reported to the FMU
    start : time of the initial state  [s]
    solver : name of one of `SOLVERS`
    tolerance : relative one of the solver  [1]
    max_step : longest step; an event indicator that changes its sign twice within a step is not seen  [s]
    budget : largest number of steps

    Raises
    ------
    CalibError : the FMU has no continuous states
    """

    def __init__(
        self, instance: Instance, signal: Signal, reports_steps: bool, start: float, solver: str, tolerance: float,
        max_step: float, budget: int,
    ) -> None:  # fmt: skip
        if not instance.states:
            raise CalibError('the FMU has no continuous states to integrate; use interface = "co-simulation"')
        self._instance, self._signal, self._reports_steps = instance, signal, reports_steps
        self._solver, self._tolerance, self._max_step, self._budget = SOLVERS[solver], tolerance, max_step, budget
        self._taken = 0
        self._time = start
        self._next_event = instance.enter_continuous_time()
        self._state = instance.continuous_states()
        self._place(start, self._state)
        self._positive = instance.event_indicators() > 0.0

    def advance(self, times: np.ndarray) -> np.ndarray:
        """Outputs (time, output) at increasing times (time,) [s]; the integration ends at the last of them."""
        rows = list[np.ndarray]()
        while len(rows) < times.size:
            bound = min(float(times[-1]), self._next_event)
            if bound > self._time:
                self._integrate(bound, times, rows)
            else:
                while len(rows) < times.size and times[len(rows)] <= self._time:
                    rows.append(self._outputs(self._time))
                if len(rows) < times.size:
                    self._event()
        return np.array(rows)

    def _integrate(self, bound: float, times: np.ndarray, rows: list[np.ndarray]) -> None:
        """Integrate up to `bound` [s] or the next event; outputs at the times on the way are added to `rows`."""
        nominal = np.abs(self._instance.nominals())
        solver = self._solver(
            self._rates, self._time, self._state, bound, max_step=self._max_step, rtol=self._tolerance,
            atol=ABSOLUTE_SHARE * self._tolerance * np.where(nominal > 0.0, nominal, 1.0),
        )  # fmt: skip
        while solver.status == "running":
            if self._taken >= self._budget:
                raise RunFailed("step budget", f"more than {self._budget} steps of the solver")
            message = solver.step()
            self._taken += 1
            if solver.status == "failed":
                raise self._instance.failed("step failure", f"at {solver.t:.6g} s: {message}")
            states = solver.dense_output()
            event = self._first_event(states, solver.t_old, solver.t, solver.y)
            self._time = solver.t if event is None else event
            while len(rows) < times.size and times[len(rows)] <= self._time:
                time = float(times[len(rows)])
                self._place(time, states(time))
                rows.append(self._outputs(time))
            self._state = solver.y.copy() if event is None else states(event)
            self._place(self._time, self._state)
            reported = self._reports_steps and self._instance.completed_step()
            if event is not None or reported:
                self._event()
                return

    def _first_event(self, states: OdeSolver, begin: float, end: float, last: np.ndarray) -> float | None:
        """Time of the first change of an indicator's sign in a step, from after it [s]; None without one."""
        if not self._instance.indicators:
            return None
        self._place(end, last)
        if not self._changed():
            return None
        for _ in range(MAX_BISECTIONS):
            if end - begin <= EVENT_INTERVAL:
                break
            middle = 0.5 * (begin + end)
            self._place(middle, states(middle))
            begin, end = (begin, middle) if self._changed() else (middle, end)
        return end

    def _changed(self) -> bool:
        return bool(((self._instance.event_indicators() > 0.0) != self._positive).any())

    def _event(self) -> None:
        """Update the discrete states at the present time, and take the continuous ones that this leaves."""
        self._place(self._time, self._state)
        self._next_event = self._instance.update()
        if self._next_event <= self._time:
            raise RunFailed("step failure", f"the FMU announces an event at {self._next_event:.6g} s, in the past")
        self._state = self._instance.continuous_states()
        self._positive = self._instance.event_indicators() > 0.0

    def _rates(self, time: float, state: np.ndarray) -> np.ndarray:
        self._place(time, state)
        rates = self._instance.rates()
        if not np.isfinite(rates).all():
            raise self._instance.failed("diverged", f"a derivative is no finite number at {time:.6g} s")
        return rates

    def _place(self, time: float, state: np.ndarray) -> None:
        self._instance.place(time, state, self._signal(time))

    def _outputs(self, time: float) -> np.ndarray:
        row = self._instance.read()
        if not np.isfinite(row).all():
            raise self._instance.failed("diverged", f"an output is no finite number at {time:.6g} s")
        return row
