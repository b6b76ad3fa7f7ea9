"""Causes replaced by others that explain more: one at a time, or all of them by the best pair."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from calib.diagnosis.candidate import Candidate
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.excess import chi2_std, excess_chi2
from calib.diagnosis.refit import Fit, Fitter
from calib.diagnosis.screening import KnownDerivatives
from calib.diagnosis.search import Round, search
from calib.diagnosis.suspect import Cause, Refitted, Suspect


def replaced(
    fitter: Fitter,
    null: Fit,
    causes: Sequence[Cause],
    final: Fit,
    candidates: Sequence[Candidate],
    seed: int,
    known: KnownDerivatives,
    last_too: bool = False,
) -> tuple[list[Cause], Fit]:
    """Take out each cause but the last in turn and search again: what stood for two causes gives way to one of them.

    The first cause was chosen while the later ones were missing, and may have explained part of theirs (sequential
    replacement: Miller, Subset Selection in Regression, 2002, section 3). It is dropped where the others explain as
    much without it, and replaced where another explains more beside them; the last is then looked for again as well,
    or anyway.
    """
    kept, again, latest = list(causes), last_too, causes[-1][0]
    for cause, rivals in causes:
        if cause is latest and not again:
            break
        index = [c is cause for c, _ in kept].index(True)
        unchanged = cause, rivals if cause is latest else (cause,)
        others = tuple(c.candidate for c, _ in kept if c is not cause)
        without = without_cause(fitter, null, final, cause, others)
        if not without.names:  # no motion without it
            kept[index] = unchanged
            continue
        outcome = _search_beside(fitter, without, others, candidates, seed, known, final.chi2)
        chi2_increase = without.chi2 - final.chi2
        if _gives_way(cause, outcome, chi2_increase):
            again = again or outcome.chosen.name != cause.name
            final = fitter.with_derivatives(outcome.chosen.fit)
            kept[index] = outcome.chosen, outcome.rivals
        elif chi2_increase < outcome.threshold**2:
            kept, final = [pair for pair in kept if pair[0] is not cause], without
        else:
            kept[index] = unchanged
    return kept, final


def without_cause(fitter: Fitter, null: Fit, final: Fit, cause: Refitted, others: Sequence[Candidate]) -> Fit:
    """Fit the other causes alone, from the calibrated values beside all, or else from those beside none."""
    if not others:
        return null
    own = cause.candidate.absent()
    rest = {name: value for name, value in final.point.values.items() if name not in own}
    sizes = {name: final.value(name) for candidate in others for name in candidate.values(candidate.null)}
    fit = fitter.fit(replace(final.point, values=rest), others, sizes)
    return fit if fit.names else fitter.fit(null.point, others, sizes)


def _search_beside(
    fitter: Fitter,
    without: Fit,
    others: Sequence[Candidate],
    candidates: Sequence[Candidate],
    seed: int,
    known: KnownDerivatives,
    attained: float,
) -> Round:
    """Search for a cause beside the others, of which the model `without` is made."""
    taken = {candidate.name for candidate in others}
    rest = [c for c in candidates if c.name not in taken]
    excess_std = excess_chi2(fitter.evidence, without) / chi2_std(fitter.evidence)
    return search(fitter, without, rest, seed, excess_std, known, attained)


def _gives_way(cause: Refitted, outcome: Round, chi2_increase: float) -> bool:
    """Whether a cause, without which chi-square rises so much, is found again or another one has a lower AIC."""
    if cause.name in {rival.name for rival in outcome.rivals}:
        return True
    best = outcome.chosen
    return best is not None and best.chi2_reduction - best.aic_penalty > chi2_increase - cause.aic_penalty


def aic(causes: Sequence[Cause], final: Fit) -> float:
    """Akaike's criterion of a model with these causes, less that of no parameter."""
    return final.chi2 + sum(cause.aic_penalty for cause, _ in causes)


def best_pair(fitter: Fitter, null: Fit, suspects: Sequence[Suspect]) -> tuple[list[Cause], Fit] | None:
    """The two causes of the least AIC beside the calibrated model, fitted; None where there are no two.

    Those pairs are fitted of which the least is predicted: the reduction of chi-square is linearly, along both
    signatures, which orders them, but may miss the actual one by half.
    """
    testable = [s for s in suspects if s.is_testable and s.signature_columns.any()]
    residual, predicted = null.projection(null.residual), []
    for pair in combinations(testable, 2):
        reduction = _predicted_reduction(residual, *pair) - pair[0].aic_penalty - pair[1].aic_penalty
        if pair[0].name != pair[1].name and reduction > 0.0:
            predicted.append((reduction, pair))
    best, attained = None, np.inf
    for _, pair in sorted(predicted, key=lambda one: -one[0])[: CRITERIA.max_pairs]:
        if best is not None and fitter.effort.spent:
            break
        candidates = tuple(suspect.candidate for suspect in pair)
        sizes = {name: size for candidate in candidates for name, size in candidate.absent().items()}
        fit = fitter.fit(null.point, candidates, sizes, rival=attained)
        causes = [suspect.refitted(fit, null.chi2 - fit.chi2) for suspect in pair] if fit.names else []
        pairs = [(cause, (cause,)) for cause in causes]
        if pairs and (best is None or aic(pairs, fit) < aic(*best)):
            best, attained = (pairs, fit), fit.chi2
    return best and (best[0], fitter.with_derivatives(best[1]))


def _predicted_reduction(residual: np.ndarray, one: Suspect, other: Suspect) -> float:
    """Reduction of chi-square (N,) along the signatures of two suspects; minus infinity where a sign is impossible."""
    columns = np.column_stack([one.signature_columns, other.signature_columns])
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    score = columns.T @ residual
    theta = np.linalg.lstsq(columns.T @ columns, score, rcond=1e-6)[0]
    split = len(one.candidate.free)
    possible = one.candidate.sign * theta[:split] >= 0.0, other.candidate.sign * theta[split:] >= 0.0
    return float(score @ theta) if np.concatenate(possible).all() else -np.inf
