"""Suspects with their forms fitted: an effect is tried with a guess of what gives it its form, such as a width."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from calib.diagnosis.evidence import Evidence
from calib.diagnosis.fit import Fit
from calib.diagnosis.refit import Fitter
from calib.diagnosis.rivals import chi2_of_another_rival, not_refuted, special_cases, within_reach
from calib.diagnosis.suspect import Refitted, Screened


def with_free_form(
    fitter: Fitter, suspect: Refitted, chi2_reduction: Callable[[Fit], float], rival: float = np.inf
) -> Refitted | None:
    """Return the suspect with its form fitted too; None where it cannot be simulated.

    chi2_reduction : by the model that is fitted
    rival : chi-square that another model attains, as `Fitter.fit` takes it
    """
    candidate = suspect.candidate
    formed = replace(candidate, form=tuple(candidate.bounds))
    candidates = tuple(formed if c is candidate else c for c in suspect.fit.candidates)
    fit = fitter.fit(suspect.fit.point, candidates, rival=rival)
    if not fit.names:
        return None
    return replace(suspect, candidate=formed.at(fit.point.values), fit=fit, chi2_reduction=chi2_reduction(fit))


def with_best_forms(
    fitter: Fitter,
    rivals: Sequence[Refitted],
    possible: Sequence[Refitted],
    suspects: Sequence[Screened],
    before: float,
    common: Evidence,
) -> dict[int, Refitted]:
    """Suspects to be compared again, each with its best-fitting form, by the id of the candidate as it was tried.

    Indistinguishable ones, those that they contain and do not refute, and others that a better form brings into reach.

    before : chi-square of the model without a suspect, over the evidence `common`
    """
    evidence = fitter.evidence
    special = special_cases(rivals, possible, suspects)
    contained = {s.name for s in special}
    others = [s for s in within_reach(evidence, rivals, possible) if s.name not in contained]

    def fitted_form(suspect: Refitted, own: Fitter) -> Refitted:
        bound = chi2_of_another_rival(evidence, rivals, suspect) if suspect in others else np.inf
        return own.attempt(partial(_with_best_form, own, suspect, before, common, bound)) or suspect

    again = [*rivals, *special, *others]
    formed = list(fitter.in_turn([partial(fitted_form, suspect) for suspect in again]))
    own, end = formed[: len(rivals)], len(rivals) + len(special)
    kept = [*own, *not_refuted(evidence, own, formed[len(rivals) : end]), *formed[end:]]
    return {id(s.candidate): other for s, other in zip(again, formed, strict=True) if other in kept}


def _with_best_form(fitter: Fitter, suspect: Refitted, before: float, common: Evidence, rival: float) -> Refitted:
    """Return the suspect with its form fitted too, where that lowers its AIC.

    The form with which an effect is tried is a guess: the residual of a poor one would be taken for a further cause.

    before : chi-square of the model without the suspect, over the evidence `common`
    rival : chi-square that another model attains, as `Fitter.fit` takes it
    """
    if not suspect.candidate.bounds or not suspect.fit.names:
        return suspect
    other = with_free_form(fitter, suspect, lambda fit: before - fit.chi2_over(common), rival)
    if other is None or other.chi2_reduction - other.aic_penalty <= suspect.chi2_reduction - suspect.aic_penalty:
        return suspect
    return other
