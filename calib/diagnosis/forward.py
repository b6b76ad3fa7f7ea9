"""Forward selection: causes chosen one after the other, until one is rejected."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from calib.diagnosis.candidate import Candidate
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.effort import BudgetSpent
from calib.diagnosis.evidence import Evidence, clocks_differ
from calib.diagnosis.excess import chi2_std, dominant, excess_chi2
from calib.diagnosis.fit import Fit
from calib.diagnosis.foresight import foresee_rivals, foresee_scores, foresee_search
from calib.diagnosis.general_laws import with_general_laws
from calib.diagnosis.noise import MAX_ORDER
from calib.diagnosis.refit import Fitter
from calib.diagnosis.rejection import extension, rejection
from calib.diagnosis.remainder import remainder
from calib.diagnosis.rivals import rival_suspects, simplest, with_possible_causes
from calib.diagnosis.search import Round, chi2_of_a_rival, search
from calib.diagnosis.stepwise import StepwiseState
from calib.diagnosis.suspect import Refitted, leading_variants


def forward(
    fitter: Fitter, null: Fit, candidates: Sequence[Candidate], seed: int, on_stage: Callable[[str], None]
) -> StepwiseState:
    """Choose causes one after the other, until one is rejected.

    Raises
    ------
    BudgetSpent : before all candidates are scored beside the calibrated model
    """
    state = StepwiseState(null, null, {})
    for number in range(CRITERIA.max_causes):
        if number and not fitter.effort.suffices():
            break
        on_stage(f"suspects {number + 1}")
        foresee_search(fitter, state.final, len(state.causes), candidates)
        foresee_scores(fitter, [c for c in candidates if id(c) not in state.known])
        try:
            outcome, cause = _round(fitter, state, candidates, seed + number)
        except BudgetSpent:
            if number:
                break
            raise
        state = replace(state, rounds=(*state.rounds, outcome))
        if cause is None:
            break
        causes = (*state.causes, (cause, outcome.rivals))
        state = _with_latest_noise(fitter, replace(state, final=cause.fit, causes=causes))
        latest = with_general_laws(fitter, state)
        state = latest if latest.names == state.names else _with_latest_noise(fitter, latest)
        foresee_rivals(fitter, float(any(len(rivals) > 1 for _, rivals in state.causes)))
    return state


def _with_latest_noise(fitter: Fitter, state: StepwiseState) -> StepwiseState:
    """Re-estimate the noise of rows without cycles from what no candidate explains beside the causes; refit the models.

    Later searches use that noise, and the last cause is compared with its rivals in it again. Where the residual of the
    causes is mostly model error it determines no noise, only how far it masks the uncertainty of clocks. Where the
    budget ends that the state is as it was, but for what is untried.
    """
    old, residual = fitter.evidence, state.final.residual
    evidence = old
    if not dominant(excess_chi2(old, state.final), chi2_std(old)):
        left = remainder(old, state.final, [derivatives.columns for derivatives in state.known.values()])
        evidence = old.with_reestimated_noise(left)
        residual = evidence.carried(residual[:, None], old)[:, 0]
    evidence = evidence.with_remainder(residual)
    if not _differs(evidence, old):
        return state
    latest = fitter.attempt(partial(_in_noise_of, fitter, evidence, state))
    if latest is not None:
        return latest
    return state.with_untried([suspect.name for suspect in _compared_again(state)])


def _round(
    fitter: Fitter, state: StepwiseState, candidates: Sequence[Candidate], seed: int
) -> tuple[Round, Refitted | None]:
    """Search for a further cause; beside the search that cause in the model with its derivatives, None without one."""
    evidence, base = fitter.evidence, state.final
    rest = [c for c in candidates if c.name not in state.names]
    outcome = search(fitter, base, rest, seed, excess_chi2(evidence, base) / chi2_std(evidence), state.known)
    outcome = replace(outcome, chi2_of_null=state.null.chi2)
    chosen = outcome.chosen
    if chosen is None:
        return outcome, None
    extended = fitter.with_derivatives(chosen.fit)
    made = extension(evidence, base, extended, chosen, outcome.threshold)
    outcome = replace(outcome, prediction=made.prediction)
    reason = rejection(evidence, state.null, made, further=bool(state.causes))
    return (outcome.without_cause(reason), None) if reason else (outcome, replace(chosen, fit=extended))


def _in_noise_of(fitter: Fitter, evidence: Evidence, state: StepwiseState) -> StepwiseState:
    """Return the state with its models refitted in the noise of other evidence; as it was where none is a cause."""
    old, fitter.evidence = fitter.evidence, evidence
    earlier = [cause.candidate for cause, _ in state.causes[:-1]]
    tasks: list[Callable[[Fitter], Fit]] = [partial(Fitter.fit, start=state.null.point)]
    if earlier:
        tasks.append(partial(Fitter.fit, start=state.rounds[-1].base.point, candidates=earlier))
    null, *beside = fitter.in_turn(tasks)
    base = beside[0] if beside else null
    refitted = _refitted_rivals(fitter, base, state) if null.names and base.names else []
    rivals = rival_suspects(fitter.evidence, refitted, state.rounds[-1].threshold)
    if not rivals:
        fitter.evidence = old
        return state
    chosen = simplest(rivals)
    final = fitter.with_derivatives(chosen.fit)
    for key, known in state.known.items():
        state.known[key] = replace(known, columns=evidence.carried(known.columns, old))
    cause = replace(chosen, fit=final), with_possible_causes(fitter.evidence, rivals, refitted)
    return replace(state, null=null, final=final, causes=(*state.causes[:-1], cause))


def _refitted_rivals(fitter: Fitter, base: Fit, state: StepwiseState) -> list[Refitted]:
    """The last cause and its rivals refitted in another noise, as far as they can be.

    And all suspects of the round that explain about as much, which may be distinguishable from it in that noise.

    base : the model without them, in that noise
    """
    threshold = state.rounds[-1].threshold
    refitted: list[Refitted] = []

    def fitted_again(suspect: Refitted, own: Fitter) -> Fit:
        bound = chi2_of_a_rival(refitted, base, threshold)
        return own.fit(suspect.fit.point, suspect.fit.candidates, rival=bound)

    suspects = _compared_again(state)
    fits = fitter.in_turn([partial(fitted_again, suspect) for suspect in suspects])
    for suspect, fit in zip(suspects, fits, strict=True):
        if fit.names:
            refitted.append(suspect.refitted(fit, base.chi2 - fit.chi2))
    return refitted


def _compared_again(state: StepwiseState) -> list[Refitted]:
    """The last cause with its rivals, and the suspects of its round that explain about as much."""
    cause, rivals = state.causes[-1]
    known, least = {rival.name for rival in rivals}, CRITERIA.min_explained_share * cause.chi2_reduction
    others = [s for s in state.rounds[-1].suspects if isinstance(s, Refitted) and s.fit.names and s.name not in known]
    return [*rivals, *leading_variants(s for s in others if s.chi2_reduction >= least)]


def _differs(one: Evidence, other: Evidence) -> bool:
    """Whether the noise of the same records differs: level, profile, autocorrelation, or the uncertainty of clocks."""
    pairs = [pair for p, q in zip(one.parts, other.parts, strict=True) for pair in zip(p.noise, q.noise, strict=True)]
    levels = [abs(p.sigma / q.sigma - 1.0) for p, q in pairs]
    correlations = [np.abs(p.autocorrelation(MAX_ORDER) - q.autocorrelation(MAX_ORDER)).max() for p, q in pairs]
    profiles = [np.abs(p.profile - q.profile).max() for p, q in pairs]
    largest = max((*levels, *correlations, *profiles), default=0.0)
    return clocks_differ(one, other) or bool(largest > CRITERIA.max_noise_change)
