"""One step of the exact integration, with loads and witnesses that stand in for those of a problem."""

from types import SimpleNamespace

import numpy as np

from calib.simulators.impact import step as steps
from calib.simulators.impact.problem import Loads


def test_a_step_is_found_where_its_loads_do_not_hold_up_to_the_event(monkeypatch):
    """They hold over a second; the event seems to be earlier in every step, and later once the step ends with it."""
    problem = SimpleNamespace(
        exact=True,
        loads=Loads(by_rate=False),
        stop=True,
        counts=[1, 0],
        step=1.6,
        resolution=1e-9,
        lift=0.0,
        regimes=None,
        omega=1.0,
    )
    state = SimpleNamespace(counters=np.zeros(16, dtype=int), clock=[0.0], y=None, v=None)
    w = SimpleNamespace(resolved_step=[1.6], load=None, added=None)
    monkeypatch.setattr(steps, "_step_length", lambda problem, state: 1.6)
    monkeypatch.setattr(steps, "set_loads", lambda *args: steps.LOADS_HOLD if args[4] <= 1.0 else steps.MISSED_BETWEEN)
    monkeypatch.setattr(steps, "flow", lambda *state: None)
    monkeypatch.setattr(steps, "witness", lambda *state: (0.5, -1.0, 0.0, 0.0))  # half a second more
    monkeypatch.setattr(steps, "first_zero", lambda *state: (steps.EVENT, 0.9 * state[10], 1))
    outcome, tau, step = steps.next_step_out_of_compliance.py_func(problem, state, w, None, None)
    assert outcome == steps.EVENT
    assert tau < step <= 1.0
    assert state.counters[steps.STEPS] < 20
