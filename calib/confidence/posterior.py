"""The posterior distribution of the parameters, by nested sampling.

The sampler is nautilus (J. U. Lange, nautilus: boosting Bayesian importance nested sampling with deep learning, Monthly
Notices of the Royal Astronomical Society 525 (2023) 3181-3194). Everything random in it comes from its seed: a run that
was interrupted is repeated with the likelihoods that are known already, and goes on where none is.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.confidence.constrained import FittedPoint
from calib.confidence.likelihood import AdjustedLikelihood
from calib.confidence.sampler_package import nested_sampler
from calib.objective.objective import MAX_LINEAR_DISTANCE, MIN_COST_OF_WRONG_KIND

MIN_LIVE_POINTS, LIVE_POINTS_PER_PARAMETER = 200, 50  # of the sampler  [count]
NETWORKS = 1  # neural networks of each bound  [count]: more take longer than the simulations that they save here
# how the networks are trained: they rank points, so a mean squared error of the ranks that no longer falls by 1e-4 in
# 5 epochs is as good as one that does not fall at all: as few evaluations, in two thirds of the processor time
TRAINING = {"tol": 1e-4, "n_iter_no_change": 5}
BATCH = 50  # points that are evaluated together  [count]; part of the result, unlike the number of processes
EFFECTIVE_SIZE = 1000.0  # of the sample  [count]: a mean has an error of 3 % of the standard deviation
# in the live points, at which exploration ends  [1]; all points are weighted, so that nothing is cut off by it. Where
# the likelihood has a plateau below its top, as without contact, the share stays at 1 % and exploration would not end
REMAINING_EVIDENCE = 0.05
EVALUATIONS_PER_LIVE_POINT = 2.0  # for each unit of the logarithm of the compression, for the progress  [count]
MAX_EVALUATIONS_RATIO = 10  # over those that so many parameters take, at which the sampling ends as it is  [count]
COMPRESSION_PER_PARAMETER = 4.0  # logarithm of the prior's width over the posterior's, where that is not known  [1]


@dataclass(frozen=True, eq=False)
class Posterior:
    """A sample of the posterior distribution.

    Attributes
    ----------
    points : (n, dim) equally weighted, in the unit cube of the windows
    log_likelihood : (n,) of each, over the best point's
    log_evidence : of the model, over the likelihood of the best point
    log_evidence_error : its standard error
    effective_size : of the weighted sample  [count]
    evaluations : that it took
    complete : whether it ended by itself, not at the largest number of evaluations
    """

    points: np.ndarray
    log_likelihood: np.ndarray
    log_evidence: float
    log_evidence_error: float
    effective_size: float
    evaluations: int
    complete: bool = True


@dataclass(frozen=True, eq=False)
class LogLikelihood:
    """Logarithm of the adjusted likelihood over that of the best point, finite and with a slope everywhere.

    The level of the noise is estimated from the residuals with nu degrees of freedom: it is integrated out, so that a
    likelihood ratio R of d parameters becomes a multivariate t, (1 + R / nu)^-(nu + d)/2 (Box & Tiao, Bayesian
    Inference in Statistical Analysis, 1973, section 2.7), 1 / nu being the mean of those of the parameters, weighted by
    their squared shifts in standard errors.

    A simulation that moves in a wrong way is less likely than any that does not, the more so the larger the cost of the
    objective, and one that fails is less likely still, by its distance from the best point: nested sampling ends on a
    plateau.

    Attributes
    ----------
    likelihood : about the best point
    centre : (dim,) the best point, in the unit cube
    """

    likelihood: AdjustedLikelihood
    centre: np.ndarray

    def __call__(self, point: FittedPoint) -> float:
        """Logarithm of the likelihood of a point in which all parameters are held."""
        shift = np.array(point.u) - self.centre
        if math.isfinite(point.square):
            ratio = self.likelihood.ratio(point.square, range(shift.size), shift) if shift.any() else 0.0
            deviance = self._deviance(ratio, shift) if ratio > 0.0 else ratio
            return -0.5 * deviance / (1.0 + max(deviance, 0.0) / self._worst)
        if math.isfinite(point.cost):  # of a wrong kind of motion: 10 to 21
            return -self._worst * (1.0 + point.cost / MIN_COST_OF_WRONG_KIND)
        return -self._worst * (4.0 + float(np.linalg.norm(shift)))

    def _deviance(self, ratio: float, shift: np.ndarray) -> float:
        """Twice the fall of the log-likelihood, the level of the noise integrated out, at a shift (dim,)."""
        squares = shift**2 / np.diag(self.likelihood.robust_covariance)
        inverse = float(squares @ (1.0 / self.likelihood.degrees_of_freedom) / squares.sum())
        return (1.0 / inverse + shift.size) * math.log1p(ratio * inverse) if inverse > 0.0 else ratio

    @cached_property
    def _worst(self) -> float:
        """Likelihood ratio of a distance that is as large as costs of the right kind of motion go."""
        largest = np.linalg.eigvals(
            np.linalg.solve(self.likelihood.robust_covariance, self.likelihood.unit_covariance)
        ).real.max()
        return float((MAX_LINEAR_DISTANCE**2 + self.likelihood.square) * largest)


def sample_posterior(
    log_likelihood: Callable[[np.ndarray], np.ndarray],
    position: Callable[[np.ndarray], np.ndarray],
    dim: int,
    seed: int,
    *,
    live_points: int | None = None,
    compression: float | None = None,
    on_progress: Callable[[int, int], None] = lambda done, foreseen: None,
) -> Posterior:
    """Sample the posterior distribution, with at most `MAX_EVALUATIONS_RATIO` times the evaluations that are expected.

    Parameters
    ----------
    log_likelihood : of points (n, dim) of the windows' unit cube -> (n,), finite
    position : points (n, dim) of the priors' unit cube -> those of the windows'
    dim : parameters
    seed : of everything random
    live_points : None: by the number of parameters
    compression : logarithm of the prior's volume over the posterior's, for the progress; None: not known
    on_progress : called with the number of points that are evaluated, and of those that are foreseen

    Raises
    ------
    CalibError : nautilus is not installed
    """
    live = live_points or _live_points(dim)
    foreseen = expected_evaluations(dim, compression, live)
    evaluated = 0

    def likelihood(points: np.ndarray) -> np.ndarray:
        nonlocal evaluated
        values = log_likelihood(points[:, :dim])
        evaluated += len(points)
        on_progress(evaluated, max(foreseen, evaluated + BATCH))
        return values

    def prior(points: np.ndarray) -> np.ndarray:
        points = np.array(points, dtype=float)
        points[..., :dim] = position(points[..., :dim].reshape(-1, dim)).reshape(points[..., :dim].shape)
        return points

    dimensions = max(dim, 2)  # nautilus takes two at least: a single parameter has an idle one beside it
    sampler = nested_sampler()(
        prior, likelihood, n_dim=dimensions, n_live=live, n_batch=BATCH, n_networks=NETWORKS, vectorized=True,
        neural_network_kwargs=TRAINING, pass_dict=False, seed=seed,
    )  # fmt: skip
    most = MAX_EVALUATIONS_RATIO * expected_evaluations(dim, live_points=live)
    complete = sampler.run(f_live=REMAINING_EVIDENCE, n_eff=EFFECTIVE_SIZE, n_like_max=most, discard_exploration=False)
    points, log_weights, logarithms = (np.asarray(own) for own in sampler.posterior())
    chosen = _equally_weighted(np.exp(log_weights), round(float(sampler.n_eff)), seed)
    on_progress(evaluated, evaluated)
    return Posterior(
        points[chosen, :dim], logarithms[chosen], float(sampler.log_z),
        float(1.0 / np.sqrt(sampler.n_eff)), float(sampler.n_eff), evaluated, bool(complete),
    )  # fmt: skip


def _equally_weighted(weights: np.ndarray, number: int, seed: int) -> np.ndarray:
    """Indices (number,) of a sample with these weights (n,), in random order: systematic resampling."""
    share = np.cumsum(weights) / weights.sum()
    chosen = np.searchsorted(share, (np.arange(number) + 0.5) / number)
    return np.random.default_rng(seed).permutation(np.minimum(chosen, weights.size - 1))


def expected_evaluations(dim: int, compression: float | None = None, live_points: int | None = None) -> int:
    """Evaluations that a posterior distribution of so many parameters takes, roughly.

    compression : logarithm of the prior's volume over the posterior's; None: not known
    live_points : None: by the number of parameters
    """
    if compression is None:
        compression = COMPRESSION_PER_PARAMETER * dim
    live = live_points or _live_points(dim)
    return round(EVALUATIONS_PER_LIVE_POINT * max(compression, 1.0) * live / BATCH) * BATCH


def _live_points(dim: int) -> int:
    return max(MIN_LIVE_POINTS, LIVE_POINTS_PER_PARAMETER * dim)
