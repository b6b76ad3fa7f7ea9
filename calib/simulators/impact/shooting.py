"""The way to a periodic motion from a state near it, by shooting: a few periods in the place of hundreds."""

import numpy as np
from scipy.optimize import NoConvergence, broyden1

from calib.simulators.impact import kernel
from calib.simulators.impact.initial_state import coordinates_at_phase_zero, remembers_speed, start
from calib.simulators.impact.problem import FORCE_LAWS, LAW_STATES, STEPS, ImpactState, Problem
from calib.simulators.impact.scratch import Scratch
from calib.simulators.impact.tangent import carry

# distances of a state to its return after a period, as shares of its largest displacement or velocity
CONVERGED_DISTANCE = 1e-11
ACCEPTED_DISTANCE = 1e-9  # where rounding does not let it fall further
MAX_PERIODS = 40  # that Broyden's steps may take
MAX_CONDITION = 1e12  # of the matrix that the derivative of the return gives


class _Return:
    """The departure P(x) - x of a scaled state x = (q, q', internal states of laws) after a period.

    Attributes
    ----------
    scale : (2 n,) or with the internal states (2 n + (force laws) (n + 1) STATES,), in units of which x is given
    inverse : (2 n, 2 n) preconditioner
    spent : steps so far
    """

    def __init__(self, problem: Problem, w: Scratch, budget: int, scale: np.ndarray, inverse: np.ndarray) -> None:
        self.problem, self.w, self.budget, self.scale, self.inverse = problem, w, budget, scale, inverse
        self.spent = 0
        self._latest = np.zeros(0), np.zeros(0)

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Preconditioned departure, NaN where the motion fails; that of the state asked for last is remembered."""
        if not np.array_equal(x, self._latest[0]):
            self._latest = x.copy(), self._departure(x)
        return self._latest[1]

    def _departure(self, x: np.ndarray) -> np.ndarray:
        size = 2 * len(self.problem.hit)
        state, row, none = _state(self.problem, x * self.scale), np.zeros((1, size + 2)), np.zeros((0, size + 2))
        outcome = kernel.advance(
            self.problem, state, self.w, 1, 0.0, self.budget - self.spent, row, np.zeros(0), none, none
        )
        self.spent += int(state.counters[STEPS])
        if outcome != kernel.DONE:
            return np.full(x.size, np.nan)
        reached = row[0, :size] if x.size == size else np.concatenate([row[0, :size], state.z.ravel()])
        departure = reached / self.scale - x
        return np.concatenate([self.inverse @ departure[:size], departure[size:]])


def shoot(problem: Problem, state: ImpactState, w: Scratch, budget: int) -> ImpactState | None:
    """State at phase zero near `state` that returns after one period; None where there is none, or it is not found.

    Broyden's steps (1965) on P(x) - x, preconditioned by the derivative of the map without its force laws, which
    saltation gives exactly. A motion that this derivative calls unstable is not what waiting would lead to: None. None,
    too, where the contact remembers its closing speed.

    Parameters
    ----------
    state : at phase zero
    budget : steps that the periods of the shooting may take together
    """
    if remembers_speed(problem):
        return None
    q, dq = coordinates_at_phase_zero(problem, state)
    scale, size = _scale(problem, q, dq, state.z), 2 * q.size
    begin = np.concatenate([q, dq, state.z.ravel()])[: scale.size] / scale
    slopes = _derivative(problem, _state(problem, begin * scale), w, budget, scale[:size])
    if slopes is None:
        return None
    departure = _Return(problem, w, budget, scale, np.linalg.inv(np.eye(size) - slopes))
    x = _root(departure, begin)
    if x is None or not np.abs(departure(x)).max() < ACCEPTED_DISTANCE:
        return None
    slopes = _derivative(problem, _state(problem, x * scale), w, budget, scale[:size])
    stable = slopes is not None and np.abs(np.linalg.eigvals(slopes)).max() < 1.0
    return _state(problem, x * scale) if stable else None


def _root(departure: _Return, begin: np.ndarray) -> np.ndarray | None:
    """State at which Broyden's steps end, the last one where they do not converge; None where the motion fails."""
    try:
        with np.errstate(all="ignore"):
            return broyden1(
                departure, begin, alpha=1.0, line_search=None, f_tol=CONVERGED_DISTANCE, maxiter=MAX_PERIODS
            )
    except NoConvergence as given_up:
        return given_up.args[0]
    except ValueError:
        return None


def _state(problem: Problem, x: np.ndarray) -> ImpactState:
    """State at phase zero of q [m], q' [m/s] and, where there are more numbers, internal states of the laws."""
    n = len(problem.hit)
    state = start(problem, x[:n], x[n : 2 * n])
    if x.size > 2 * n:
        state.z[:] = x[2 * n :].reshape(state.z.shape)
    return state


def _scale(problem: Problem, q: np.ndarray, dq: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Units of a state: one for all displacements [m], velocities [m/s], internal states, where laws have these."""
    length, speed = np.abs(q).max(initial=0.0), np.abs(dq).max(initial=0.0)
    length, speed = max(length, speed / problem.omega) or 1e-9, max(speed, length * problem.omega) or 1e-9
    inner = np.abs(z).max(initial=0.0) or 1.0
    return np.concatenate(
        [np.full(q.size, length), np.full(q.size, speed), np.full(z.size if problem.counts[LAW_STATES] else 0, inner)]
    )


def _derivative(problem: Problem, state: ImpactState, w: Scratch, budget: int, scale: np.ndarray) -> np.ndarray | None:
    """Derivative (2 n, 2 n) of the map of a period without force laws, in units of `scale`; None where it fails."""
    counts = problem.counts.copy()
    counts[[FORCE_LAWS, LAW_STATES]] = 0
    size = scale.size
    vectors, growth = np.eye(size), np.zeros((1, size, size))
    rows = np.zeros((1, size + 2))
    outcome, _ = carry(problem._replace(counts=counts), state, w, 1, budget, scale, rows, vectors, growth)
    slopes = vectors @ growth[0]
    if outcome != kernel.DONE or not np.isfinite(slopes).all():
        return None
    return slopes if np.linalg.cond(np.eye(size) - slopes) < MAX_CONDITION else None
