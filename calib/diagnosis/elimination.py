"""Backward elimination: those causes are kept that explain several times what may remain, with one size each.

What nobody has modelled looks a little like any effect, and like some of many by chance. One that explains W of what
the other causes leave, W + R, makes an angle with it whose cosine is sqrt(W / (W + R)), and of the size that fits,
a remainder R may have made sqrt(R / W) at most (the inequality of Cauchy and Schwarz). An effect that is
distinguishable from the remainder therefore explains much more than that. The excess chi-square says how large the
remainder is, to its standard error; what was left out remains in any case. Source of the procedure: Miller, Subset
Selection in Regression, 2002, section 3.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.diagnosis.constancy import Constancy, constancies, differing
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.excess import chi2_std, excess_chi2, significant
from calib.diagnosis.fit import Fit
from calib.diagnosis.refit import Fitter
from calib.diagnosis.replacement import without_cause
from calib.diagnosis.suspect import Cause


@dataclass(frozen=True)
class LeftOut:
    """A cause that may as well be something else that only looks like it.

    Attributes
    ----------
    effect : its name
    share : of the excess chi-square that the other causes may leave, which it explains  [1]
    beside : names of those others
    reason : why, as a clause; "": it explains too little
    """

    effect: str
    share: float
    beside: tuple[str, ...]
    reason: str = ""


@dataclass(frozen=True, eq=False)
class Elimination:
    """What becomes of causes beside what remains.

    Attributes
    ----------
    causes, final : that are left, and their model; those from which it began where none would be left
    is_explained : whether some are left
    left_out : the others, in order; none where none would be left
    margin : excess chi-square by which the nearest of all comparisons was decided; infinite where there was none
    """

    causes: tuple[Cause, ...]
    final: Fit
    is_explained: bool
    left_out: tuple[LeftOut, ...] = ()
    margin: float = np.inf


def eliminated(
    fitter: Fitter, null: Fit, causes: Sequence[Cause], final: Fit, threshold: float, attained: float
) -> Elimination:
    """Leave out the weakest cause in turn, until each explains several times what may remain.

    Then those whose sizes differ among channels, the weakest first, if what is left explains enough without them. The
    others are refitted without it; where the budget is spent no fit begins: a cause is then taken to explain what it
    did when it was found, and all are left or none.

    Parameters
    ----------
    null, final : the calibrated model, and the one with the causes
    threshold : of the normal deviate, from which sizes differ
    attained : chi-square with these causes, and others that were left out before
    """
    whole = Elimination(tuple(causes), final, True)
    heavy = found = _outweighing(fitter, null, whole, attained)
    while found.is_explained and (unlike := _of_several_sizes(fitter, found, threshold)):
        if len(found.causes) == 1 or fitter.effort.spent:
            return heavy
        least = min(unlike, key=lambda c: c.chi2)
        [cause] = [c for c in found.causes if c[0].name == least.effect]
        model = _without(fitter, null, found, cause)
        if not model.names:
            return heavy
        share = _share(model.chi2 - found.final.chi2, _remaining(fitter, found, attained))
        found = _outweighing(fitter, null, _less(fitter, found, cause, model, share, several_sizes(least)), attained)
    return found if found.is_explained else heavy


def several_sizes(constancy: Constancy) -> str:
    """Say that the size of a cause differs."""
    return f"its size differs by {100.0 * constancy.variation:.0f} % among {constancy.among}"


def _of_several_sizes(fitter: Fitter, found: Elimination, threshold: float) -> tuple[Constancy, ...]:
    """Causes whose sizes differ among channels."""
    explained_by_several = len(found.causes) > 1 and _leaves_noise(fitter, found)
    return differing(constancies(fitter.evidence, found.final), threshold, explained_by_several)


def _leaves_noise(fitter: Fitter, found: Elimination) -> bool:
    """Whether a model leaves nothing but noise, as far as the sum of squares tells."""
    return not significant(excess_chi2(fitter.evidence, found.final), chi2_std(fitter.evidence))


def _outweighing(fitter: Fitter, null: Fit, begun: Elimination, attained: float) -> Elimination:
    """Leave out the weakest cause in turn, until each explains several times what may remain.

    attained : chi-square with all causes, those included that were left out
    """
    found = begun
    while found.causes:
        alone, remaining = len(found.causes) == 1, _remaining(fitter, found, attained)
        spent = not alone and fitter.effort.spent
        if spent and _leaves_noise(fitter, found):
            return found
        reduced = [] if spent else [_without(fitter, null, found, cause) for cause in found.causes]
        rises = [fit.chi2 - found.final.chi2 if fit.names else np.inf for fit in reduced]
        rises = rises or [cause.chi2_reduction for cause, _ in found.causes]
        weakest = int(np.argmin(rises))
        over = rises[weakest] - CRITERIA.min_over_remainder * remaining
        found = replace(found, margin=min(found.margin, abs(over)))
        if over >= 0.0:
            return found
        if spent or alone:
            break
        share = _share(rises[weakest], remaining)
        found = _less(fitter, found, found.causes[weakest], reduced[weakest], share)
    return replace(begun, is_explained=False, margin=found.margin)


def _remaining(fitter: Fitter, found: Elimination, attained: float) -> float:
    """Excess chi-square that a model may leave, and no less than those explained that were left out.

    Where the sum of squares shows no misfit nothing beside one cause; beside several, which are more easily like
    something else, so much that each has to explain more than the standard deviation of that sum.
    """
    excess, std = excess_chi2(fitter.evidence, found.final), chi2_std(fitter.evidence)
    unseen = std / CRITERIA.min_over_remainder if len(found.causes) > 1 else 0.0
    return max(found.final.chi2 - attained, excess if significant(excess, std) else unseen)


def _share(rise: float, remaining: float) -> float:
    """Share that a cause explains of what the others leave."""
    return rise / (rise + remaining)


def _less(fitter: Fitter, found: Elimination, cause: Cause, model: Fit, share: float, reason: str = "") -> Elimination:
    """Leave out a cause; model : without it."""
    kept = tuple(other for other in found.causes if other is not cause)
    out = LeftOut(cause[0].name, share, tuple(other.name for other, _ in kept), reason)
    return replace(found, causes=kept, final=fitter.with_derivatives(model), left_out=(*found.left_out, out))


def _without(fitter: Fitter, null: Fit, found: Elimination, left_out: Cause) -> Fit:
    """Fit the model with all causes but one."""
    others = tuple(cause.candidate for cause, _ in found.causes if cause is not left_out[0])
    return without_cause(fitter, null, found.final, left_out[0], others)
