"""Backward elimination: where causes leave a misfit, those are kept of which each explains several times as much as it.

What nobody has modelled looks a little like any effect, and like some of many by chance. One that explains W of what
the other causes leave, W + R, makes an angle with it whose cosine is sqrt(W / (W + R)), and of the size that fits,
a remainder R may have made sqrt(R / W) at most (the inequality of Cauchy and Schwarz). An effect that is told from what
remains therefore explains much more than that. Source of the procedure: Miller, Subset Selection in Regression, 2002,
section 3.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.excess import chi2_std, excess_chi2, significant
from calib.diagnosis.refit import Fit, Fitter
from calib.diagnosis.replacement import without_cause
from calib.diagnosis.suspect import Cause


@dataclass(frozen=True)
class LeftOut:
    """A cause that explains too little beside what remains to be told from something that only looks like it.

    Attributes
    ----------
    effect : its name
    share : of the excess chi-square that the other causes leave, which it explains  [1]
    """

    effect: str
    share: float


@dataclass(frozen=True, eq=False)
class Elimination:
    """Causes that are left, in their model, and those that were left out, the weakest first."""

    causes: tuple[Cause, ...]
    final: Fit
    left_out: tuple[LeftOut, ...]


def eliminated(fitter: Fitter, null: Fit, causes: Sequence[Cause], final: Fit) -> Elimination | None:
    """Leave out the weakest cause in turn, until each explains several times what all leave, or no misfit is left.

    The others are refitted without it.

    Parameters
    ----------
    null, final : the calibrated model, and the one with the causes

    Returns
    -------
    None where none would be left, or the budget was spent before that is known
    """
    kept, left_out = tuple(causes), []
    while kept:
        remaining = excess_chi2(fitter.evidence, final)
        if not significant(remaining, chi2_std(fitter.evidence)):
            return Elimination(kept, final, tuple(left_out))
        if len(kept) > 1 and fitter.effort.spent:
            return None
        reduced = [_without(fitter, null, final, kept, cause) for cause in kept]
        rises = [fit.chi2 - final.chi2 if fit.names else np.inf for fit in reduced]
        weakest = int(np.argmin(rises))
        if rises[weakest] >= CRITERIA.min_over_remainder * remaining:
            return Elimination(kept, final, tuple(left_out))
        left_out.append(LeftOut(kept[weakest][0].name, rises[weakest] / (rises[weakest] + remaining)))
        kept = (*kept[:weakest], *kept[weakest + 1 :])
        if kept:
            final = fitter.with_derivatives(reduced[weakest])
    return None


def _without(fitter: Fitter, null: Fit, final: Fit, causes: Sequence[Cause], left_out: Cause) -> Fit:
    """Fit the model with all causes but one."""
    others = tuple(cause.candidate for cause, _ in causes if cause is not left_out[0])
    return without_cause(fitter, null, final, left_out[0], others)
