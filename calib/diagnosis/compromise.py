"""Causes that are a compromise between two others, and their replacement by the best pair."""

from collections.abc import Collection, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial

from calib.diagnosis.candidate import Candidate
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.elimination import eliminated
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.excess import chi2_std, dominant, excess_chi2, significant
from calib.diagnosis.fit import Fit
from calib.diagnosis.refit import Fitter
from calib.diagnosis.rejection import extension, is_negligible, rejection
from calib.diagnosis.replacement import aic, best_pair, is_pair_significant, replaced, without_cause
from calib.diagnosis.screening import screened
from calib.diagnosis.stepwise import StepwiseState, through_elimination
from calib.diagnosis.suspect import Cause, Refitted


def may_be_compromise(fitter: Fitter, state: StepwiseState, candidates: Sequence[Candidate]) -> bool:
    """Whether causes leave more than noise; without a cause, whether no misfit that dominates it is left.

    A sum of squares has less power than a score test: beside a cause, a suspect beyond the threshold that was rejected
    is evidence too, or a pair. It may have been rejected because that cause stands for both. Without a cause it may
    explain half.
    """
    excess, std = excess_chi2(fitter.evidence, state.final), chi2_std(fitter.evidence)
    rejected = state.rounds[-1].rejected
    another = None if rejected is None or rejected.name in state.names else rejected
    if state.causes:
        more = another is not None or significant(excess, std)
        return more or is_pair_significant(state.null, state.causes, state.final, candidates, state.known)
    return significant(excess, std) and not dominant(excess - (0.0 if another is None else another.chi2_reduction), std)


def with_best_pair(fitter: Fitter, state: StepwiseState, candidates: Sequence[Candidate], seed: int) -> StepwiseState:
    """Put the best pair in the place of the causes where it explains more, and each is a cause beside the other.

    The other candidates are scored again, about the model so far: its noise may have been re-estimated.
    """
    null, known = state.null, None if state.causes else state.known
    others = [candidate for candidate in candidates if candidate.name not in state.names]
    suspects, threshold = screened(fitter, state.final, others, seed, known)
    pair = best_pair(fitter, null, state.causes, state.final, suspects)
    if pair is None or not _explains_more(fitter.evidence, null, state.causes, state.final, pair):
        return state
    was_explained, state = state.is_explained, _fitted_from(fitter, state, pair[1])
    if not _explains_more(fitter.evidence, null, state.causes, state.final, pair):
        return state
    causes, final = replaced(fitter, null, *pair, candidates, seed, {}, last_too=True)
    if not _explains_more(fitter.evidence, null, state.causes, state.final, (causes, final)):
        return state
    if was_explained:
        left = eliminated(fitter, null, causes, final, threshold, final.chi2)
        if left.left_out or not left.is_explained:
            return state
    rejected = any_rejected(fitter, null, [cause for cause, _ in causes], final, threshold)
    reason = "of all pairs this one explains most, and more than the causes before it"
    return state if rejected else state.with_causes(causes, final, reason)


def with_pair_beside(
    fitter: Fitter,
    state: StepwiseState,
    stand_ins: Collection[str],
    candidates: Sequence[Candidate],
    seed: int,
) -> StepwiseState | None:
    """Put the best pair in the place of causes of several sizes, beside another; None where it explains no more.

    It has to explain more than all causes did, with the penalty of its parameters in AIC and none of theirs. Two
    effects together may look like a third, but not with one size of it everywhere. Those that a cause of several sizes
    hides are negligible beside it, so that no search for one more cause finds them.

    Parameters
    ----------
    stand_ins : names of those causes, one of which may be among the causes still
    """
    others = [known for known in state.causes if known[0].name not in stand_ins]
    beside = [other.candidate for other, _ in others]
    if len(others) + 2 > CRITERIA.max_causes:
        return None
    standing = next((cause for cause, _ in state.causes if cause.name in stand_ins), None)
    base = state.final
    if standing is not None:
        base = without_cause(fitter, state.null, state.final, standing, beside)
        if not base.names:
            return None
        base = fitter.with_derivatives(base)
    tenable = [candidate for candidate in candidates if candidate.name not in stand_ins]
    kept = {candidate.name for candidate in beside}
    suspects, threshold = screened(fitter, base, [c for c in tenable if c.name not in kept], seed, None)
    pair = best_pair(fitter, base, (), base, suspects, beside)
    if pair is None:
        return None
    causes, final = replaced(fitter, state.null, [*others, *pair[0]], pair[1], tenable, seed, {}, last_too=True)
    attained = min(state.attained, state.final.chi2) + sum(other.aic_penalty for other, _ in others)
    if not aic(causes, final) < attained - CRITERIA.aic_tie:
        return None
    if any_rejected(fitter, state.null, [cause for cause, _ in causes], final, threshold, base):
        return None
    reason = f"the size of {' and of '.join(stand_ins)} is not the same everywhere, and those of these are"
    revised = through_elimination(fitter, state.with_causes(causes, final, reason))
    return revised if revised.is_explained and revised.names == tuple(cause.name for cause, _ in causes) else None


def _fitted_from(fitter: Fitter, state: StepwiseState, other: Fit) -> StepwiseState:
    """Refit the causes from the calibrated values of another model, and take that fit where it explains more.

    Steps of Gauss and Newton end at the nearest minimum: a model may explain more only by its starting point.
    """
    if not state.causes:
        return state
    candidates = [cause.candidate for cause, _ in state.causes]
    values = {**state.final.point.values, **{name: other.value(name) for name in state.null.names}}
    sizes = {name: state.final.value(name) for candidate in candidates for name in candidate.free}
    fit = fitter.fit(replace(state.final.point, values=values), candidates, sizes, rival=state.final.chi2)
    lower = state.final.chi2 - fit.chi2
    if not fit.names or not lower > CRITERIA.aic_tie:
        return state
    fit = fitter.with_derivatives(fit)
    causes: list[Cause] = []
    for cause, rivals in state.causes:
        again = cause.refitted(fit, cause.chi2_reduction + lower)
        causes.append((again, tuple(again if rival.name == cause.name else rival for rival in rivals)))
    return replace(state, causes=tuple(causes), final=fit, elimination=None)


def any_rejected(
    fitter: Fitter,
    null: Fit,
    causes: Sequence[Refitted],
    final: Fit,
    threshold: float,
    reference: Fit | None = None,
) -> bool:
    """Whether some cause of a model would be rejected as the last one to enter it.

    reference : model of whose excess misfit a cause must not explain a negligible share; None: the calibrated one
    """

    def rejected(cause: Refitted, own: Fitter) -> bool:
        others = tuple(other.candidate for other in causes if other is not cause)
        base = without_cause(own, null, final, cause, others)
        if not base.names:  # it cannot be simulated without it
            return False
        base = own.with_derivatives(base)
        again = cause.refitted(final, base.chi2 - final.chi2)
        made = extension(own.evidence, base, final, again, threshold)
        return bool(rejection(own.evidence, reference or null, made, further=bool(others)))

    with closing(fitter.in_turn([partial(rejected, cause) for cause in causes])) as outcomes:
        return any(outcomes)


def _explains_more(
    evidence: Evidence, null: Fit, causes: Sequence[Cause], final: Fit, other: tuple[Sequence[Cause], Fit]
) -> bool:
    """Whether other causes explain more than those that they would replace; if they are more, not negligibly more.

    Of the remainder of those they have to explain several times what they leave themselves, unless that is noise, as an
    added cause has to.
    """
    reduction, remaining = final.chi2 - other[1].chi2, excess_chi2(evidence, other[1])
    lower = aic(*other) < aic(causes, final) - CRITERIA.aic_tie
    leaves_noise = not significant(remaining, chi2_std(evidence))
    outweighs = leaves_noise or reduction > CRITERIA.min_over_remainder * remaining
    relevant = len(other[0]) <= len(causes) or not is_negligible(evidence, null, final, reduction)
    return lower and outweighs and relevant
