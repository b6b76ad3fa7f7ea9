"""The lifetime of transient chaos."""

import math
from dataclasses import dataclass

from scipy.special import chdtri

CONFIDENCE_LEVEL = 0.95  # of the interval of a mean lifetime  [1]


@dataclass(frozen=True, eq=False)
class EscapeTime:
    """Mean lifetime of transient chaos, estimated from runs of which some are broken off.

    Lifetimes on a chaotic saddle are exponentially distributed, so that with `escapes` of them in `observed`
    periods the mean is observed / escapes, and 2 observed / mean has bounds from the chi-square distribution.

    Attributes
    ----------
    observed : periods of irregular motion in all runs together
    escapes : runs that left it for a regular motion

    Source: Tel and Lai, Physics Reports 460 (2008) 245-275 (lifetimes); Lawless, Statistical Models and Methods for
    Lifetime Data, 2nd ed. (2003), chapter 4 (bounds).
    """

    observed: int
    escapes: int

    @property
    def mean(self) -> float:
        """Estimate, infinite where no run has escaped  [periods]."""
        return self.observed / self.escapes if self.escapes else math.inf

    @property
    def interval(self) -> tuple[float, float]:
        """Lower and upper bound of 95 % confidence, the upper one infinite where no run has escaped  [periods]."""
        low = 2.0 * self.observed / float(chdtri(2 * self.escapes + 2, 0.5 * (1.0 - CONFIDENCE_LEVEL)))
        if not self.escapes:
            return low, math.inf
        return low, 2.0 * self.observed / float(chdtri(2 * self.escapes, 0.5 * (1.0 + CONFIDENCE_LEVEL)))

    def __str__(self) -> str:
        low, high = self.interval
        if not self.escapes:
            return f"none of the runs left it within {self.observed} periods: mean escape time above {low:.0f}"
        return (
            f"mean escape time {self.mean:.0f} periods (95 % {low:.0f} to {high:.0f}, {self.escapes} escape(s) in "
            f"{self.observed} periods)"
        )
