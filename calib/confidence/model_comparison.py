"""The evidence of competing models of the same measurement, by one likelihood.

A likelihood that each model adjusts to its own residuals compares nothing: a model that misses an effect takes its
misfit for noise. All models have the noise of the one that fits best. Its residuals give the covariance of the estimate
in each model, and the variance along the direction in which two models' residuals differ, by which the difference of
their sums of squares is a likelihood ratio (as `calib.confidence.likelihood` has it for parameters), with the level of
the noise integrated out (as `calib.confidence.posterior.LogLikelihood` has it).

The evidence is the mean of the likelihood over the prior, so that the Bayes factor of a model with one more parameter
falls in proportion to the width of that parameter's prior where the data determine it. Words for Bayes factors: R. E.
Kass, A. E. Raftery, Bayes factors, Journal of the American Statistical Association 90 (1995) 773-795.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.confidence.covariance import sandwich
from calib.confidence.likelihood import AdjustedLikelihood
from calib.confidence.local import Linearised
from calib.confidence.profiles import LocalAnalysis
from calib.errors import CalibError

# twice the logarithm of a Bayes factor, from which on the words hold  [1]
EVIDENCE_WORDS = (
    (10.0, "very strong"),
    (6.0, "strong"),
    (2.0, "positive"),
    (0.0, "not worth more than a bare mention"),
)
MAX_WINDOW_DECADES = 15.0  # of the width of a prior, that are worth telling  [1]


@dataclass(frozen=True, eq=False)
class ComparableModel:
    """A model whose likelihood has the noise that all compared models share.

    Attributes
    ----------
    likelihood : about its best point
    log_best : logarithm of the likelihood of that point over that of the best of all models
    """

    likelihood: AdjustedLikelihood
    log_best: float


def comparable(analyses: Sequence[LocalAnalysis], names: Sequence[str]) -> list[ComparableModel]:
    """Give models of the same residuals the noise of the one that fits best.

    Parameters
    ----------
    analyses : of the best point of each
    names : of their studies

    Raises
    ------
    CalibError : the residuals of one have no derivatives, or are others than those of the first
    """
    linearised = [_linearised(analysis, name) for analysis, name in zip(analyses, names, strict=True)]
    for own, name in zip(linearised, names, strict=True):
        if own.residuals.shape != linearised[0].residuals.shape:
            raise CalibError(
                f"{name} has {own.residuals.size} residuals, and {names[0]} has {linearised[0].residuals.size}: "
                "models are compared on the same records and terms; give the extended study those of the other"
            )
    best = min(range(len(linearised)), key=lambda k: float(linearised[k].residuals @ linearised[k].residuals))
    noise = linearised[best].residuals
    blocks, draws = analyses[best].blocks, analyses[best].noise_draws
    labels = np.zeros(noise.size, dtype=int) if blocks is None else blocks
    found = []
    for own in linearised:
        covariance, freedom = sandwich(own.jacobian, noise, labels, draws)
        square = float(own.residuals @ own.residuals)
        likelihood = AdjustedLikelihood(square, own.unit_covariance, covariance, freedom)
        apart = own.residuals - noise
        excess = square - float(noise @ noise)
        fitted = linearised[best].jacobian.shape[1]
        precision, free = _precision(apart, noise, labels, draws, fitted)
        ratio = max(excess, 0.0) * precision
        found.append(ComparableModel(likelihood, -0.5 * (free + fitted) * math.log1p(ratio / free)))
    return found


def _linearised(analysis: LocalAnalysis, name: str) -> Linearised:
    own = analysis.confidence.linearised
    if own is None:
        raise CalibError(
            f"the residuals of {name} have no derivatives at its best point ({analysis.confidence.reason}): its "
            "evidence cannot be compared; leave it out of --compare"
        )
    return own


def _precision(
    direction: np.ndarray, residuals: np.ndarray, blocks: np.ndarray, noise_draws: np.ndarray | None, fitted: int
) -> tuple[float, float]:
    """Inverse variance of the noise along a direction (m,), and its degrees of freedom; both 1 without a direction.

    residuals : (m,) of a model of so many `fitted` parameters
    """
    if not direction.any():
        return 1.0, 1.0
    covariance, freedom = sandwich(direction[:, None], residuals, blocks, noise_draws)
    whole = float(freedom[0]) + 1.0  # the sandwich allows for one direction that was fitted
    free = max(1.0, whole - fitted)
    return float(1.0 / (direction @ direction * covariance[0, 0])) * free / float(freedom[0]), free


def in_words(log_factor: float) -> str:
    """Strength of the evidence of a Bayes factor with this natural logarithm."""
    return next(words for least, words in EVIDENCE_WORDS if 2.0 * abs(log_factor) >= least)


def width_in_words(log_factor: float) -> str:
    """Say what the width of a flat prior of the parameters that one model has beside another does to this evidence."""
    decades = abs(log_factor) / math.log(10.0)
    if decades > MAX_WINDOW_DECADES:
        return "no width of the windows would change that"
    factor = f"{math.exp(abs(log_factor)):.2g}" if decades < 4.0 else f"10^{decades:.0f}"
    changed = "wider" if log_factor > 0.0 else "narrower"
    return (
        "it falls by ln k where the window of a parameter that the data determine is k times as wide: windows "
        f"{changed} by a factor of {factor} in all would make both equal"
    )
