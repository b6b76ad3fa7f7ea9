"""Periodic orbits by shooting."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calib.dynamics.tangent import jacobian
from calib.errors import CalibError
from calib.modelling.orbit import Orbit, PeriodMap
from calib.records import OK

RESIDUAL_TOLERANCE = 1e-11  # of the residual, in units of the scale
ROUNDING_RESIDUAL = 1e-8  # in units of the scale: accepted where rounding does not let the residual fall further
MAX_ROUNDING_REDUCTION = 0.5  # by which a step lowers a residual that is rounding
MAX_NEWTON_HALVINGS = 8  # of a Newton step that does not lower the residual
GRAZING_MARGIN = 1e-3  # below it the derivative is not to be trusted: it has a square root singularity at margin 0
MAX_QUICK_STEPS = 6  # of Newton's method from a close return
CONVERGING_RESIDUAL = 1e-6  # residual, in units of the scale, from which Newton's method converges
NEUTRAL_MULTIPLIER = 1e-5  # the multipliers of a cycle that attracts are below 1 by more than this
SAME_STATE_DISTANCE = 1e-7  # in units of the scale: distance of states that count as one


@dataclass(frozen=True)
class Cycle:
    """A motion that comes back to its state after whole periods, or the attempt to find one.

    Attributes
    ----------
    state : (dimension,) at the section, each component in its unit
    periods : whole periods of one return
    multipliers : (dimension,) complex eigenvalues of the derivative of one return, by falling modulus; NaN where the
        attempt failed
    steps : distance between the state and its return before and after each Newton step, in units of the scale
    orbit : one return; its `displacement` and `velocity` (body, periods)  [m], [m/s]
    near_misses : (k,) local minima of the clearance over one return  [m]
    margin : how far the motion is from grazing [1]: the smaller of the nearest miss over the scale of displacements and
        the slowest closing speed over the fastest (over the scale of velocities, if that is larger); inf where there
        is neither. A motion with permanent contact has chatter, which slows down to nothing without grazing: there
        only the near misses count.
    reason : why the attempt failed, empty for a periodic motion
    """

    state: np.ndarray
    periods: int
    multipliers: np.ndarray
    steps: tuple[float, ...]
    orbit: Orbit
    near_misses: np.ndarray
    margin: float
    reason: str = ""

    @property
    def converged(self) -> bool:
        """Whether the state comes back."""
        return not self.reason

    @property
    def residual(self) -> float:
        """Distance between the state and its return, in units of the scale."""
        return self.steps[-1]

    @property
    def exponent(self) -> float:
        """Largest Lyapunov exponent [1, per period of the excitation]; NaN where there is no cycle."""
        growth = abs(self.multipliers[0])
        return -math.inf if growth == 0.0 else math.log(growth) / self.periods

    @property
    def stable(self) -> bool:
        """Whether neighbours come closer; says little where the motion is `grazing`."""
        return bool(abs(self.multipliers[0]) < 1.0)

    @property
    def impacts(self) -> int:
        """Impacts per return."""
        return len(self.orbit.impacts)

    @property
    def slowest(self) -> float:
        """Least closing speed of the impacts [m/s], inf without impacts."""
        return float(self.orbit.impacts[:, 2].min(initial=math.inf))

    @property
    def nearest(self) -> float:
        """Least clearance that an impact was missed by [m], inf without near misses."""
        return float(self.near_misses.min(initial=math.inf))

    @property
    def grazing(self) -> bool:
        """Whether the multipliers are not to be trusted, as an impact is about to appear or to vanish.

        Source: Nordmark, Journal of Sound and Vibration 145 (1991) 279-297.
        """
        return self.margin < GRAZING_MARGIN


def shoot(map: PeriodMap, guess: np.ndarray, periods: int = 1, most: int = 20) -> Cycle:
    """Periodic motion near `guess` (dimension,), by damped Newton steps on P^periods(x) - x in units of the scale.

    Where Newton's method converges to none, `reason` of the cycle states why. Its period may be a divisor of
    `periods`; see `reduced`.

    Raises
    ------
    CalibError : a guess that is no state of this map, or less than one period
    """
    guess = checked_guess(map, guess, periods)
    identity = np.eye(guess.size)
    xi, steps, reason = newton(
        lambda xi: _departure(map, xi * map.scale, periods),
        lambda xi: jacobian(map, xi * map.scale, periods)[1] - identity,
        guess / map.scale,
        most,
    )
    unknown = np.full((xi.size, xi.size), np.nan)
    derivative = unknown if reason else jacobian(map, xi * map.scale, periods)[1]
    return cycle_at(map, xi * map.scale, periods, derivative, steps, reason)


def attracting_cycle(map: PeriodMap, guess: np.ndarray, periods: int, reach: float) -> Cycle | None:
    """Stable cycle next to a guess (dimension,), with its least period; None where a few steps do not find one.

    Newton's steps are not damped: a guess that is no close return is given up soon, at a tenth of the cost of `shoot`.

    Parameters
    ----------
    reach : how far from the guess the cycle may be, in units of the scale
    """
    state, identity = np.asarray(guess, dtype=float), np.eye(len(guess))
    for _ in range(MAX_QUICK_STEPS):
        end, derivative = jacobian(map, state, periods)
        departure = (end - state) / map.scale
        step = _newton_step(derivative - identity, departure)
        if step is None or np.abs((state - guess) / map.scale + step).max() > reach:
            return None
        state = state + step * map.scale
        if np.linalg.norm(departure) <= CONVERGING_RESIDUAL:
            break
    else:
        return None
    if not _attracts(np.linalg.eigvals(derivative)):
        return None
    cycle = reduced(map, shoot(map, state, periods))
    return cycle if cycle.converged and _attracts(cycle.multipliers) else None


def _attracts(multipliers: np.ndarray) -> bool:
    return bool(np.abs(multipliers).max() < 1.0 - NEUTRAL_MULTIPLIER)


def reduced(map: PeriodMap, cycle: Cycle) -> Cycle:
    """Return the cycle with its least period, a divisor of the one it was sought with."""
    for periods in range(1, cycle.periods if cycle.converged else 1):
        if (
            cycle.periods % periods == 0
            and _distance(map, cycle.orbit.states[periods - 1], cycle.state) < SAME_STATE_DISTANCE
        ):
            shorter = shoot(map, cycle.state, periods)
            if shorter.converged and _distance(map, shorter.state, cycle.state) < SAME_STATE_DISTANCE:
                return shorter
    return cycle


def checked_guess(map: PeriodMap, guess: np.ndarray, periods: int) -> np.ndarray:
    """Return the guess as an array (dimension,) where it can be a state of the map."""
    guess = np.asarray(guess, dtype=float)
    if guess.shape != map.scale.shape or not np.isfinite(guess).all():
        raise CalibError(
            f"expected a guess of {map.scale.size} finite numbers ({', '.join(map.names)}), got {guess.tolist()}; "
            "the map's `initial` is one"
        )
    if periods < 1:
        raise CalibError(f"expected at least 1 period, got {periods}")
    return guess


def newton(
    residual: Callable[[np.ndarray], np.ndarray],
    derivative: Callable[[np.ndarray], np.ndarray],
    start: np.ndarray,
    most: int,
) -> tuple[np.ndarray, tuple[float, ...], str]:
    """Root of `residual` near `start` (n,), norms of the residual after 0, 1, ... steps, and why there is none or "".

    residual (n,) -> (n,) and derivative (n,) -> (n, n) are NaN where they are not known. A step is halved until it
    lowers the residual.
    """
    root, value = start, residual(start)
    sizes = [float(np.linalg.norm(value))]
    reason = "" if np.isfinite(sizes[0]) else "the motion fails from the guess"
    while not reason and sizes[-1] > RESIDUAL_TOLERANCE:
        if len(sizes) > most:
            reason = f"{most} Newton steps leave a residual of {sizes[-1]:.1e}"
            break
        step = _newton_step(derivative(root), value)
        if step is None:
            reason = "the derivative is singular, or the motion fails beside the state"
            break
        for halving in range(MAX_NEWTON_HALVINGS):
            ahead = root + 0.5**halving * step
            ahead_value = residual(ahead)
            if np.linalg.norm(ahead_value) < sizes[-1]:  # false for NaN
                break
        else:
            reason = f"the residual stays at {sizes[-1]:.1e}" if sizes[-1] > ROUNDING_RESIDUAL else ""
            break
        root, value = ahead, ahead_value
        sizes.append(float(np.linalg.norm(value)))
        if MAX_ROUNDING_REDUCTION * sizes[-2] < sizes[-1] <= ROUNDING_RESIDUAL:
            break
    return root, tuple(sizes), reason


def cycle_at(
    map: PeriodMap, state: np.ndarray, periods: int, derivative: np.ndarray, steps: tuple[float, ...], reason: str = ""
) -> Cycle:
    """Describe the periodic motion through `state`, or the attempt that ended there for `reason`.

    derivative : (dimension, dimension) of one return, in units of the scale; NaN where it is not known
    """
    orbit = map.orbit(state, periods)
    if not np.isfinite(derivative).all():
        unknown = np.full(state.size, complex(math.nan, math.nan))
        reason = reason or "the derivative is not known: the motion fails beside the state"
        return Cycle(state, periods, unknown, steps, orbit, np.zeros(0), math.inf, reason)
    multipliers = np.linalg.eigvals(derivative).astype(complex)
    multipliers = multipliers[np.argsort(-np.abs(multipliers), kind="stable")]  # stable: pairs stay side by side
    near_misses = np.concatenate([map.near_misses(x) for x in (state, *orbit.states[:-1])])
    return Cycle(state, periods, multipliers, steps, orbit, near_misses, margin(map, orbit, near_misses))


def _newton_step(matrix: np.ndarray, value: np.ndarray) -> np.ndarray | None:
    if not np.isfinite(matrix).all():
        return None
    try:
        return np.linalg.solve(matrix, -value)
    except np.linalg.LinAlgError:
        return None


def _departure(map: PeriodMap, state: np.ndarray, periods: int) -> np.ndarray:
    """P^periods(x) - x (dimension,) in units of the scale, NaN where the motion fails."""
    orbit = map.orbit(state, periods)
    return (orbit.states[-1] - state) / map.scale if orbit.status == OK else np.full(state.size, np.nan)


def _distance(map: PeriodMap, one: np.ndarray, other: np.ndarray) -> float:
    return float(np.abs((one - other) / map.scale).max())


def margin(map: PeriodMap, orbit: Orbit, near_misses: np.ndarray) -> float:
    """How far an orbit with these near misses [m] is from grazing [1], as in `Cycle.margin`."""
    least = float(near_misses.min(initial=math.inf)) / length_scale(map, "m")
    speeds = orbit.impacts[:, 2]
    if speeds.size and orbit.contact == 0.0:
        least = min(least, float(speeds.min() / max(speeds.max(), length_scale(map, "m/s"))))
    return least


def length_scale(map: PeriodMap, unit: str) -> float:
    """Return the largest scale of the components in this unit, 1 without any."""
    return max((scale for scale, its in zip(map.scale, map.units, strict=True) if its == unit), default=1.0)
