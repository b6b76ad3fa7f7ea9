"""The formula of a force that was found: formulas by sparse selection, refitted inside the simulator and judged.

What counts is the chi-square of the refit. A term that was the best of p by chance reduces it by about 2 ln p, so that
this is what a term costs, in the place of the 2 of AIC, which a number of its shape costs (risk inflation criterion:
Foster & George, The Annals of Statistics 22 (1994) 1947). Of formulas within a tie of the best, the one with the fewest
numbers is first. It is the formula of the force where it predicts left-out records as well as the free force does.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.diagnosis.candidate import Candidate
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.discovery.formula import Formula
from calib.diagnosis.discovery.left_out import LeftOutMisfit, left_out_misfit
from calib.diagnosis.discovery.penalised import PenalisedFit
from calib.diagnosis.discovery.sparse import LinearisedForce, Selected, selected_formulas
from calib.diagnosis.excess import chi2_std, excess_chi2, significant
from calib.diagnosis.fit import Fit
from calib.diagnosis.refit import Fitter

PREFIX = "found"  # of the names of a formula's parameters, with a number where the model has such ones
MAX_LEADING = 6  # formulas of the lowest predicted AIC that are refitted  [count]
SHORT_LENGTHS, MAX_OF_A_LENGTH = (1, 2, 3), 3  # numbers of formulas of which the best are refitted  [count]
MAX_EXCESS_LENGTH = 3  # numbers beyond those of a formula that attains as little as the free force  [count]
MAX_SIMPLIFIED = 2  # rounds in which the best formula is made simpler  [count]
MAX_PREDICTED_RATIO = 4.0  # of predicted chi-square above the free force's, over what a refit has to attain  [1]


@dataclass(frozen=True, eq=False)
class FormulaTrial:
    """A formula, refitted inside the simulator.

    Attributes
    ----------
    formula : with its values
    candidate : of which the effect is that of the fit
    prefix : of the names of its parameters
    fit : the model with it
    left_out : misfit of the records that were left out in turn; None where none can be
    ric : risk inflation criterion, but for a constant  [1]
    ties : whether it is within a tie of the best by that
    on_front : whether no formula of fewer numbers, or of as many, has a lower chi-square
    predicts : whether it fits all records and predicts left-out ones as well as the free force
    explains : whether the misfit that it leaves is none beside the noise
    """

    formula: Formula
    candidate: Candidate
    prefix: str
    fit: Fit
    left_out: LeftOutMisfit | None
    ric: float = np.inf
    ties: bool = False
    on_front: bool = False
    predicts: bool = False
    explains: bool = False

    def errors(self) -> dict[str, float]:
        """Standard error of each number, by its name in the formula."""
        numbers = [n.name for n in self.formula.numbers]
        return dict(zip(numbers, map(float, self.fit.error([f"{self.prefix}_{n}" for n in numbers])), strict=True))


def formulas_of(
    fitter: Fitter,
    null: Fit,
    fitted: PenalisedFit,
    left_out: LeftOutMisfit | None,
    on_stage: Callable[[str], None] = lambda text: None,
) -> tuple[FormulaTrial, ...]:
    """Formulas of a free force that was found, the best first.

    Parameters
    ----------
    null : the model without it
    fitted, left_out : the free force, and its misfit of left-out records
    on_stage : called with the stage that begins
    """
    on_stage("formulas")
    problem = LinearisedForce(fitted)
    margin = CRITERIA.aic_tie * fitted.dispersion
    chosen = _refitted(selected_formulas(problem), fitted.dispersion, fitted.fit.chi2 + MAX_PREDICTED_RATIO * margin)
    fitter.effort.foresee(expected_of_formulas(fitter, len(chosen)))
    trials: list[FormulaTrial] = []
    for round_number in range(1 + MAX_SIMPLIFIED):
        if round_number:
            chosen = _simpler(problem, _judged(fitter, trials, fitted, left_out, problem.price)[:1], trials)
        for number, selected in enumerate(chosen, 1):
            shortest = min((t.formula.length for t in trials if t.fit.chi2 <= fitted.fit.chi2 + margin), default=None)
            length = selected.formula.length
            too_long = shortest is not None and length > shortest + MAX_EXCESS_LENGTH
            if too_long or not fitter.effort.suffices():
                break
            on_stage(f"{'simpler ' if round_number else ''}formula {number} of {len(chosen)}")
            best = min([fitted.fit.chi2, *(t.fit.chi2 for t in trials)])
            # a longer one than one that attains as little has to be better, else its fit may end early
            rival = best + (margin if shortest is None or length <= shortest else -margin)
            trial = _trial(fitter, null, problem, selected, rival, shortest is None)
            if trial is not None:
                trials.append(trial)
    return _judged(fitter, trials, fitted, left_out, problem.price)


def expected_of_formulas(fitter: Fitter, count: int) -> float:
    """Expected number of simulations for refits of so many formulas."""
    return count * fitter.expected_simulations(SHORT_LENGTHS[-1], 1)


def _simpler(problem: LinearisedForce, best: Sequence[FormulaTrial], known: Sequence[FormulaTrial]) -> list[Selected]:
    """The best formula without one of its terms, and with the nearest whole exponent in the place of a free one."""
    structures = {t.formula.structure for t in known}
    candidates = []
    for formula in (trial.formula for trial in best):
        terms = formula.terms
        candidates += [Formula((*terms[:k], *terms[k + 1 :])) for k in range(len(terms)) if len(terms) > 1]
        for k, term in enumerate(terms):
            whole = term.with_whole_exponents()
            if whole != term:
                candidates.append(Formula((*terms[:k], whole, *terms[k + 1 :])))
    return [problem.fitted(formula.terms) for formula in candidates if formula.structure not in structures]


def _refitted(selected: Sequence[Selected], dispersion: float, attainable: float) -> list[Selected]:
    """Formulas that are worth a refit, the shortest first: the best of the short lengths, and of the lowest AIC.

    attainable : predicted chi-square above which only the best of a short length is
    """
    ordered = sorted(selected, key=lambda s: s.aic(dispersion))
    of_length = [[s for s in ordered if s.formula.length == n][:MAX_OF_A_LENGTH] for n in SHORT_LENGTHS]
    groups = ordered[:MAX_LEADING], *of_length
    taken = [s for own in groups for k, s in enumerate(own) if k == 0 or s.chi2 < attainable]
    unique = {id(s): s for s in taken}
    return sorted(unique.values(), key=lambda s: (s.formula.length, s.aic(dispersion)))


def _trial(
    fitter: Fitter, null: Fit, problem: LinearisedForce, selected: Selected, rival: float, from_null: bool
) -> FormulaTrial | None:
    """Refit a formula, from what the linearised problem has.

    rival : chi-square that it has to attain
    from_null : whether a short one that does not attain it, though that is predicted, is refitted from the calibrated
        model too
    """
    formula = selected.formula
    prefix = prefix_of([*fitter.model.parameters, *fitter.space.names])
    effect = problem.model.forces[0].effect
    candidate = formula.candidate(prefix, effect.bodies or (), effect.place)
    sizes = {f"{prefix}_{n.name}": n.value for n in formula.numbers}
    starts = [{**problem.calibrated(formula), **sizes}, candidate.absent()]
    fits: list[Fit] = []
    twice = from_null and formula.length <= SHORT_LENGTHS[-1] and selected.chi2 < rival
    for start in starts if twice else starts[:1]:
        fit = fitter.fit(null.point, (*null.candidates, candidate), start, rival=rival)
        fits += [fit] if fit.names else []
        if fit.names and fit.chi2 < rival:
            break
    if not fits:
        return None
    fit = min(fits, key=lambda f: f.chi2)
    values = {n.name: fit.value(f"{prefix}_{n.name}") for n in formula.numbers}
    return FormulaTrial(formula.at(values), candidate, prefix, fit, left_out_misfit(fitter.evidence, fit))


def prefix_of(known: Sequence[str]) -> str:
    """Beginning of names that none of the known parameters has."""
    number = 1
    while any(name.startswith(f"{PREFIX}{number if number > 1 else ''}_") for name in known):
        number += 1
    return f"{PREFIX}{number if number > 1 else ''}"


def _judged(
    fitter: Fitter, trials: Sequence[FormulaTrial], fitted: PenalisedFit, left_out: LeftOutMisfit | None, price: float
) -> tuple[FormulaTrial, ...]:
    """Formulas with their judgement, the best first.

    price : of a term, see `LinearisedForce`
    """
    if not trials:
        return ()
    freedom = fitted.fit.residual.size
    dispersion = max(1.0, min(fitted.fit.chi2, *(t.fit.chi2 for t in trials)) / freedom)
    std, judged = chi2_std(fitter.evidence), []
    free_aic = fitted.fit.chi2 / dispersion + 2.0 * fitted.effective_parameters
    for trial in trials:
        aic = trial.fit.chi2 / dispersion + 2.0 * trial.formula.length
        shorter = [t.fit.chi2 for t in trials if t.formula.length <= trial.formula.length]
        worse = left_out is None or trial.left_out is None or left_out.is_better(trial.left_out)
        judged.append(
            replace(
                trial,
                ric=aic + (price - 2.0) * len(trial.formula.terms),
                on_front=trial.fit.chi2 <= min(shorter),
                predicts=not worse and aic <= free_aic + CRITERIA.aic_tie,
                explains=not significant(excess_chi2(fitter.evidence, trial.fit), std),
            )
        )
    least = min(t.ric for t in judged)
    tied = [replace(t, ties=t.ric - least <= CRITERIA.aic_tie) for t in judged]
    return tuple(sorted(tied, key=lambda t: (not t.ties, t.formula.length if t.ties else 0, t.ric)))
