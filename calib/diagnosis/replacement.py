"""Causes replaced by others that explain more: one at a time, or all of them by the best pair."""

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations

import numpy as np
import scipy

from calib.diagnosis.candidate import Candidate
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.effort import PAIR
from calib.diagnosis.excess import chi2_std, excess_chi2
from calib.diagnosis.fit import Fit
from calib.diagnosis.foresight import foresee_replacement
from calib.diagnosis.refit import Fitter
from calib.diagnosis.score import Projection
from calib.diagnosis.screening import KnownDerivatives
from calib.diagnosis.search import Round, search
from calib.diagnosis.suspect import Cause, Refitted, Scored, Screened, is_testable

REPLACEMENT_RANK_TOLERANCE = 1e-6  # singular value over the largest, of columns of unit length  [1]
MAX_REDUCTION_DIFFERENCE = 1e-6  # relative, of reductions of chi-square by pairs that count as equivalent  [1]


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
    """Remove each cause but the last in turn and search again: one that stood for two is replaced by one of them.

    The first cause was chosen while the later ones were missing, and may have explained part of theirs (sequential
    replacement: Miller, Subset Selection in Regression, 2002, chapter 3). It is dropped where the others explain as
    much without it, and replaced where another explains more beside them; the last is then searched for again as well,
    or in any case.
    """
    pairs, again, latest = list(causes), last_too, causes[-1][0]
    for number, (cause, rivals) in enumerate(causes):
        if cause is latest and not again:
            break
        foresee_replacement(fitter, len(causes) - number - (0.0 if again else 0.5), candidates)
        index = [c is cause for c, _ in pairs].index(True)
        unchanged: Cause = cause, rivals if cause is latest else (cause,)
        others = tuple(c.candidate for c, _ in pairs if c is not cause)
        without = without_cause(fitter, null, final, cause, others)
        if not without.names:  # it cannot be simulated without it
            pairs[index] = unchanged
            continue
        outcome = _search_beside(fitter, without, others, candidates, seed, known, final.chi2)
        chi2_increase = without.chi2 - final.chi2
        chosen = outcome.chosen
        if chosen is not None and _replaces(chosen, cause, outcome, chi2_increase):
            again = again or chosen.name != cause.name
            final = fitter.with_derivatives(chosen.fit)
            pairs[index] = chosen, outcome.rivals
        elif chi2_increase < outcome.threshold**2:
            pairs, final = [pair for pair in pairs if pair[0] is not cause], without
        else:
            pairs[index] = unchanged
    return pairs, final


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


def _replaces(chosen: Refitted, cause: Refitted, outcome: Round, chi2_increase: float) -> bool:
    """Whether a cause, without which chi-square rises by this, is among the rivals, or the chosen one has a lower AIC.

    Then the chosen one is put in its place.
    """
    if cause.name in {rival.name for rival in outcome.rivals}:
        return True
    return chosen.chi2_reduction - chosen.aic_penalty > chi2_increase - cause.aic_penalty


def aic(causes: Sequence[Cause], final: Fit) -> float:
    """Akaike's criterion of a model with these causes, less that of no parameter."""
    return final.chi2 + sum(cause.aic_penalty for cause, _ in causes)


def best_pair(
    fitter: Fitter,
    null: Fit,
    causes: Sequence[Cause],
    final: Fit,
    suspects: Sequence[Screened],
    beside: Sequence[Candidate] = (),
) -> tuple[list[Cause], Fit] | None:
    """The two other causes of the least AIC beside a model in the place of some, fitted; None where there are no two.

    The pairs of the least predicted criterion are fitted, predicted linearly about the model so far: its motion is
    nearer to the measured one than that of the calibrated model, and so is that of any pair that explains as much. Of
    equivalent pairs of a common member one is fitted.

    Parameters
    ----------
    null : the calibrated model, with the causes that stay where there are such
    causes, final : in whose place they are, and the model so far; none, and the calibrated one, without a cause yet
    suspects : others, scored on the residual of `final`
    beside : the causes that stay
    """
    about = _Linear.without_causes(null, causes, final)
    testable = [s for s in suspects if is_testable(s) and s.signature_columns.any()]
    by_candidate = {id(s.candidate): s for s in testable}
    predicted = about.pairs([s.candidate for s in testable], [s.derivatives for s in testable])
    different = [[by_candidate[id(c)] for c in pair] for pair in _inequivalent(predicted[: CRITERIA.max_pairs])]
    best: tuple[list[Cause], Fit] | None = None

    def fitted(pair: Sequence[Scored], own: Fitter) -> Fit:
        return _fitted_pair(own, null, about, pair, beside, np.inf if best is None else best[1].chi2)

    with closing(fitter.in_turn([partial(fitted, pair) for pair in different])) as fits:
        for number, pair in enumerate(different):
            fitter.foresee(PAIR, len(different) - number)
            with fitter.measuring(PAIR):
                fit = next(fits)
            refitted = [suspect.refitted(fit, null.chi2 - fit.chi2) for suspect in pair] if fit.names else []
            pairs: list[Cause] = [(cause, (cause,)) for cause in refitted]
            if pairs and (best is None or aic(pairs, fit) < aic(*best)):
                best = pairs, fit
    return None if best is None else (best[0], fitter.with_derivatives(best[1]))


def _inequivalent(
    predicted: Sequence[tuple[float, tuple[Candidate, Candidate]]],
) -> list[tuple[Candidate, Candidate]]:
    """Pairs of which no two have a common member and the same predicted reduction of chi-square: the first of these."""
    different: list[tuple[float, tuple[Candidate, Candidate]]] = []
    for reduction, pair in predicted:
        if not any(
            abs(reduction - other) < MAX_REDUCTION_DIFFERENCE * other and set(pair) & set(both)
            for other, both in different
        ):
            different.append((reduction, pair))
    return [pair for _, pair in different]


def _fitted_pair(
    fitter: Fitter, null: Fit, about: "_Linear", pair: Sequence[Scored], beside: Sequence[Candidate], rival: float
) -> Fit:
    """Fit two suspects from their predicted sizes, or else from where they are absent beside the model without them."""
    added, names = [suspect.candidate for suspect in pair], [name for kept in beside for name in kept.absent()]
    values, sizes = about.start(pair)
    kept_sizes = {name: values[name] for name in names}
    start = replace(about.final.point, values=values)
    fit = fitter.fit(start, [*beside, *added], {**kept_sizes, **sizes}, rival=rival)
    if fit.names:
        return fit
    absent = {name: size for candidate in added for name, size in candidate.absent().items()}
    kept_sizes = {name: null.value(name) for name in names}
    return fitter.fit(null.point, [*beside, *added], {**kept_sizes, **absent}, rival=rival)


def is_pair_significant(
    null: Fit, causes: Sequence[Cause], final: Fit, candidates: Sequence[Candidate], known: KnownDerivatives
) -> bool:
    """Whether two other candidates are predicted to explain more than the causes do, by derivatives that are known.

    By more than the best of that number of pairs would by chance, at the confidence level (Bonferroni). A test of two
    candidates may be significant on the residual of a cause that stands for both, though its sum of squares is not.
    """
    about = _Linear.without_causes(null, causes, final)
    taken = {cause.name for cause, _ in causes}
    others = [c for c in candidates if c.name not in taken and id(c) in known and known[id(c)].columns.any()]
    predicted = about.pairs(others, [known[id(c)].columns for c in others])
    if not predicted:
        return False
    reduction, pair = predicted[0]
    free = sum(len(candidate.free) for candidate in pair)
    chance = scipy.stats.chi2.isf((1.0 - CRITERIA.confidence_level) / len(predicted), free)
    return final.chi2 - (about.chi2 - reduction) > chance


@dataclass(frozen=True, eq=False)
class _Linear:
    """The calibrated model, linearised about one with causes.

    Attributes
    ----------
    final : the model with causes
    names : of the calibrated parameters
    columns : (N, k) derivatives by them
    projection : removes what they and the nuisances absorb
    residual : (N,) that the model would leave without its causes
    rest : values of all but the causes' parameters
    """

    final: Fit
    names: tuple[str, ...]
    columns: np.ndarray
    projection: Projection
    residual: np.ndarray
    rest: Mapping[str, float]

    @classmethod
    def without_causes(cls, null: Fit, causes: Sequence[Cause], final: Fit) -> "_Linear":
        """Remove the causes from a model, to first order; one that is absent at infinity stays in its prediction."""
        absent = {name: value for cause, _ in causes for name, value in cause.candidate.absent().items()}
        sizes = np.array([final.value(name) for name in final.names])
        moves = sizes - np.array([absent.get(name, size) for name, size in zip(final.names, sizes, strict=True)])
        moves[~np.isfinite(moves)] = 0.0
        own = np.isin(final.names, null.names)
        return cls(
            final=final,
            names=null.names,
            columns=final.columns[:, own],
            projection=Projection(np.column_stack([final.columns[:, own], final.nuisances])),
            residual=final.residual + final.columns @ moves,
            rest={name: value for name, value in final.point.values.items() if name not in absent},
        )

    @cached_property
    def _remaining(self) -> np.ndarray:
        """Residual (N,) without what calibration absorbs."""
        return self.projection(self.residual)

    @cached_property
    def chi2(self) -> float:
        """Chi-square that the model would leave without its causes."""
        return float(self._remaining @ self._remaining)

    def pairs(
        self, candidates: Sequence[Candidate], derivatives: Sequence[np.ndarray]
    ) -> list[tuple[float, tuple[Candidate, Candidate]]]:
        """Reductions of chi-square by pairs of candidates (N, p) of other effects, the least criterion of Akaike first.

        Without those of an inadmissible sign, and those that do not lower it.
        """
        signatures = [self.projection(columns) for columns in derivatives]
        pairs = []
        for (one, first), (other, second) in combinations(zip(candidates, signatures, strict=True), 2):
            if one.name == other.name:
                continue
            reduction = self._reduction((one, other), (first, second))
            criterion = 2.0 * (first.shape[1] + second.shape[1]) - reduction
            if criterion < 0.0:
                pairs.append((criterion, reduction, (one, other)))
        pairs.sort(key=lambda pair: pair[0])
        return [(reduction, pair) for _, reduction, pair in pairs]

    def _reduction(self, pair: Sequence[Candidate], signatures: Sequence[np.ndarray]) -> float:
        """Reduction of chi-square by candidates of these signatures (N, p); minus infinity for an inadmissible sign.

        signatures : derivatives without what calibration absorbs
        """
        columns = np.column_stack(signatures)
        columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        score = columns.T @ self._remaining
        theta = np.linalg.lstsq(columns.T @ columns, score, rcond=REPLACEMENT_RANK_TOLERANCE)[0]
        parts = np.split(theta, np.cumsum([own.shape[1] for own in signatures])[:-1])
        admissible = all((c.sign * part >= 0.0).all() for c, part in zip(pair, parts, strict=True))
        return float(score @ theta) if admissible else -np.inf

    def start(self, pair: Sequence[Scored]) -> tuple[dict[str, float], dict[str, float]]:
        """Predicted values of the calibrated model, and sizes of suspects beside it, by name.

        No size is beyond the natural scale of its effect.
        """
        columns = self.final.free(np.column_stack([self.columns, *(s.derivatives for s in pair)]))
        length = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        moves = np.linalg.lstsq(columns / length, self.residual, rcond=REPLACEMENT_RANK_TOLERANCE)[0] / length
        values, moved = dict(self.rest), iter(moves)
        sizes: dict[str, float] = {}
        for name in self.names:
            values[name] += next(moved)
        for candidate in (suspect.candidate for suspect in pair):
            size = candidate.null + np.array([next(moved) for _ in candidate.free])
            sizes |= candidate.values(candidate.within_scale(size))
        return values, sizes
