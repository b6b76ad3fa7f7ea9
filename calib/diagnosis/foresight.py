"""What of a search for causes is still to come, in steps whose simulations are measured as it goes."""

from collections.abc import Sequence

from calib.diagnosis.candidate import Candidate
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.effort import PAIR, SCORE, SEARCH, SETTINGS, SUSPECT
from calib.diagnosis.excess import chi2_std, excess_chi2, significant
from calib.diagnosis.fit import Fit
from calib.diagnosis.refit import Fitter

FITS_PER_SUSPECT = 2  # from its estimated size, and from others or of its form, as measured  [count]
SUSPECTS_PER_CANDIDATE = 0.25  # leaders, those similar to the best, and rivals in another noise, as measured  [1]
FURTHER_CAUSES, PAIRS, NEXT_MEASUREMENT = "further causes", "pairs", "next measurement"  # stages that may follow
SEARCHES_BESIDE_NONE = 2.0  # where there is a misfit: between one and those beside two causes  [count]
SEARCHES_BESIDE_CAUSES = 4.0  # further ones and those again, where the causes leave a misfit, as measured  [count]
SEARCHES_AFTER_FURTHER = 3.0  # where a suspect beside causes is significant, as measured  [count]
SEARCHES_TO_CONFIRM_NONE = 0.3  # where the calibrated model leaves noise: most end with scores, as measured  [count]
SEARCHES_TO_CONFIRM_CAUSES = 1.0  # where causes leave noise, beside those for each of several again  [count]
SHARE_SCORED_AGAIN = 0.5  # of parameters, where derivatives are of another model, as measured  [1]
SHARE_OF_RIVALS = 0.35  # of searches whose leaders are similar, that end with rivals: some differ in their fits  [1]


def foresee_search(fitter: Fitter, base: Fit | None, causes: int, candidates: Sequence[Candidate]) -> None:
    """Foresee a search beside so many causes, and what follows it.

    Parameters
    ----------
    base : model with these causes; None: the calibrated one, which is not fitted yet
    candidates : among which it searches
    """
    each = fitter.expected_simulations(0, 1)
    score = fitter.expected_simulations(1, 0)
    suspect = FITS_PER_SUSPECT * each
    leaders = min(CRITERIA.max_refits, SUSPECTS_PER_CANDIDATE * len({candidate.name for candidate in candidates}))
    search = leaders * suspect
    fitter.effort.priors |= {SCORE: score, SUSPECT: suspect, PAIR: suspect, SEARCH: search}
    misfit = base is None or significant(excess_chi2(fitter.evidence, base), chi2_std(fitter.evidence))
    if misfit:
        searches = SEARCHES_BESIDE_CAUSES if causes else SEARCHES_BESIDE_NONE
    else:  # several causes are each searched for again
        confirming = SEARCHES_TO_CONFIRM_CAUSES if causes else SEARCHES_TO_CONFIRM_NONE
        searches = confirming + (causes if causes > 1 else 0)
    pairs = CRITERIA.max_pairs if misfit and causes else 0
    fitter.effort.later |= {FURTHER_CAUSES: (searches, SEARCH), PAIRS: (pairs, PAIR)}


def foresee_scores(fitter: Fitter, candidates: Sequence[Candidate], times: float = 1.0) -> None:
    """Foresee the scores of candidates, so many times."""
    fitter.foresee(SCORE, times * _scored(candidates))


def foresee_suspects(fitter: Fitter, base: Fit, number: int) -> None:
    """Foresee the refits of so many suspects in a search beside the model `base`, and by them the size of others."""
    effort = fitter.effort
    searches, kind = effort.later.get(FURTHER_CAUSES, (0.0, SEARCH))
    least = SEARCHES_AFTER_FURTHER if len(base.candidates) == 1 and number else 0.0
    effort.later[FURTHER_CAUSES] = max(least, searches - 1.0), kind
    effort.priors[SEARCH] = effort.expected(SUSPECT, number)
    fitter.foresee(SUSPECT, number)


def foresee_replacement(fitter: Fitter, searches: float, candidates: Sequence[Candidate]) -> None:
    """Foresee so many searches among candidates for a cause beside others."""
    fitter.effort.later[FURTHER_CAUSES] = searches, SEARCH
    foresee_scores(fitter, candidates, searches * SHARE_SCORED_AGAIN)


def foresee_conclusion(fitter: Fitter) -> None:
    """Foresee that no further search for causes follows; one that the budget ended stays foreseen."""
    fitter.effort.later |= {FURTHER_CAUSES: (0.0, SEARCH), PAIRS: (0.0, PAIR)}
    if not fitter.effort.spent:
        fitter.effort.foresee(0)


def foresee_pairs(fitter: Fitter, candidates: Sequence[Candidate]) -> None:
    """Foresee scores of candidates, fits of pairs of them, and a search for one of the best pair beside the other."""
    fitter.effort.later |= {FURTHER_CAUSES: (1.0, SEARCH), PAIRS: (0.0, PAIR)}
    scores = fitter.effort.expected(SCORE, _scored(candidates))
    fitter.effort.foresee(scores + fitter.effort.expected(PAIR, CRITERIA.max_pairs))


def foresee_rivals(fitter: Fitter, chance: float) -> None:
    """Foresee the search of a next measurement by the chance that several causes are indistinguishable."""
    if SETTINGS in fitter.effort.priors:
        fitter.effort.later[NEXT_MEASUREMENT] = chance, SETTINGS


def _scored(candidates: Sequence[Candidate]) -> int:
    """Number of parameters of candidates that have a score."""
    return sum(len(candidate.free) for candidate in candidates if candidate.effect.differentiable)
