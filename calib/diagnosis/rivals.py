"""Which of the refitted suspects explain the residual alike."""

from collections.abc import Sequence

import numpy as np
import scipy

from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.excess import chi2_std, excess_chi2, reduced_chi2, significant
from calib.diagnosis.score import deviate
from calib.diagnosis.suspect import Refitted, Suspect, leading_variants


def rival_suspects(evidence: Evidence, refitted: Sequence[Refitted], threshold: float) -> tuple[Refitted, ...]:
    """Suspects indistinguishable from the one of the least AIC, one of each effect, the best first.

    A simpler one is a rival too where the gain by the further parameters of the best is below the threshold of |z|:
    beside it they would be no cause either. Where the best leaves more than noise, differences are judged by the
    quasi-likelihood, divided by its reduced chi-square (Burnham & Anderson 2002, section 2.5). One that contains
    another rival as a special case is none where it explains no more: where that is in the confidence region of its
    further parameters, and is not left out for a special case of its own, which the other law need not contain.
    """
    ordered = sorted(refitted, key=lambda s: s.aic_penalty - s.chi2_reduction)
    if not ordered:
        return ()
    best = ordered[0]
    dispersion = reduced_chi2(evidence, best.fit)
    rivals = leading_variants(s for s in ordered if _is_rival(s, best, dispersion, threshold))
    return tuple(rival for rival in rivals if not _is_represented(rival, rivals, dispersion))


def special_cases(
    rivals: Sequence[Refitted], possible: Sequence[Refitted], suspects: Sequence[Suspect]
) -> list[Refitted]:
    """Possible causes that are no rivals with the form they are tried with, and that rivals contain as special cases.

    What rivals explain beyond them may be the poorer guess of their form: nested models are compared at their maxima.
    Among all suspects it is known what contains what.
    """
    contained = {name for rival in rivals for name in rival.generalises}
    while more := {name for s in suspects if s.name in contained for name in s.generalises} - contained:
        contained |= more
    others = contained - {rival.name for rival in rivals}
    return leading_variants(sorted((s for s in possible if s.name in others), key=lambda s: -s.chi2_reduction))


def within_reach(evidence: Evidence, rivals: Sequence[Refitted], possible: Sequence[Refitted]) -> list[Refitted]:
    """Possible causes that are no rivals with the form they are tried with, and that a better one might make the best.

    What separates them from the best is less than this may leave above noise, which is known to the standard deviation
    of the chi-square of noise: a guess of the form may make that much. One of each effect.
    """
    best, known = rivals[0], {rival.name for rival in rivals}
    most_left = excess_chi2(evidence, best.fit) + CRITERIA.significance_std * chi2_std(evidence)
    least = best.chi2_reduction - max(0.0, most_left)
    others = (s for s in possible if s.name not in known and s.candidate.bounds and s.chi2_reduction > least)
    return leading_variants(sorted(others, key=lambda s: -s.chi2_reduction))


def chi2_of_another_rival(evidence: Evidence, rivals: Sequence[Refitted], other: Suspect) -> float:
    """Chi-square up to which another suspect, with its form fitted, is a rival beside these.

    Beside a special case of it where that is outside the confidence region of its further parameters, beside others
    where their AIC is as high, but for a tie.
    """
    count, limits = other.candidate.max_parameter_count, []
    for rival in rivals:
        further, dispersion = count - rival.parameter_count, reduced_chi2(evidence, rival.fit)
        fall = dispersion * _confidence_limit(further)
        rise = -fall if _contains(other, rival) else CRITERIA.aic_tie * dispersion - 2.0 * further
        limits.append(rival.fit.chi2 + rise)
    return min(limits)


def not_refuted(evidence: Evidence, rivals: Sequence[Refitted], special: Sequence[Refitted]) -> list[Refitted]:
    """Special cases in the confidence region of the further parameters of the best rival (likelihood-ratio test)."""
    best = min(rivals, key=lambda s: s.aic_penalty - s.chi2_reduction)
    dispersion = reduced_chi2(evidence, best.fit)
    return [s for s in special if _in_confidence_region(s, best, dispersion)]


def with_possible_causes(
    evidence: Evidence, rivals: Sequence[Refitted], refitted: Sequence[Refitted]
) -> tuple[Refitted, ...]:
    """Rivals, the best first, and those refitted suspects that explain less than the best by a model error only.

    Where the best leaves more than noise another suspect, which explains about as much, may be the cause. Then the
    residual beside that other, of excess R, makes an angle with the difference d of both models whose cosine is
    (X2 of the other - X2 of the best + |d|^2) / (2 |d| sqrt(R)); a model error has such a cosine with a given
    difference only by chance.
    """
    if not rivals or not significant(excess_chi2(evidence, rivals[0].fit), chi2_std(evidence)):
        return tuple(rivals)
    known = {rival.name for rival in rivals}
    others = sorted((s for s in refitted if s.name not in known), key=lambda s: s.fit.chi2)
    return tuple(leading_variants([*rivals, *(s for s in others if _may_be_the_cause(evidence, s, rivals[0]))]))


def _may_be_the_cause(evidence: Evidence, other: Refitted, best: Refitted) -> bool:
    """Whether a suspect may be the cause in the place of the best, a model error beside it given."""
    difference = other.fit.residual - best.fit.residual
    square = float(difference @ difference)
    if other.chi2_reduction < CRITERIA.min_explained_share * best.chi2_reduction:
        return False
    product = np.sqrt(square * excess_chi2(evidence, other.fit))
    return other.fit.chi2 - best.fit.chi2 + square <= 2.0 * CRITERIA.max_model_error_cosine * product


def simplest(rivals: Sequence[Refitted]) -> Refitted:
    """The rival of the fewest parameters; of several, the one that reduces chi-square most."""
    return min(rivals, key=lambda s: (s.aic_penalty, -s.chi2_reduction))


def _is_rival(other: Refitted, best: Refitted, dispersion: float, threshold: float) -> bool:
    """Whether a suspect is indistinguishable from the best."""
    gap = best.chi2_reduction - other.chi2_reduction
    further = best.parameter_count - other.parameter_count
    tie = gap + other.aic_penalty - best.aic_penalty <= CRITERIA.aic_tie * dispersion
    return tie or (further > 0 and bool(deviate(gap / dispersion, further) <= threshold))


def _contains(general: Suspect, special: Refitted) -> bool:
    """Whether a suspect contains another, as that is fitted, as a special case: one of no more parameters cannot."""
    return special.name in general.generalises and general.candidate.max_parameter_count > special.parameter_count


def _is_represented(suspect: Refitted, rivals: Sequence[Refitted], dispersion: float) -> bool:
    """Whether a rival that is a special case of a suspect, and stays one, explains as much."""
    special = (s for s in rivals if _contains(suspect, s) and _in_confidence_region(s, suspect, dispersion))
    return any(not _is_represented(s, rivals, dispersion) for s in special)


def _in_confidence_region(special: Refitted, general: Refitted, dispersion: float) -> bool:
    """Whether a special case is in the confidence region of the general suspect's further parameters."""
    gap, further = general.chi2_reduction - special.chi2_reduction, general.parameter_count - special.parameter_count
    return gap <= _confidence_limit(further) * dispersion


def _confidence_limit(further: int) -> float:
    """Rise of chi-square at the edge of the confidence region of so many further parameters (likelihood ratio)."""
    return float(scipy.stats.chi2.ppf(CRITERIA.confidence_level, max(1, further)))
