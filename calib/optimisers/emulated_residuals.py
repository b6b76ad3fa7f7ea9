"""A local search by emulated residuals, as a generator that yields the points it wants evaluated."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from calib.emulation.shared import SharedGaussianProcess, fit_shared
from calib.emulation.trend import Trend
from calib.optimisers.least_squares import comparable_residuals, next_radius, square
from calib.optimisers.outcome import Asking, OutcomeLike

MIN_EMULATED_RADIUS = 1e-3  # of the window: a trust region below it is checked by neighbours  [1]
MIN_EMULATED_REDUCTION = 1e-4  # of the sum of squares, relative: a step that is predicted to bring less is not tried
CHECK_DISTANCE = 0.02  # of the window: of the neighbours that are evaluated before a search ends
POINTS_A_DIMENSION = 10  # nearest points that enter the emulator, over the dimension  [1]
MIN_COMPONENT_SHARE = 1e-9  # of the largest singular value, below which a principal component is rounding  [1]
RANDOM_STARTS = 2  # of the search for the least emulated sum of squares, beside the centre  [count]
STEP_FRACTIONS = (1.0, 0.5, 0.25)  # of a step, that are looked at where simulations fail  [1]
MIN_FEASIBILITY = 0.02  # least probability that a simulation counts with  [1]
SPREAD_CANDIDATES = 200  # points of a trust region among which the least known is sought  [count]
MIN_NEW_DISTANCE = 1e-5  # of the window, between a new point and each evaluated one

Evaluated = Sequence[tuple[np.ndarray, OutcomeLike]]  # points (dim,) with their outcomes; it grows with each answer


@dataclass(frozen=True)
class EmulatedResiduals:
    """Emulated residuals about a point, by their principal components, in which nothing is lost.

    Parameters
    ----------
    process : of the scores (n, components) of the evaluated residuals
    centre : (components,), scores of the mean residual
    rest : sum of squares of the mean residual outside all components
    feasibility : emulated probability that a simulation ends, with the kind of motion sought; None where all did
    """

    process: SharedGaussianProcess
    centre: np.ndarray
    rest: float
    feasibility: SharedGaussianProcess | None

    def scores(self, u: np.ndarray) -> np.ndarray:
        """Emulated scores (components,) at a point (dim,); with `rest` their squares are the sum of squares."""
        return self.process.mean(u[None])[0] + self.centre

    def sum_of_squares(self, u: np.ndarray) -> float:
        """Sum of squares of the emulated residuals at a point (dim,)."""
        return float(square(self.scores(u))) + self.rest

    def probability(self, u: np.ndarray) -> float:
        """Probability that the simulation at a point (dim,) can be compared."""
        if self.feasibility is None:
            return 1.0
        return float(np.clip(self.feasibility.mean(u[None])[0, 0], MIN_FEASIBILITY, 1.0))

    def step(self, u: np.ndarray, low: np.ndarray, high: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Point (dim,) of the box low..high with the largest emulated reduction, times its probability."""
        now, inside = self.sum_of_squares(u), 1e-9 * (high - low)
        starts = [u, *(low + (high - low) * rng.random((RANDOM_STARTS, u.size)))]
        ends = [
            least_squares(
                self.scores, np.clip(start, low + inside, high - inside), self.process.slope, bounds=(low, high),
                max_nfev=30,
            ).x
            for start in starts
        ]  # fmt: skip
        fractions = STEP_FRACTIONS if self.feasibility is not None else STEP_FRACTIONS[:1]
        points = [np.clip(u + fraction * (end - u), low, high) for end in ends for fraction in fractions]
        return max(points, key=lambda point: (now - self.sum_of_squares(point)) * self.probability(point))

    def least_known(
        self, low: np.ndarray, high: np.ndarray, taken: list[np.ndarray], rng: np.random.Generator
    ) -> np.ndarray:
        """Point (dim,) of the box low..high where the emulator is least sure, given those taken already."""
        process = self.process
        if taken:
            process = process.extended(np.array(taken), process.mean(np.array(taken)))
        candidates = low + (high - low) * rng.random((SPREAD_CANDIDATES, low.size))
        return candidates[np.argmax(process.predict(candidates).std.max(axis=1))]


def emulate(
    u: np.ndarray, kind: str | None, evaluated: Evaluated, lengths: np.ndarray | None = None
) -> EmulatedResiduals:
    """Emulator of the residuals about a point (dim,) from the nearest evaluated points of the same kind of motion."""
    points = np.array([point for point, _ in evaluated])
    near = np.argsort(np.abs(points - u).max(axis=1), kind="stable")[: POINTS_A_DIMENSION * u.size]
    comparable = np.array([evaluated[i][1].residuals is not None and evaluated[i][1].kind == kind for i in near])
    chosen = near[comparable]
    residuals = np.array([evaluated[i][1].residuals for i in chosen])
    mean = residuals.mean(axis=0)
    left, singular, right = np.linalg.svd(residuals - mean, full_matrices=False)
    kept = max(1, int((singular > MIN_COMPONENT_SHARE * singular[0]).sum()))
    centre = right[:kept] @ mean
    process = fit_shared(points[chosen], left[:, :kept] * singular[:kept], Trend.LINEAR, lengths)
    feasibility = None
    if not comparable.all():
        feasibility = fit_shared(points[near], comparable[:, None].astype(float), Trend.CONSTANT)
    return EmulatedResiduals(process, centre, max(0.0, float(square(mean) - square(centre))), feasibility)


def descend(
    u: np.ndarray, outcome: OutcomeLike, evaluated: Evaluated, radius: float, batch: int, rng: np.random.Generator
) -> Asking[tuple[np.ndarray, OutcomeLike]]:
    """Search from a point u (dim,) with its outcome, by a trust region in the maximum norm.

    Each step is least in the emulated sum of squares: a Gauss-Newton step whose Jacobian and curvature come from all
    points nearby, none of which is spent on a difference quotient alone (Cartis & Roberts 2019, Math. Program.
    Comput. 11, 631, with emulators for their linear models). It is accepted by its cost. A search begins with the
    neighbours along all axes. Where no step is worth trying they are asked for again, and the search ends if nothing
    has been gained since the last time. A batch is filled with the points at which the emulator is least sure.

    Yields points (n, dim), is sent their n outcomes, returns the last point and its outcome; the caller adds every
    answer to `evaluated` before sending it.
    """
    checked: float | None = None  # sum of squares when the neighbours were evaluated last
    lengths = None
    while outcome.residuals is not None:
        emulator = emulate(u, outcome.kind, evaluated, lengths)
        lengths = emulator.process.lengths
        low, high = np.maximum(u - radius, 0.0), np.minimum(u + radius, 1.0)
        now, step = float(square(outcome.residuals)), emulator.step(u, low, high, rng)
        predicted = now - emulator.sum_of_squares(step)
        known = np.array([point for point, _ in evaluated])
        worth = (
            checked is not None
            and radius > MIN_EMULATED_RADIUS
            and predicted > MIN_EMULATED_REDUCTION * now
            and np.abs(known - step).max(axis=1).min() > MIN_NEW_DISTANCE
        )
        if not worth and checked is not None and now >= (1 - MIN_EMULATED_REDUCTION) * checked:
            break
        asked = [step] if worth else list(neighbours(u, min(radius, CHECK_DISTANCE)))
        while len(asked) < batch:
            asked.append(emulator.least_known(low, high, asked, rng))
        outcomes = yield np.array(asked)
        best = min(range(len(asked)), key=lambda i: outcomes[i].cost)
        if worth:
            length, there = np.abs(step - u).max(), outcomes[0]
            residuals = comparable_residuals(there, outcome.kind)
            ratio = -np.inf if residuals is None else (now - float(square(residuals))) / predicted
            radius = next_radius(radius, ratio, length) if ratio > 0 else 0.5 * min(radius, length)
        else:
            radius, checked = max(radius, CHECK_DISTANCE), now
        if outcomes[best].cost < outcome.cost:
            u, outcome = asked[best], outcomes[best]
    return u, outcome


def neighbours(u: np.ndarray, distance: float) -> np.ndarray:
    """Points (dim, dim) beside a point (dim,), one along each axis, on the side with room in the cube."""
    return u + np.diag(np.where(u + distance > 1, -distance, distance))
