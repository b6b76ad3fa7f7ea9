"""What is known of parameters before the measurement: distributions in their windows."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy

from calib.errors import CalibError
from calib.modelling.parameter import Space, Window

MIN_PROBABILITY_IN_WINDOW = 1e-6  # of a prior  [1]: one with less contradicts the window

PriorKind = Literal["normal", "lognormal"]


@dataclass(frozen=True)
class Prior:
    """A normal or lognormal distribution of one parameter, cut at its window.

    Attributes
    ----------
    kind : "normal" or "lognormal"
    centre : mean of a normal one, median of a lognormal one  [unit of the parameter]
    spread : standard deviation of a normal one  [unit of the parameter], or of the logarithm of a lognormal one  [1]
    """

    kind: PriorKind
    centre: float
    spread: float

    def check(self, window: Window) -> None:
        """Refuse a prior that is no distribution, or has next to no probability in the window.

        Raises
        ------
        CalibError : it is one of these
        """
        if not math.isfinite(self.centre):
            raise CalibError(f"expected a finite mean or median, got {self.centre:g}")
        if not self.spread > 0.0 or not math.isfinite(self.spread):
            raise CalibError(f"expected a finite standard deviation above 0, got {self.spread:g}")
        if self.kind == "lognormal" and not self.centre > 0.0:
            raise CalibError(f"expected a median above 0, got {self.centre:g}")
        if self.kind == "lognormal" and not window.high > 0.0:
            raise CalibError(
                f"a lognormal prior is of values above 0, and the window [{window.low:g}, {window.high:g}] (SI) has "
                "none; take a normal one"
            )
        low, high = self._bounds(window)
        inside = scipy.stats.norm.cdf(high) - scipy.stats.norm.cdf(low)
        if inside < MIN_PROBABILITY_IN_WINDOW:
            raise CalibError(
                f"the prior has a probability of {inside:.1g} in the window [{window.low:g}, {window.high:g}] "
                "(SI); widen the window, or mend the prior"
            )

    def position(self, probability: np.ndarray, window: Window) -> np.ndarray:
        """Position in the window (n,) below which the prior, cut at the window, has a probability (n,)."""
        z = scipy.stats.truncnorm.ppf(probability, *self._bounds(window))
        logarithm = self.kind == "lognormal"
        value = np.exp(math.log(self.centre) + self.spread * z) if logarithm else self.centre + self.spread * z
        return np.clip([window.position(one) for one in np.clip(value, window.low, window.high)], 0.0, 1.0)

    def _bounds(self, window: Window) -> tuple[float, float]:
        """Ends of the window, in standard deviations from the centre."""
        low, high, centre = window.low, window.high, self.centre
        if self.kind == "lognormal":
            low, high, centre = math.log(low) if low > 0.0 else -math.inf, math.log(high), math.log(centre)
        return (low - centre) / self.spread, (high - centre) / self.spread


def positions(space: Space, priors: Mapping[str, Prior], probability: np.ndarray) -> np.ndarray:
    """Points (n, dim) of the unit cube of the windows, for points (n, dim) of the unit cube of the priors.

    A parameter without a prior is equally likely everywhere in its window, on the scale of that.
    """
    points = np.array(probability, dtype=float)
    for k, (name, window) in enumerate(space.windows.items()):
        if name in priors:
            points[:, k] = priors[name].position(points[:, k], window)
    return points
