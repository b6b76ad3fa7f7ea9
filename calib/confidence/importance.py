"""A posterior distribution that a confirming simulator corrects: importance weights of a subsample.

Draws of the distribution that the simulator of the search gives have the weights L_confirming / L_search. Where few of
them carry all the weight, the two distributions hardly overlap, and the draws say nothing about the confirming one but
that it is elsewhere. The shape k of a generalised Pareto distribution of the largest weights says whether means over
them converge at all: up to 0.7 they do in practice, and the weights are smoothed by it. Sources: A. B. Owen, Monte
Carlo theory, methods and examples (2013), chapter 9; A. Vehtari et al., Pareto smoothed importance sampling, Journal of
Machine Learning Research 25 (2024) 72.
"""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calib.confidence.document import ConfirmedMarginalResult, ConfirmedResult
from calib.confidence.sampler_package import arviz

CONFIRMED_DRAWS = 48  # of the posterior distribution, that the confirming simulator computes again  [count]
MAX_PARETO_K = 0.7  # shape of the tail of the weights, up to which means over them are trusted  [1]; Vehtari et al.
MIN_EFFECTIVE_SHARE = 0.25  # effective sample size over the draws, from which on they are reweighted  [1]


@dataclass(frozen=True, eq=False)
class Reweighted:
    """Draws with importance weights.

    Attributes
    ----------
    weights : (n,), smoothed, of sum 1; 0 of what failed
    pareto_k : shape of their tail  [1]; infinite where too few have a weight
    """

    weights: np.ndarray
    pareto_k: float

    @classmethod
    def of(cls, searched: np.ndarray, confirmed: np.ndarray) -> "Reweighted":
        """Weigh by logarithms (n,) of both likelihoods; -infinity: the confirming simulation cannot be compared."""
        known = np.isfinite(confirmed)
        logarithms = (confirmed - searched)[known]
        weights = np.zeros(known.size)
        if not logarithms.size:
            return cls(weights, np.inf)
        if np.ptp(logarithms) == 0.0:  # no tail
            weights[known] = 1.0 / logarithms.size
            return cls(weights, 0.0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of a large k, which is said here
            smoothed, k = arviz().psislw(logarithms)
        weights[known] = np.exp(smoothed - smoothed.max())
        return cls(weights / weights.sum(), float(k))

    @property
    def effective_size(self) -> float:
        """Number of equally weighted draws that are worth as much; 0 of none."""
        return float(1.0 / np.sum(self.weights**2)) if self.weights.any() else 0.0

    @property
    def usable(self) -> bool:
        """Whether enough draws carry the weight, and their means converge."""
        return self.effective_size >= MIN_EFFECTIVE_SHARE * self.weights.size and self.pareto_k <= MAX_PARETO_K

    def moments(self, values: np.ndarray) -> tuple[float, float]:
        """Mean and standard deviation of the values (n,)."""
        mean = float(self.weights @ values)
        return mean, float(np.sqrt(self.weights @ (values - mean) ** 2))


def confirmed_result(
    searched: np.ndarray, confirmed: np.ndarray, values: Mapping[str, np.ndarray], deviations: Mapping[str, float]
) -> ConfirmedResult:
    """Return what confidence.json says of a confirmed subsample.

    Parameters
    ----------
    searched, confirmed : (n,) logarithms of the likelihoods; -infinity where a simulation cannot be compared
    values : (n,) of each parameter, in SI
    deviations : standard deviation of each in the whole sample, in SI
    """
    weighted = Reweighted.of(searched, confirmed)
    failed = int(np.sum(~np.isfinite(confirmed)))
    known = np.isfinite(confirmed)
    apart = (confirmed - searched)[known]
    spread = float(apart.std()) if apart.size else 0.0
    told = f"{weighted.effective_size:.1f} of {searched.size} draws are effective, Pareto k {weighted.pareto_k:.2f}"
    k = weighted.pareto_k if np.isfinite(weighted.pareto_k) else None
    if not weighted.usable:
        text = (
            f"{told} ({MAX_PARETO_K} at most is wanted): the posterior distribution is that of the simulator of the "
            "search, and the confirming one has another; their log-likelihoods differ by "
            f"{spread:.2g} (standard deviation over the draws)"
        )
        return ConfirmedResult(searched.size, failed, weighted.effective_size, False, spread, (), text, k)
    marginals = []
    for name, own in values.items():
        mean, deviation = weighted.moments(own)
        shift = (mean - float(own.mean())) / deviations[name] if deviations[name] > 0.0 else 0.0
        marginals.append(ConfirmedMarginalResult(name, mean, deviation, shift))
    largest = max(marginals, key=lambda one: abs(one.shift))
    text = f"{told}; reweighted, {largest.name} moves most: by {largest.shift:+.2g} of its standard deviation"
    return ConfirmedResult(searched.size, failed, weighted.effective_size, True, spread, tuple(marginals), text, k)
