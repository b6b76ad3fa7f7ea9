"""Stepwise selection of causes: forward, each beside the others, and in pairs."""

from collections.abc import Callable, Sequence
from functools import partial

from calib.diagnosis.candidate import Candidate
from calib.diagnosis.compromise import may_be_compromise, with_best_pair, with_pair_beside
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.excess import chi2_std, dominant, excess_chi2
from calib.diagnosis.fit import Fit
from calib.diagnosis.foresight import foresee_conclusion, foresee_pairs
from calib.diagnosis.forward import forward
from calib.diagnosis.refit import Fitter
from calib.diagnosis.replacement import replaced
from calib.diagnosis.selection import Selection
from calib.diagnosis.stepwise import StepwiseState, as_selection, through_elimination


def select(
    fitter: Fitter,
    null: Fit,
    candidates: Sequence[Candidate],
    seed: int,
    on_stage: Callable[[str], None] = lambda text: None,
) -> Selection:
    """Select causes one after the other, at most three; then search for each earlier one again beside the others.

    Causes that explain little beside the remainder are eliminated, and those of several sizes: such a one may stand for
    two, and the best pair is tried in its place. Where the causes leave more than noise, one of them may be a
    compromise between two: then the best pair is tried in their place.

    Raises
    ------
    BudgetSpent : before all candidates are scored beside the calibrated model
    """
    null = fitter.attempt(partial(_recalibrated, fitter, null)) or null
    state = forward(fitter, null, candidates, seed, on_stage)
    state = _searched_again(fitter, state, candidates, seed)
    stand_ins = sorted(state.stand_ins - {*state.names})
    if stand_ins and fitter.effort.suffices():
        on_stage("pairs")
        foresee_pairs(fitter, candidates)
        state = fitter.attempt(partial(with_pair_beside, fitter, state, stand_ins, candidates, seed)) or state
    if may_be_compromise(fitter, state, candidates) and fitter.effort.suffices():
        on_stage("pairs")
        foresee_pairs(fitter, candidates if state.causes else [])
        state = fitter.attempt(partial(with_best_pair, fitter, state, candidates, seed)) or state
    foresee_conclusion(fitter)
    return as_selection(fitter, through_elimination(fitter, state))


def _recalibrated(fitter: Fitter, null: Fit) -> Fit:
    """Fit the calibrated model from the middle of its windows too, where a value is at an edge; take the better fit.

    Not where the misfit does not dominate the noise.
    """
    evidence = fitter.evidence
    if not fitter.is_at_an_edge(null) or not dominant(excess_chi2(evidence, null), chi2_std(evidence)):
        return null
    middle = fitter.in_the_middle(null)
    again = None if middle is None else fitter.fit(middle.point, columns=middle.columns, rival=null.chi2)
    if again is None or not again.names or not null.chi2 - again.chi2 > CRITERIA.aic_tie:
        return null
    return fitter.with_derivatives(again)


def _searched_again(fitter: Fitter, state: StepwiseState, candidates: Sequence[Candidate], seed: int) -> StepwiseState:
    """Search for each cause again beside the others, after those that explain little are eliminated.

    The last one was selected beside the others, with its rivals, unless one of these was eliminated.
    """
    for repetition in range(CRITERIA.max_causes):
        before, state = state.names, through_elimination(fitter, state)
        last_too = state.names != before[: len(state.names)]
        if not (last_too or (len(state.causes) > 1 and not repetition)):
            break
        again = fitter.attempt(
            partial(replaced, fitter, state.null, state.causes, state.final, candidates, seed, state.known, last_too)
        )
        if again is None:
            break
        state = state.with_causes(*again, "each was searched for again beside the others")
    return through_elimination(fitter, state)
