"""One step of forward selection: candidates scored, the leading ones refitted, the best compared with its rivals."""

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from calib.diagnosis.candidate import Candidate
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.effort import SEARCH, SUSPECT, BudgetSpent
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.excess import chi2_std, dominant, excess_chi2
from calib.diagnosis.fit import Fit
from calib.diagnosis.foresight import SHARE_OF_RIVALS, foresee_rivals, foresee_suspects
from calib.diagnosis.free_form import with_best_forms
from calib.diagnosis.prediction import Prediction
from calib.diagnosis.refit import Fitter
from calib.diagnosis.rivals import rival_suspects, simplest, with_possible_causes
from calib.diagnosis.score import deviate
from calib.diagnosis.screening import KnownDerivatives, screened
from calib.diagnosis.suspect import Refitted, Scored, Screened, Suspect, cosine, is_testable, leading_variants


@dataclass(frozen=True, eq=False)
class Round:
    """One search for a cause.

    Attributes
    ----------
    base : the model so far
    suspects : all candidates, the strongest first
    threshold : of |z|
    chosen : the refitted suspect that explains most, None where none is significant
    rivals : suspects indistinguishable from the chosen one, which is the simplest of them
    base_chi2 : chi-square of the base, over the samples on which the refitted suspects are compared
    prediction : of the chosen suspect, or of the one that was rejected; None where that was not or cannot be tested
    rejected : the suspect that explains most where it is no cause, None where it is one or there is none
    rejection : why it is none
    untried : suspects that were to be refitted when the budget was spent
    chi2_of_null : of the calibrated model, in the noise of this search; NaN where it was not computed
    """

    base: Fit
    suspects: tuple[Suspect, ...]
    threshold: float
    chosen: Refitted | None
    rivals: tuple[Refitted, ...]
    base_chi2: float
    prediction: Prediction | None = None
    rejected: Refitted | None = None
    rejection: str = ""
    untried: tuple[str, ...] = ()
    chi2_of_null: float = np.nan

    def without_cause(self, reason: str) -> "Round":
        """Return the same search with its chosen suspect rejected."""
        return replace(self, chosen=None, rivals=(), rejected=self.chosen, rejection=reason)

    @property
    def margin(self) -> float:
        """Reduction of chi-square by the best rival less that by the best distinguishable suspect, or less nothing."""
        rivals = {rival.name for rival in self.rivals}
        refitted = (s for s in self.suspects if isinstance(s, Refitted) and s.name not in rivals)
        others = (s.chi2_reduction for s in refitted if not rivals & set(s.generalises))
        return max(rival.chi2_reduction for rival in self.rivals) - max(others, default=0.0)


def search(
    fitter: Fitter,
    base: Fit,
    candidates: Sequence[Candidate],
    seed: int,
    excess_std: float,
    known: KnownDerivatives,
    attained: float = np.inf,
) -> Round:
    """Find the candidate that explains most of the residual of the model `base`.

    Parameters
    ----------
    excess_std : excess chi-square of the base, in standard deviations of that of noise; candidates without derivative
        are tried where it is significant, or where others are above the threshold
    known : derivatives of candidates from an earlier search; those that are computed here are added
    attained : chi-square that one of the candidates is known to attain

    Raises
    ------
    BudgetSpent : before all candidates are scored
    """
    scored = fitter.attempt(partial(_rescored, fitter, base, candidates, seed, known))
    if scored is None:
        raise BudgetSpent
    with fitter.measuring(SEARCH):
        return _chosen(fitter, base, *scored, seed, excess_std, attained)


def _chosen(
    fitter: Fitter,
    base: Fit,
    suspects: Sequence[Screened],
    threshold: float,
    seed: int,
    excess_std: float,
    attained: float,
) -> Round:
    """Refit the leaders of scored suspects, and choose the one that explains most."""
    significant = _significant(suspects, threshold)
    leaders = _leaders(suspects, significant, excess_std)
    further = _foresee_refits(fitter, base, leaders, significant)
    refitted, untried = _refits(fitter, base, leaders, further, threshold, attained)
    similar = [s for s in _similar_to_the_best(significant, refitted) if s.name not in untried]
    refitted, more = _refits(fitter, base, similar, 0, threshold, attained, refitted)
    untried = (*untried, *more)
    if not base.candidates and fitter.is_at_an_edge(base) and _leaves_dominant_misfit(fitter.evidence, base, refitted):
        refitted, more = _refits_from_the_middle(fitter, base, suspects, seed, threshold, attained, refitted)
        untried = (*untried, *more)
    before = base.chi2
    possible: list[Refitted] = []
    rivals: tuple[Refitted, ...] = ()
    if refitted:
        common = fitter.evidence.with_weights([base.point.simulated, *(s.fit.point.simulated for s in refitted)])
        before = base.chi2_over(common)
        refitted = [replace(s, chi2_reduction=before - s.fit.chi2_over(common)) for s in refitted]
        possible = [s for s in refitted if _is_possible(s, threshold)]
        rivals = rival_suspects(fitter.evidence, possible, threshold)
    latest = {id(s.candidate): s for s in refitted}
    if rivals:
        kept = with_best_forms(fitter, rivals, possible, suspects, before, common)
        latest |= kept
        rivals = rival_suspects(fitter.evidence, list(kept.values()), threshold)
    compared = sorted((latest.get(id(s.candidate), s) for s in suspects), key=lambda s: -s.known_reduction)
    chosen = simplest(rivals) if rivals else None
    rivals = with_possible_causes(fitter.evidence, rivals, [latest[id(s.candidate)] for s in possible])
    return Round(base, tuple(compared), threshold, chosen, rivals, before, untried=untried)


def _rescored(
    fitter: Fitter, base: Fit, candidates: Sequence[Candidate], seed: int, known: KnownDerivatives
) -> tuple[list[Screened], float]:
    """Score the candidates; those that may lead by derivatives of another model again, by derivatives of this one."""
    of_another_model = set(known)
    suspects, threshold = screened(fitter, base, candidates, seed, known)
    significant = _significant(suspects, threshold)
    least = CRITERIA.min_rescored_share * _largest_reduction(significant)
    old = [s for s in significant if id(s.candidate) in of_another_model and s.predicted_reduction >= least]
    for suspect in old:
        del known[id(suspect.candidate)]
    return screened(fitter, base, candidates, seed, known) if old else (suspects, threshold)


def _significant(suspects: Sequence[Screened], threshold: float) -> list[Scored]:
    """Suspects above the threshold of |z| whose sizes have an admissible sign, in their order."""
    above = [s for s in suspects if is_testable(s) and abs(s.z) > threshold]
    return [s for s in above if not s.candidate.sign * s.test.size[0] < 0.0]


def _largest_reduction(suspects: Sequence[Scored]) -> float:
    """Largest reduction of chi-square that score tests predict."""
    return max((s.predicted_reduction for s in suspects), default=0.0)


def _leaders(suspects: Sequence[Screened], significant: Sequence[Scored], excess_std: float) -> list[Screened]:
    """Suspects to be refitted: those with the largest predicted reductions, then those without a score test."""
    least = CRITERIA.min_leader_share * _largest_reduction(significant)
    leading = leading_variants(significant)
    leaders: list[Screened] = []
    leaders += [s for s in leading if s.predicted_reduction >= least][: CRITERIA.max_refits]
    if significant or excess_std > CRITERIA.significance_std:
        untestable = [s for s in suspects if not (s.is_testable or s.deferred or s.candidate.effect.noise)]
        leaders += [s for s in untestable if s.absorbed < CRITERIA.max_absorbed_share]
    return leaders


def _foresee_refits(fitter: Fitter, base: Fit, leaders: Sequence[Screened], significant: Sequence[Scored]) -> int:
    """Foresee the refits of the leaders, and of others similar to the first; return the number of the latter."""
    names = {leader.name for leader in leaders}
    similar = [s.name for s in leading_variants(significant) if leaders and _changes_similarly(s, leaders[0])]
    further = min(CRITERIA.max_refits, len({*similar} - names))
    foresee_suspects(fitter, base, len(leaders) + further)
    if not base.candidates:
        foresee_rivals(fitter, SHARE_OF_RIVALS if len(similar) > 1 else 0.0)
    return further


def _similar_to_the_best(significant: Sequence[Scored], refitted: Sequence[Refitted]) -> list[Scored]:
    """Suspects that were not refitted, and change the records similarly to the one that explains most.

    Their score tests do not decide which of them explains more: where the misfit is large, their errors are larger.
    """
    done = {s.name for s in refitted}
    others = [s for s in leading_variants(significant) if s.name not in done]
    return [s for s in others if _is_similar_to_the_best(s, refitted)][: CRITERIA.max_refits]


def _is_similar_to_the_best(suspect: Suspect, refitted: Sequence[Refitted]) -> bool:
    """Whether a suspect changes the records similarly to the refitted one that explains most."""
    best = min(refitted, key=lambda s: s.fit.chi2, default=None)
    return best is not None and _changes_similarly(suspect, best)


def _changes_similarly(one: Suspect, other: Suspect) -> bool:
    """Whether two suspects change the records similarly."""
    return (cosine(one, other) or 0.0) >= CRITERIA.min_signature_cosine


# --- refits -----------------------------------------------------------------------------------------------------------


def _refits(
    fitter: Fitter,
    base: Fit,
    leaders: Sequence[Screened],
    further: int,
    threshold: float,
    attained: float,
    before: Sequence[Refitted] = (),
) -> tuple[list[Refitted], tuple[str, ...]]:
    """Refit the leaders, and add them to those refitted before; names of those for which the budget did not suffice.

    A fit that is predicted to attain less than the best is abandoned, but not that of a suspect that changes the
    records similarly to the best: the error of the prediction then exceeds the final difference of the two.

    further : number of suspects that may be refitted after these
    attained : chi-square that one of the candidates is known to attain
    """
    refitted, untried = list(before), []

    def fitted_below(suspect: Screened, own: Fitter) -> Refitted | None:
        bound = chi2_of_a_rival(refitted, base, threshold, attained)
        rival = np.inf if _is_similar_to_the_best(suspect, refitted) else bound
        return own.attempt(partial(_refitted, own, base, suspect, threshold, rival))

    with closing(fitter.in_turn([partial(fitted_below, suspect) for suspect in leaders])) as results:
        for number, suspect in enumerate(leaders):
            fitter.foresee(SUSPECT, len(leaders) - number + further)
            with fitter.measuring(SUSPECT):
                fitted = next(results) if fitter.effort.suffices() else None
            if fitted is not None:
                refitted.append(fitted)
            elif fitter.effort.spent:
                untried.append(suspect.name)
    return refitted, tuple(dict.fromkeys(untried))


def _leaves_dominant_misfit(evidence: Evidence, base: Fit, refitted: Sequence[Refitted]) -> bool:
    """Whether the best suspect, or the model without one, leaves a misfit that dominates the noise."""
    best = min((s.fit for s in refitted), key=lambda fit: fit.chi2, default=base)
    return dominant(excess_chi2(evidence, best), chi2_std(evidence))


def _refits_from_the_middle(
    fitter: Fitter,
    base: Fit,
    suspects: Sequence[Screened],
    seed: int,
    threshold: float,
    attained: float,
    refitted: Sequence[Refitted],
) -> tuple[list[Refitted], tuple[str, ...]]:
    """Fit suspects from the middle of the windows too, and take the better fit of each; names of those untried.

    A calibrated value at the edge of its window compensates for a model error, by another motion: the error of score
    tests there exceeds the reduction that they predict, and fits from there end in another minimum. All are fitted that
    have a derivative in both places, one variant of each.

    suspects : scored on the residual of `base`
    attained : chi-square that one of the candidates is known to attain
    """
    scored_there = fitter.attempt(partial(_scored_in_the_middle, fitter, base, suspects, seed))
    if scored_there is None:
        return list(refitted), ()
    middle, at_middle = scored_there
    scored, latest = {id(s.candidate): s for s in suspects}, {id(s.candidate): s for s in refitted}
    leaders = leading_variants(s for s in at_middle if is_testable(s) and scored[id(s.candidate)].is_testable)
    fitter.foresee(SUSPECT, len(leaders))
    untried = []

    def fitted_below(suspect: Scored, own: Fitter) -> Fit | None:
        known, candidate = list(latest.values()), suspect.candidate
        similar = _is_similar_to_the_best(scored[id(candidate)], known)
        bound = np.inf if similar else chi2_of_a_rival(known, base, threshold, attained)
        columns = np.column_stack([middle.columns, suspect.derivatives])
        return own.attempt(partial(own.fit, middle.point, (candidate,), candidate.absent(), columns, bound))

    with closing(fitter.in_turn([partial(fitted_below, suspect) for suspect in leaders])) as fits:
        for suspect in leaders:
            fit, key = next(fits) if fitter.effort.suffices() else None, id(suspect.candidate)
            if fit is None:
                untried.append(suspect.name)
            elif fit.names and fit.chi2 < (latest[key].fit if key in latest else base).chi2:
                latest[key] = scored[key].refitted(fit, base.chi2 - fit.chi2)
    return list(latest.values()), tuple(untried)


def _scored_in_the_middle(
    fitter: Fitter, base: Fit, suspects: Sequence[Screened], seed: int
) -> tuple[Fit, list[Screened]] | None:
    """The model in the middle of its windows, and suspects scored on its residual; None where it fails there."""
    middle = fitter.in_the_middle(base)
    return None if middle is None else (middle, screened(fitter, middle, [s.candidate for s in suspects], seed)[0])


def chi2_of_a_rival(refitted: Sequence[Refitted], base: Fit, threshold: float, attained: float = np.inf) -> float:
    """Chi-square up to which a suspect may still be an alternative to those refitted; fits above it are abandoned.

    attained : chi-square that one of the candidates is known to attain
    """
    best = min([attained, *(s.fit.chi2 for s in refitted)])
    return best + (2.0 * CRITERIA.aic_tie + threshold**2) * max(1.0, best / base.residual.size)


def _refitted(fitter: Fitter, base: Fit, suspect: Screened, threshold: float, rival: float) -> Refitted | None:
    """Fit all parameters with the suspect in the model, from its estimated size or from several; None without any.

    One without derivative is first tried at several sizes: a size at which its fit begins has to predict a reduction of
    chi-square near the threshold. So is one whose refit reduces chi-square by another amount than its score test
    predicts: it is far from linear, and its fit may have ended in a local minimum; a further fit begins only at a size
    that predicts more than that fit attained.

    rival : chi-square up to which the suspect may still be an alternative
    """
    fits = [_from_estimate(fitter, base, suspect, rival)] if is_testable(suspect) else []
    reduction = base.chi2 - fits[0].chi2 if fits else 0.0
    predicted = suspect.predicted_reduction
    if not fits or abs(reduction - predicted) > CRITERIA.max_nonlinearity * predicted:
        least = max(CRITERIA.min_trial_reduction * threshold**2, reduction)
        starts = _trial_sizes(fitter, base, suspect, least)
        fits += fitter.in_turn(
            [partial(_fitted, base=base, suspect=suspect, sizes=sizes, rival=rival) for sizes in starts]
        )
    best = min(fits, key=lambda fit: fit.chi2, default=None)
    return None if best is None else suspect.refitted(best, base.chi2 - best.chi2)


def _from_estimate(fitter: Fitter, base: Fit, suspect: Scored, rival: float) -> Fit:
    """Fit from the size that the score test estimates.

    Where the simulation fails there, for a large misfit makes the estimate large, from where the effect is absent.
    """
    columns = np.column_stack([base.columns, suspect.derivatives])
    fit = _fitted(fitter, base, suspect, _estimate(suspect), rival, columns)
    if fit.names:
        return fit
    candidate = suspect.candidate
    return fitter.fit(base.point, (*base.candidates, candidate), candidate.absent(), columns, rival)


def _fitted(
    fitter: Fitter, base: Fit, suspect: Suspect, sizes: np.ndarray, rival: float, columns: np.ndarray | None = None
) -> Fit:
    """Fit all parameters with the suspect in the model, from these sizes (p,)."""
    candidate = suspect.candidate
    start = candidate.values(np.clip(sizes, candidate.low, candidate.high))
    return fitter.fit(base.point, (*base.candidates, candidate), start, columns, rival)


def _estimate(suspect: Scored) -> np.ndarray:
    """Sizes (p,) that the score test estimates."""
    return suspect.candidate.within_scale(suspect.candidate.null + suspect.test.size)


def _trial_sizes(fitter: Fitter, base: Fit, suspect: Screened, least: float) -> list[np.ndarray]:
    """Sizes (p,) from which to fit: the best of those that predict a larger reduction of chi-square than the least.

    Without those from which it was fitted already.
    """
    candidate = suspect.candidate
    sizes = [np.clip(x, candidate.low, candidate.high) for x in candidate.sizes]
    trials = [trial for trial in fitter.trials(base, candidate, sizes) if trial is not None]
    trials.sort(key=lambda trial: -trial[0])
    starts = [candidate.within_scale(size) for reduction, size in trials[: CRITERIA.max_starts] if reduction > least]
    known = [_estimate(suspect)] if is_testable(suspect) else []
    return [x for k, x in enumerate(starts) if not any(np.allclose(x, other) for other in (*known, *starts[:k]))]


def _is_possible(suspect: Refitted, threshold: float) -> bool:
    """Whether a refitted suspect has an admissible size and explains enough to be a cause."""
    if not suspect.fit.names:
        return False
    candidate = suspect.candidate
    if candidate.sign and not (suspect.size[0] - candidate.null[0]) * candidate.sign > 0.0:
        return False
    return bool(deviate(suspect.chi2_reduction, len(candidate.free)) > threshold)
