"""Where a cost that is emulated over the whole cube promises most: expected improvement."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.special import ndtr

from calib.emulation.shared import SharedGaussianProcess, fit_shared
from calib.emulation.trend import Trend

LOG_SHIFTS = (0.02, 0.1, 0.5)  # of the logarithms beyond the range of the costs, ranges  [1]
MAX_EMULATED_COSTS = 200  # the lowest of more are emulated  [count]
CUBE_CANDIDATES = 2000  # points of the cube at which the expected improvement is looked at  [count]
BEST_CANDIDATES = ((0.1, 300), (0.02, 200))  # standard deviation [edges of the cube] and number about the best point
CLIMBS = 4  # from the best of them  [count]
MAX_CLIMB_STEPS = 30  # of each  [count]
DIFFERENCE_STEP = 1e-6  # of the slope of the logarithm of the improvement, edges of the cube  [1]
MAX_NEAR_STD = 5.0  # standard deviations below the mean, from which the improvement is taken from its asymptote  [1]
MIN_EMULATED_PROBABILITY = 1e-3  # least probability of a simulation that ends  [1]


@dataclass(frozen=True)
class Warp:
    """Increasing transformation of a cost: itself, log(cost - shift) with sign 1, -log(shift - cost) with sign -1."""

    sign: int = 0
    shift: float = 0.0

    def __call__(self, costs: np.ndarray) -> np.ndarray:
        """Transformed costs (n,)."""
        return costs if self.sign == 0 else self.sign * np.log(self.sign * (costs - self.shift))

    def log_slope(self, costs: np.ndarray) -> float:
        """Sum of the logarithms of the transformation's derivatives at costs (n,)."""
        return 0.0 if self.sign == 0 else -float(np.log(self.sign * (costs - self.shift)).sum())


@dataclass(frozen=True)
class EmulatedCost:
    """Emulated transformed cost, its least value so far, and the probability that a simulation ends.

    Parameters
    ----------
    process : of the transformed cost
    lowest : least transformed cost so far
    feasibility : None where every simulation ended
    """

    process: SharedGaussianProcess
    lowest: float
    feasibility: SharedGaussianProcess | None

    def log_improvement(self, points: np.ndarray) -> np.ndarray:
        """Logarithm (m,) of the expected improvement (Jones et al. 1998, J. Global Optim. 13) at points (m, dim)."""
        emulated = self.process.predict(points)
        std = np.maximum(emulated.std[:, 0], 1e-12 * max(float(self.process.scale[0]), 1e-300))
        value = log_expectation((self.lowest - emulated.mean[:, 0]) / std) + np.log(std)
        if self.feasibility is None:
            return value
        return value + np.log(np.clip(self.feasibility.mean(points)[:, 0], MIN_EMULATED_PROBABILITY, 1.0))

    def believed(self, point: np.ndarray) -> "EmulatedCost":
        """The same once its own prediction at a point (dim,) is taken for an outcome (kriging believer)."""
        value = self.process.mean(point[None])
        return EmulatedCost(
            self.process.extended(point[None], value), min(self.lowest, float(value[0, 0])), self.feasibility
        )


def log_expectation(t: np.ndarray) -> np.ndarray:
    """log(phi(t) + t Phi(t)), (n,), of the standard normal density and distribution; far below by its asymptote."""
    inside = np.maximum(t, -MAX_NEAR_STD)
    near = np.log(np.exp(-0.5 * inside**2) / np.sqrt(2 * np.pi) + inside * ndtr(inside))
    square = np.maximum(-t, MAX_NEAR_STD) ** 2
    far = -0.5 * square - 0.5 * np.log(2 * np.pi) - np.log(square) + np.log1p(-3 / square)
    return np.where(t > -MAX_NEAR_STD, near, far)


def warps(costs: np.ndarray) -> list[Warp]:
    """Transformations that costs (n,) may call for: a sum of squares is skew, a bounded cost flat far from its dips."""
    low, high = float(costs.min()), float(costs.max())
    logarithms = [
        Warp(sign, edge + sign * -shift * (high - low)) for sign, edge in ((-1, high), (1, low)) for shift in LOG_SHIFTS
    ]
    return [Warp(), *(logarithms if high > low else [])]


def emulate_cost(points: np.ndarray, costs: np.ndarray, lengths: np.ndarray | None = None) -> EmulatedCost:
    """Emulator of the costs (n,), inf where a simulation failed, at points (n, dim).

    The transformation is the one under which the costs are most probable (Snelson, Rasmussen & Ghahramani 2004, NIPS
    16), given the `lengths` from which their fit begins.
    """
    ended = np.isfinite(costs)
    chosen = np.flatnonzero(ended)[np.argsort(costs[ended], kind="stable")[:MAX_EMULATED_COSTS]]
    x, y = points[chosen], costs[chosen]

    def density(warp: Warp) -> float:
        return fit_shared(x, warp(y)[:, None], Trend.CONSTANT, lengths, steps=0).log_density + warp.log_slope(y)

    transformed = max(warps(y), key=density)(y)
    process = fit_shared(x, transformed[:, None], Trend.CONSTANT, lengths)
    feasibility = None if ended.all() else fit_shared(points, ended[:, None].astype(float), Trend.CONSTANT)
    return EmulatedCost(process, float(transformed.min()), feasibility)


def most_promising(emulated: EmulatedCost, best: np.ndarray, number: int, rng: np.random.Generator) -> np.ndarray:
    """Points (number, dim) of the cube, one after the other, at which the expected improvement is largest."""
    chosen = []
    for _ in range(number):
        chosen.append(_most_promising(emulated.log_improvement, best, rng))
        emulated = emulated.believed(chosen[-1])
    return np.array(chosen)


def _most_promising(
    value: Callable[[np.ndarray], np.ndarray], best: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    dim = best.size
    about = [np.clip(best + std * rng.standard_normal((n, dim)), 0, 1) for std, n in BEST_CANDIDATES]
    candidates = np.vstack([rng.random((CUBE_CANDIDATES, dim)), *about])
    values = value(candidates)

    def cost(u: np.ndarray) -> tuple[float, np.ndarray]:
        side = np.where(u > 0.5, -DIFFERENCE_STEP, DIFFERENCE_STEP)
        here, *ahead = value(np.vstack([u, u + np.diag(side)]))
        return -here, -(np.array(ahead) - here) / side

    ends = [(values.max(), candidates[np.argmax(values)])]
    for i in np.argsort(-values, kind="stable")[:CLIMBS]:
        options = {"maxiter": MAX_CLIMB_STEPS}
        end = minimize(cost, candidates[i], jac=True, method="L-BFGS-B", bounds=[(0, 1)] * dim, options=options)
        ends.append((-end.fun, np.clip(end.x, 0, 1)))
    return max(ends, key=lambda end: end[0])[1]
