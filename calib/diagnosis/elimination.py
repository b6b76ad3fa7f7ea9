"""Backward elimination: causes stay that explain several times the possible remainder, with one size each.

A model error is correlated a little with any effect, and with some of many by chance. An effect that explains W of what
the other causes leave, W + R, makes an angle with it whose cosine is sqrt(W / (W + R)), and a remainder R may bias its
fitted size by the share sqrt(R / W) at most (the inequality of Cauchy and Schwarz). An effect that is distinguishable
from the remainder therefore explains much more than that. The excess chi-square estimates the remainder, to its
standard error; what was eliminated is part of it in any case. Two models are compared where the simulations of both
are reliable: beside an impact that one of them has at another instant, the misfit says nothing of either. Source of the
procedure: Miller, Subset Selection in Regression, 2002, chapter 3.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from calib.diagnosis.constancy import Constancy, constancies, differing
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.excess import chi2_std, excess_over, significant
from calib.diagnosis.fit import Fit
from calib.diagnosis.refit import Fitter
from calib.diagnosis.replacement import without_cause
from calib.diagnosis.suspect import Cause


@dataclass(frozen=True)
class LeftOut:
    """A cause that was eliminated: a model error may imitate it.

    Attributes
    ----------
    effect : its name
    share : of the excess chi-square that the other causes may leave, which it explains  [1]
    beside : names of those others
    reason : why it was eliminated, as a clause; "": it explains too little
    """

    effect: str
    share: float
    beside: tuple[str, ...]
    reason: str = ""


@dataclass(frozen=True, eq=False)
class Elimination:
    """The result of a backward elimination.

    Attributes
    ----------
    causes, final : that stay, and their model; those from which it began where none would stay
    is_explained : whether some stay
    left_out : the others, in order; none where none would stay
    margin : excess chi-square by which the closest of all comparisons was decided; infinite where there was none
    """

    causes: tuple[Cause, ...]
    final: Fit
    is_explained: bool
    left_out: tuple[LeftOut, ...] = ()
    margin: float = np.inf


def eliminated(
    fitter: Fitter, null: Fit, causes: Sequence[Cause], final: Fit, threshold: float, attained: float
) -> Elimination:
    """Eliminate the weakest cause in turn, until each explains several times the possible remainder.

    Then those whose sizes differ among channels, the weakest first, if the others explain enough without them. The
    others are refitted without it; where the budget ends that, a cause counts with the reduction of chi-square at its
    selection, and all stay or none.

    Parameters
    ----------
    null, final : the calibrated model, and the one with the causes
    threshold : of the normal deviate, from which sizes differ
    attained : chi-square with these causes, and others that were eliminated before
    """
    whole = Elimination(tuple(causes), final, True)
    by_size = now = _outweighing(fitter, null, whole, attained)
    while now.is_explained and (heterogeneous := _of_several_sizes(fitter, null, now, threshold)):
        if len(now.causes) == 1:
            return by_size
        least = min(heterogeneous, key=lambda c: c.chi2)
        [cause] = [c for c in now.causes if c[0].name == least.effect]
        model = fitter.attempt(partial(_without, fitter, null, now, cause))
        if model is None or not model.names:
            return by_size
        share = _share(_rise(fitter, now.final, model), _remaining(fitter, null, now, attained))
        now = _outweighing(fitter, null, _less(fitter, now, cause, model, share, several_sizes(least)), attained)
    return now if now.is_explained else by_size


def several_sizes(constancy: Constancy) -> str:
    """State by how much the size of a cause differs, as a clause."""
    return f"its size differs by {100.0 * constancy.variation:.0f} % among {constancy.among}"


def _of_several_sizes(fitter: Fitter, null: Fit, now: Elimination, threshold: float) -> tuple[Constancy, ...]:
    """Causes whose sizes differ among channels."""
    explained_by_several = len(now.causes) > 1 and _leaves_noise(fitter, null, now)
    return differing(constancies(fitter.evidence, now.final), threshold, explained_by_several)


def _leaves_noise(fitter: Fitter, null: Fit, now: Elimination) -> bool:
    """Whether a model leaves only noise, by the sum of squares."""
    return not significant(*_excess(fitter, null, now))


def _outweighing(fitter: Fitter, null: Fit, begun: Elimination, attained: float) -> Elimination:
    """Eliminate the weakest cause in turn, until each explains several times the possible remainder.

    attained : chi-square with all causes, those included that were eliminated
    """
    now = begun
    while now.causes:
        alone, remaining = len(now.causes) == 1, _remaining(fitter, null, now, attained)
        reduced = [null] if alone else fitter.attempt(partial(_each_left_out, fitter, null, now))
        if reduced is None and _leaves_noise(fitter, null, now):
            return now
        rises = [cause.chi2_reduction for cause, _ in now.causes]
        if reduced is not None:
            rises = [_rise(fitter, now.final, fit) if fit.names else np.inf for fit in reduced]
        weakest = int(np.argmin(rises))
        over = rises[weakest] - CRITERIA.min_over_remainder * remaining
        now = replace(now, margin=min(now.margin, abs(over)))
        if over >= 0.0:
            return now
        if reduced is None or alone:
            break
        share = _share(rises[weakest], remaining)
        now = _less(fitter, now, now.causes[weakest], reduced[weakest], share)
    return replace(begun, is_explained=False, margin=now.margin)


def _rise(fitter: Fitter, final: Fit, model: Fit) -> float:
    """Rise of chi-square from a model to another, where the simulations of both are reliable."""
    common = fitter.evidence.with_weights([final.point.simulated, model.point.simulated])
    return model.chi2_over(common) - final.chi2_over(common)


def _excess(fitter: Fitter, null: Fit, now: Elimination) -> tuple[float, float]:
    """Excess chi-square where the simulations of the calibrated model are reliable too, and its standard deviation."""
    common = fitter.evidence.with_weights([null.point.simulated, now.final.point.simulated])
    return excess_over(common, now.final), chi2_std(common)


def _remaining(fitter: Fitter, null: Fit, now: Elimination, attained: float) -> float:
    """Excess chi-square of the possible remainder, and no less than those explained that were eliminated.

    Where the sum of squares is not significant it is 0 beside one cause; beside several, which imitate others more
    easily, so large that each has to explain more than the standard deviation of that sum.
    """
    excess, std = _excess(fitter, null, now)
    insignificant = std / CRITERIA.min_over_remainder if len(now.causes) > 1 else 0.0
    return max(now.final.chi2 - attained, excess if significant(excess, std) else insignificant)


def _share(rise: float, remaining: float) -> float:
    """Share that a cause explains of what the others leave  [1]."""
    return rise / (rise + remaining)


def _less(fitter: Fitter, now: Elimination, cause: Cause, model: Fit, share: float, reason: str = "") -> Elimination:
    """Eliminate a cause; model : without it."""
    others = tuple(other for other in now.causes if other is not cause)
    out = LeftOut(cause[0].name, share, tuple(other.name for other, _ in others), reason)
    return replace(now, causes=others, final=fitter.with_derivatives(model), left_out=(*now.left_out, out))


def _each_left_out(fitter: Fitter, null: Fit, now: Elimination) -> list[Fit]:
    """Fit the models with all causes but one, of each in turn."""
    return list(fitter.in_turn([partial(_without, null=null, now=now, left_out=cause) for cause in now.causes]))


def _without(fitter: Fitter, null: Fit, now: Elimination, left_out: Cause) -> Fit:
    """Fit the model with all causes but one."""
    others = tuple(cause.candidate for cause, _ in now.causes if cause is not left_out[0])
    return without_cause(fitter, null, now.final, left_out[0], others)
