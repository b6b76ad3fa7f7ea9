"""What a posterior distribution predicts of a record: quantiles of its channels and of its phase curves.

A draw predicts a curve; the measurement adds noise to it, so that a sample is distributed as a mixture of normals, one
for each draw. A phase curve has its band across itself, along the normal of the median curve with both axes over their
extents: where velocity jumps, the instants of the draws differ, and their curves hardly do.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

PREDICTIVE_DRAWS = 100  # of the posterior distribution, that are simulated  [count]
PREDICTIVE_LEVELS = (0.5, 0.95)  # probability inside each band  [1]
MIN_PREDICTIVE_TRUST = 0.5  # in a velocity, of the median draw: samples of less lie beside an impact  [1]
MIXTURE_BISECTIONS = 40  # of the interval that holds a quantile  [count]
MIXTURE_REACH = 6.0  # of that interval beyond the draws, in standard deviations of the noise  [1]

TAILS = tuple(sorted(0.5 + side * 0.5 * level for level in PREDICTIVE_LEVELS for side in (-1.0, 1.0)))


@dataclass(frozen=True, eq=False)
class PredictedChannel:
    """One channel of a body as the draws of a posterior distribution predict it.

    Attributes
    ----------
    curves : (draw, n), NaN where a draw has no motion  [unit of the channel]
    noise : its standard deviation, of all samples or of each (n,)  [unit of the channel]
    """

    curves: np.ndarray
    noise: np.ndarray | float

    @property
    def median(self) -> np.ndarray:
        """Median curve (n,)."""
        return _quantiles(self.curves, (0.5,))[0]

    @property
    def curve_quantiles(self) -> np.ndarray:
        """Quantiles (4, n) of the curve at `TAILS`."""
        return _quantiles(self.curves, TAILS)

    @property
    def sample_quantiles(self) -> np.ndarray:
        """Quantiles (4, n) of a measured sample at `TAILS`, noise included."""
        return mixture_quantiles(self.curves, np.broadcast_to(self.noise, self.curves.shape[1:]))

    def inside(self, measured: np.ndarray, counted: np.ndarray) -> float:
        """Share of the measured samples (n,) that are `counted` (n,) and lie in the widest band; NaN of none  [1]."""
        if not counted.any():
            return np.nan
        probability = mixture_probability(measured, self.curves, np.broadcast_to(self.noise, measured.shape))[counted]
        return float(np.mean((probability >= TAILS[0]) & (probability <= TAILS[-1])))


def _quantiles(curves: np.ndarray, levels: Sequence[float]) -> np.ndarray:
    """Quantiles (level, n) of curves (draw, n), of those that are not NaN; NaN where all are."""
    there = np.isfinite(curves).any(axis=0)
    quantile = np.quantile if np.isfinite(curves).all() else np.nanquantile
    found = np.full((len(levels), there.size), np.nan)
    found[:, there] = quantile(curves[:, there], levels, axis=0)
    return found


def mixture_probability(values: np.ndarray, centres: np.ndarray, deviation: np.ndarray) -> np.ndarray:
    """Probability (n,) that a sample lies below `values` (n,), of normals about `centres` (draw, n), equally likely.

    deviation : (n,) standard deviation of each; 0: there is no noise
    NaN in `centres` does not count.
    """
    apart = values - centres
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled = np.where(deviation > 0.0, apart / deviation, np.where(apart == 0.0, 0.0, np.sign(apart) * np.inf))
    below = np.asarray(ndtr(scaled))
    there = ~np.isnan(below)
    return np.asarray(np.where(there, below, 0.0).sum(axis=0) / np.maximum(there.sum(axis=0), 1))


def mixture_quantiles(centres: np.ndarray, deviation: np.ndarray) -> np.ndarray:
    """Quantiles (4, n) at `TAILS` of normals about `centres` (draw, n) of standard deviation (n,), by bisection.

    NaN in `centres` does not count; of a sample where all are NaN the quantiles are.
    """
    rows = []
    for tail in TAILS:
        low, high = (edge.reduce(centres, axis=0) for edge in (np.fmin, np.fmax))
        low, high = low - MIXTURE_REACH * deviation, high + MIXTURE_REACH * deviation
        for _ in range(MIXTURE_BISECTIONS):
            middle = 0.5 * (low + high)
            below = mixture_probability(middle, centres, deviation) < tail
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        rows.append(0.5 * (low + high))
    return np.array(rows)


@dataclass(frozen=True, eq=False)
class PredictedLoop:
    """A phase curve with its bands, across the median curve.

    Attributes
    ----------
    displacement, velocity : of the body
    """

    displacement: PredictedChannel
    velocity: PredictedChannel

    def bands(self) -> tuple[np.ndarray, np.ndarray]:
        """Ends of the bands (4, 2, n) at `TAILS`, displacement [m] and velocity [m/s]: of the curve, and with noise."""
        both = (self.displacement, self.velocity)
        median = np.array([channel.median for channel in both])
        extent = np.ptp(median, axis=1)
        extent = np.where(extent > 0.0, extent, 1.0)[:, None]
        normal = _normals(median / extent)
        apart = np.stack([channel.curves - own for channel, own in zip(both, median, strict=True)], axis=1) / extent
        offsets = np.einsum("dcn,cn->dn", apart, normal)
        deviation = np.array([np.broadcast_to(channel.noise, median.shape[1:]) for channel in both])
        noise = np.sqrt(np.sum((deviation / extent * normal) ** 2, axis=0))
        ends = np.quantile(offsets, TAILS, axis=0), mixture_quantiles(offsets, noise)
        of_curve, of_samples = (median + own[:, None] * normal * extent for own in ends)
        return of_curve, of_samples


def _normals(curve: np.ndarray) -> np.ndarray:
    """Unit normals (2, n) of a curve (2, n)."""
    along = np.gradient(curve, axis=1)
    length = np.hypot(*along)
    still = length <= 0.0
    along = np.where(still, np.array([[1.0], [0.0]]), along / np.where(still, 1.0, length))
    return np.array([-along[1], along[0]])
