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
    beside : names of those others
    """

    effect: str
    share: float
    beside: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Elimination:
    """What becomes of causes beside what remains.

    Attributes
    ----------
    causes, final : that are left, and their model; those from which it began where none would be left
    is_explained : whether some are left
    left_out : the others, the weakest first; none where none would be left
    margin : excess chi-square by which the nearest of all comparisons was decided; infinite where nothing but noise is
        left
    """

    causes: tuple[Cause, ...]
    final: Fit
    is_explained: bool
    left_out: tuple[LeftOut, ...] = ()
    margin: float = np.inf


def eliminated(fitter: Fitter, null: Fit, causes: Sequence[Cause], final: Fit) -> Elimination:
    """Leave out the weakest cause in turn, until each explains several times what all leave, or no misfit is left.

    The others are refitted without it; where the budget is spent no fit begins: a cause is then taken to explain what
    it did when it was found, and all are left or none.

    Parameters
    ----------
    null, final : the calibrated model, and the one with the causes
    """
    kept, model, left_out, margin = tuple(causes), final, [], np.inf
    while kept:
        remaining = excess_chi2(fitter.evidence, model)
        if not significant(remaining, chi2_std(fitter.evidence)):
            return Elimination(kept, model, True, tuple(left_out), margin)
        spent = len(kept) > 1 and fitter.effort.spent
        reduced = [] if spent else [_without(fitter, null, model, kept, cause) for cause in kept]
        rises = [fit.chi2 - model.chi2 if fit.names else np.inf for fit in reduced]
        rises = rises or [cause.chi2_reduction for cause, _ in kept]
        weakest = int(np.argmin(rises))
        over = rises[weakest] - CRITERIA.min_over_remainder * remaining
        margin = min(margin, abs(over))
        if over >= 0.0:
            return Elimination(kept, model, True, tuple(left_out), margin)
        if spent:
            break
        share = rises[weakest] / (rises[weakest] + remaining)
        out, kept = kept[weakest], (*kept[:weakest], *kept[weakest + 1 :])
        left_out.append(LeftOut(out[0].name, share, tuple(cause.name for cause, _ in kept)))
        if kept:
            model = fitter.with_derivatives(reduced[weakest])
    return Elimination(tuple(causes), final, False, margin=margin)


def _without(fitter: Fitter, null: Fit, final: Fit, causes: Sequence[Cause], left_out: Cause) -> Fit:
    """Fit the model with all causes but one."""
    others = tuple(cause.candidate for cause, _ in causes if cause is not left_out[0])
    return without_cause(fitter, null, final, left_out[0], others)
