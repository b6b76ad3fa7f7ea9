"""The way to a periodic motion from a state near it, by shooting: a few periods in the place of hundreds."""

import numpy as np
from scipy.optimize import NoConvergence, broyden1

from calib.simulators.impact import kernel
from calib.simulators.impact.problem import STEPS, ImpactState, Problem
from calib.simulators.impact.scratch import Scratch
from calib.simulators.impact.tangent import carry

CLOSE = 1e-11  # of the state's largest displacement or velocity: distance to its return that is none
MOST = 40  # periods that are spent
LAST = 1e-9  # distance that is accepted where rounding does not let it fall further


def shoot(
    problem: Problem, begin, q: np.ndarray, dq: np.ndarray, z: np.ndarray, w: Scratch, budget: int
) -> ImpactState | None:
    """State at phase zero that returns after one period, near (q, dq, z); None where there is none, or it is not found.

    Broyden's steps (1965) on P(x) - x, preconditioned by the derivative of the map without its force laws, which
    saltation gives exactly. A motion that this derivative calls unstable is not what waiting would lead to: None.

    Parameters
    ----------
    begin : (problem, q, dq) -> State, `calib.simulators.impact.run.start`
    q, dq : (n,) near the motion  [m], [m/s]
    budget : steps that the periods of the shooting may take together
    z : (SLOTS, n, STATES) internal states of the force laws
    """
    n = q.size
    length, speed = np.abs(q).max(initial=0.0), np.abs(dq).max(initial=0.0)
    length, speed = max(length, speed / problem.omega) or 1e-9, max(speed, length * problem.omega) or 1e-9
    inner = np.abs(z).max(initial=0.0) or 1.0
    scale = np.concatenate([np.full(n, length), np.full(n, speed), np.full(z.size if problem.counts[3] else 0, inner)])
    none = np.zeros((0, 2 * n + 2))

    def state(xi: np.ndarray) -> ImpactState:
        x = xi * scale
        now = begin(problem, x[:n], x[n : 2 * n])
        if x.size > 2 * n:
            now.z[:] = x[2 * n :].reshape(z.shape)
        return now

    latest, spent = (np.zeros(0), np.zeros(0)), 0

    def departure(xi: np.ndarray) -> np.ndarray:
        nonlocal latest
        if not np.array_equal(xi, latest[0]):
            latest = xi.copy(), gap_after_a_period(xi)
        return latest[1]

    def gap_after_a_period(xi: np.ndarray) -> np.ndarray:
        nonlocal spent
        now, row = state(xi), np.zeros((1, 2 * n + 2))
        code = kernel.advance(problem, now, w, 1, 0.0, budget - spent, row, np.zeros(0), none, none)
        spent += int(now.count[STEPS])
        if code != kernel.DONE:
            return np.full(xi.size, np.nan)
        reached = row[0, : 2 * n] if xi.size == 2 * n else np.concatenate([row[0, : 2 * n], now.z.ravel()])
        return solve(reached / scale - xi)

    start = np.concatenate([q, dq, z.ravel()])[: scale.size] / scale
    slopes = _derivative(problem, state(start), w, budget, scale[: 2 * n])
    if slopes is None:
        return None
    inverse = np.linalg.inv(np.eye(2 * n) - slopes)

    def solve(gap: np.ndarray) -> np.ndarray:
        return np.concatenate([inverse @ gap[: 2 * n], gap[2 * n :]])

    try:
        with np.errstate(all="ignore"):
            found = broyden1(departure, start, alpha=1.0, line_search=None, f_tol=CLOSE, maxiter=MOST)
    except NoConvergence as given_up:
        found = given_up.args[0]
    except ValueError:  # the motion fails on the way
        return None
    if not np.abs(departure(found)).max() < LAST:
        return None
    slopes = _derivative(problem, state(found), w, budget, scale[: 2 * n])
    stable = slopes is not None and np.abs(np.linalg.eigvals(slopes)).max() < 1.0
    return state(found) if stable else None


def _derivative(problem: Problem, state: ImpactState, w: Scratch, budget: int, scale: np.ndarray) -> np.ndarray | None:
    """Derivative (2 n, 2 n) of the map of a period without force laws, in units of `scale`; None where it fails."""
    counts = problem.counts.copy()
    counts[[0, 3]] = 0
    size = scale.size
    vectors, growth = np.eye(size), np.zeros((1, size, size))
    rows = np.zeros((1, size + 2))
    code, _ = carry(problem._replace(counts=counts), state, w, 1, budget, scale, rows, vectors, growth)
    slopes = vectors @ growth[0]
    usable = code == kernel.DONE and np.isfinite(slopes).all() and np.linalg.cond(np.eye(size) - slopes) < 1e12
    return slopes if usable else None
