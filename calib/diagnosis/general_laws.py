"""Laws that are tested only where a cause shows, compared with it at the maxima of both."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TypeGuard

from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.effort import SUSPECT
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.fit import Fit
from calib.diagnosis.free_form import with_free_form
from calib.diagnosis.prediction import Prediction
from calib.diagnosis.refit import Fitter
from calib.diagnosis.rejection import extension, rejection
from calib.diagnosis.replacement import without_cause
from calib.diagnosis.rivals import chi2_of_another_rival, rival_suspects, simplest, with_possible_causes
from calib.diagnosis.search import Round
from calib.diagnosis.stepwise import StepwiseState
from calib.diagnosis.suspect import Cause, Refitted, Suspect, leading_variants


def with_general_laws(fitter: Fitter, state: StepwiseState) -> StepwiseState:
    """Compare the last cause and its rivals with the laws that generalise it, whose form is fitted for that.

    The form with which a law is tried is a guess: with a poor one it explains less than its own special case. Models
    are compared as they fit best, here where the noise is known best: one that contains the cause by a likelihood-ratio
    test, another by its AIC. A law that contains the cause exactly is fitted from there too, so that it explains as
    much; another is out of reach where it explains too little with that guess. A law takes the place of the cause where
    it would be one by itself. Where the budget ends that, what was compared before it stands.
    """
    tried: set[str] = set()
    while general := [suspect for suspect in _within_reach(state) if suspect.name not in tried]:
        compared = fitter.attempt(partial(_compared, fitter, state, general))
        if compared is None:
            return state.with_untried([suspect.name for suspect in general])
        state, tried = compared, tried | {suspect.name for suspect in general}
    return state


def _within_reach(state: StepwiseState) -> list[Suspect]:
    """Suspects of the last search that generalise its cause: that contain it exactly, or explain at least half as much.

    One of each effect, without those whose form was fitted.
    """
    cause, _ = state.causes[-1]
    refitted = leading_variants(s for s in state.rounds[-1].suspects if _is_refitted(s))
    [of_then] = [s.chi2_reduction for s in refitted if s.name == cause.name]
    least = CRITERIA.min_explained_share * of_then
    own = {s.name: s for s in [*leading_variants(state.rounds[-1].suspects), *refitted]}
    general = (s for s in own.values() if cause.name in s.generalises and not s.candidate.form)
    return [s for s in general if _contains_exactly(s, cause) or (_is_refitted(s) and s.chi2_reduction >= least)]


def _is_refitted(suspect: Suspect) -> TypeGuard[Refitted]:
    """Whether the model was refitted with a suspect."""
    return isinstance(suspect, Refitted) and bool(suspect.fit.names)


def _contains_exactly(suspect: Suspect, cause: Refitted) -> bool:
    """Whether a suspect is the cause at certain values of its parameters."""
    return cause.name in suspect.candidate.effect.special_cases


def _compared(fitter: Fitter, state: StepwiseState, general: Sequence[Suspect]) -> StepwiseState:
    """Fit the forms of general laws, and choose among them and the rivals of the last cause."""
    cause, rivals = state.causes[-1]
    evidence, threshold = fitter.evidence, state.rounds[-1].threshold
    fitter.foresee(SUSPECT, len(general))
    fits = [partial(_formed, suspect=s, cause=cause, rivals=rivals) for s in general]
    with fitter.measuring(SUSPECT, len(general)):
        formed = [s for s in fitter.in_turn(fits) if s is not None]
    found = rival_suspects(evidence, [*rivals, *formed], threshold)
    chosen, prediction = simplest(found), state.rounds[-1].prediction
    if chosen.name != cause.name:
        cause, prediction, rejected = _in_its_place(fitter, state, chosen)
        if rejected:
            return state
    latest = cause, with_possible_causes(evidence, found, [*rivals, *formed])
    if not any(rival in formed for rival in latest[1]):
        return state
    last = _with_laws(state, latest, prediction)
    return replace(state, rounds=(*state.rounds[:-1], last), causes=(*state.causes[:-1], latest), final=cause.fit)


def _formed(fitter: Fitter, suspect: Suspect, cause: Refitted, rivals: Sequence[Refitted]) -> Refitted | None:
    """Return a suspect with its form fitted too, the best fit; None where it cannot be simulated or is no rival.

    A fit is abandoned where it is predicted to be no rival of a cause and its rivals.
    """
    evidence = fitter.evidence
    bound = chi2_of_another_rival(evidence, rivals, suspect)

    def reduction(fit: Fit) -> float:
        return cause.chi2_reduction + _fall(evidence, cause, fit)

    fits = [with_free_form(fitter, suspect, reduction, rival=bound)] if _is_refitted(suspect) else []
    fits += [_from_the_cause(fitter, suspect, cause, reduction, bound)] if _contains_exactly(suspect, cause) else []
    formed = min((s for s in fits if s is not None), key=lambda s: s.fit.chi2, default=None)
    return None if formed is None or (formed.fit.reason and formed.fit.chi2 > bound) else formed


def _from_the_cause(
    fitter: Fitter, suspect: Suspect, cause: Refitted, chi2_reduction: Callable[[Fit], float], rival: float
) -> Refitted | None:
    """Return a suspect with its form fitted too, from where it is the cause; None where it cannot be simulated.

    chi2_reduction, rival : as `with_free_form` takes them
    """
    point, own = cause.fit.point, suspect.candidate
    formed = replace(own, form=tuple(own.bounds))
    known = own.effect.special_cases[cause.name]
    sizes = {name: point.values[at] if isinstance(at, str) else at for name, at in known.items()}
    candidates = [formed if c.name == cause.name else c for c in cause.fit.candidates]
    rest = {name: value for name, value in point.values.items() if name not in cause.candidate.absent()}
    fit = fitter.fit(replace(point, values=rest), candidates, sizes, rival=rival)
    if not fit.names:
        return None
    return replace(suspect.refitted(fit, chi2_reduction(fit)), candidate=formed.at(fit.point.values))


def _in_its_place(fitter: Fitter, state: StepwiseState, suspect: Refitted) -> tuple[Refitted, Prediction | None, str]:
    """A suspect with its derivatives in the place of the last cause, its prediction, and why it would be no cause."""
    earlier, (cause, _) = [cause.candidate for cause, _ in state.causes[:-1]], state.causes[-1]
    base = without_cause(fitter, state.null, state.final, cause, earlier)
    extended = fitter.with_derivatives(suspect.fit)
    in_its_place = replace(suspect, fit=extended)
    if not base.names:  # the earlier ones cannot be simulated alone
        return in_its_place, None, ""
    if earlier:
        base = fitter.with_derivatives(base)
    made = extension(fitter.evidence, base, extended, suspect, state.rounds[-1].threshold)
    return in_its_place, made.prediction, rejection(fitter.evidence, state.null, made, further=bool(earlier))


def _with_laws(state: StepwiseState, cause: Cause, prediction: Prediction | None) -> Round:
    """Return the last search with a cause and its rivals as fitted since, their reductions in the noise of then.

    Both noises differ as the chi-squares of the calibrated model do.
    """
    last = state.rounds[-1]
    scale = last.chi2_of_null / state.null.chi2
    rivals = {rival.name: replace(rival, chi2_reduction=scale * rival.chi2_reduction) for rival in cause[1]}
    suspects = [*rivals.values(), *(s for s in last.suspects if s.name not in rivals)]
    ordered = tuple(sorted(suspects, key=lambda s: -s.known_reduction))
    chosen = rivals[cause[0].name]
    return replace(last, suspects=ordered, chosen=chosen, rivals=tuple(rivals.values()), prediction=prediction)


def _fall(evidence: Evidence, cause: Refitted, fit: Fit) -> float:
    """Fall of chi-square from the model with a cause to another fit, where the simulations of both are reliable."""
    common = evidence.with_weights([cause.fit.point.simulated, fit.point.simulated])
    return cause.fit.chi2_over(common) - fit.chi2_over(common)
