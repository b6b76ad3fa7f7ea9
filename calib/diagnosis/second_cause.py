"""A second cause that records held out reveal, and that those of the fit do not show."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.elimination import Elimination
from calib.diagnosis.fit import Fit
from calib.diagnosis.gain import Gain
from calib.diagnosis.joint_misfit import JointMisfit
from calib.diagnosis.refit import Fitter
from calib.diagnosis.score import deviate
from calib.diagnosis.selection import Selection
from calib.diagnosis.stepwise import as_selection, state_of
from calib.diagnosis.suspect import Refitted, leading_variants

MAX_JOINT_STEPS = 4  # towards the values that all records have  [count]

Outcome = tuple[Selection, Gain]


def with_second_cause(
    fitter: Fitter, selection: Selection, gain: Gain, tested: Callable[[Selection], Outcome]
) -> Outcome | None:
    """Put two causes in the place of one whose size differs among records; None where no two leave noise alone.

    Over the motions of one record two effects may change as one of another size does, so that its fit needs none
    beside that one; other motions tell them apart. Pairs of that cause, or else of one of its rivals, and a suspect
    that explains about as much are compared by the chi-square of all records, those held out included. The pair of the
    least is taken, if it has one size in all records, leaves noise alone in them, and neither of the two does as much
    alone. Those whose criterion of Akaike ties with it in the place of one of the two are its rivals.

    Parameters
    ----------
    selection, gain : the only cause, and its gain on records held out
    tested : compares the sizes of the causes of a selection from record to record, and returns it with their gain
    """
    if gain.joint is None or not gain.joint.is_significant or selection.remainder_is_significant:
        return None
    partners, pairs = _of_the_class(fitter, selection, tested)
    if not pairs:
        return None
    second = min(pairs, key=_criterion).members[1]
    others = [(other, second) for other in partners if other.name != second.name]
    pairs += _those_that_stand(fitter, selection, others, tested)
    least = min(_criterion(pair) for pair in pairs)
    ties = [pair for pair in pairs if _criterion(pair) <= least + CRITERIA.aic_tie]
    best = min(ties, key=lambda pair: (pair.aic_penalty, _criterion(pair)))
    alone = [tested(_selected(fitter, selection, member.fit, [member]))[1].joint for member in best.members]
    if not all(_does_less(single, best.joint, selection.rounds[0].threshold) for single in alone):
        return None
    alternatives = []
    for place in range(2):
        fixed = best.members[1 - place]
        exchanged = [pair for pair in ties if pair.members[1 - place] is fixed and pair is not best]
        alternatives.append(tuple(pair.selection.causes[place] for pair in (best, *exchanged)))
    return replace(best.selection, alternatives=tuple(alternatives)), best.gain


@dataclass(frozen=True, eq=False)
class _Pair:
    """Two causes that stand in all records.

    Attributes
    ----------
    members : as they explain alone
    selection, gain : of both in one model
    joint : misfit of that refitted to all records
    """

    members: tuple[Refitted, Refitted]
    selection: Selection
    gain: Gain
    joint: JointMisfit

    @property
    def aic_penalty(self) -> float:
        """Penalty of the parameters of both in AIC."""
        return sum(cause.aic_penalty for cause in self.members)


def _of_the_class(
    fitter: Fitter, selection: Selection, tested: Callable[[Selection], Outcome]
) -> tuple[list[Refitted], list[_Pair]]:
    """Partners of the first of the cause and its rivals with which any pair stands, and these pairs.

    Last digits decide which of those that cannot be told apart is the cause; whether a pair with it has one size in all
    channels may differ from one to the other.
    """
    [cause], [rivals] = selection.causes, selection.alternatives
    for first in (cause, *(rival for rival in rivals if rival.name != cause.name)):
        partners = _partners(selection, first, rivals)
        pairs = _those_that_stand(fitter, selection, [(first, partner) for partner in partners], tested)
        if pairs:
            return partners, pairs
    return [], []


def _refitted_towards_all(
    fitter: Fitter,
    selection: Selection,
    fit: Fit,
    pair: tuple[Refitted, Refitted],
    tested: Callable[[Selection], Outcome],
) -> Outcome:
    """Test a pair; of models that fit the records of the fit about as well, take the one nearest to all records."""
    now = tested(_selected(fitter, selection, fitter.with_derivatives(fit), pair))
    for _ in range(MAX_JOINT_STEPS):
        both, gain = now
        if gain.joint is None or gain.joint.is_significant:
            break
        further = _fitted_from(fitter, both.final, gain.joint.values)
        if not further.names or further.chi2 > fit.chi2 + CRITERIA.aic_tie:
            break
        ahead = tested(_selected(fitter, selection, fitter.with_derivatives(further), pair))
        improved = _joint_excess(now) - _joint_excess(ahead)
        now = ahead if improved > 0.0 else now
        if not improved > CRITERIA.min_change_chi2:
            break
    return now


def _joint_excess(outcome: Outcome) -> float:
    """Excess chi-square of a model refitted to all records; infinite where it is unknown."""
    _, gain = outcome
    return np.inf if gain.joint is None else gain.joint.excess_chi2


def _partners(selection: Selection, cause: Refitted, rivals: Sequence[Refitted]) -> list[Refitted]:
    """Rivals of the cause, and suspects that explain about as much beside the calibrated model, the best first.

    The search beside that model may have chosen none: a cause is also what is left of a pair that was tried then.
    """
    search = selection.rounds[0]
    taken = {rival.name for rival in rivals}
    least = CRITERIA.min_explained_share * cause.chi2_reduction
    suspects = [s for s in search.suspects if isinstance(s, Refitted) and s.fit.names and s.name not in taken]
    enough = [s for s in leading_variants(suspects) if s.chi2_reduction >= least and not s.candidate.effect.noise]
    others = sorted(enough, key=lambda s: -s.chi2_reduction)[: CRITERIA.max_pairs]
    return [*(rival for rival in rivals if rival.name != cause.name), *others]


def _those_that_stand(
    fitter: Fitter,
    selection: Selection,
    pairs: Sequence[tuple[Refitted, Refitted]],
    tested: Callable[[Selection], Outcome],
) -> list[_Pair]:
    """Pairs that leave noise alone in all records, with one size of each."""
    standing = []
    for pair in pairs:
        fit = _fitted_between(fitter, selection.null, *pair)
        if not fit.names:
            continue
        both, gain = _refitted_towards_all(fitter, selection, fit, pair, tested)
        one_size = both.is_sufficient and not both.differing_by_record
        if one_size and not gain.refutes and gain.joint is not None and not gain.joint.is_significant:
            standing.append(_Pair(pair, both, gain, gain.joint))
    return standing


def _fitted_between(fitter: Fitter, null: Fit, one: Refitted, other: Refitted) -> Fit:
    """Fit two suspects, beginning midway between the models with one of them each."""
    values = {name: 0.5 * (one.fit.value(name) + other.fit.value(name)) for name in null.names}
    sizes: dict[str, float] = {}
    for suspect in (one, other):
        absent, size = suspect.candidate.null, suspect.size
        # where it is absent at infinity, as a stiffness, its reciprocal is halved
        halved = np.where(np.isfinite(absent), 0.5 * (absent + size), 2.0 * size)
        sizes |= suspect.candidate.values(halved)
    point = replace(null.point, values={**null.point.values, **values})
    return fitter.fit(point, (one.candidate, other.candidate), sizes)


def _fitted_from(fitter: Fitter, fit: Fit, values: Mapping[str, float]) -> Fit:
    """Fit the model of another fit again, from these values: of many that fit about as well, those of all records."""
    candidates = fit.candidates
    sizes = {name: fit.value(name) for candidate in candidates for name in candidate.absent()}
    moved = {name: value for name, value in values.items() if name not in sizes}
    sizes |= {name: value for name, value in values.items() if name in sizes}
    return fitter.fit(replace(fit.point, values={**fit.point.values, **moved}), candidates, sizes)


def _selected(fitter: Fitter, selection: Selection, fit: Fit, suspects: Sequence[Refitted]) -> Selection:
    """Return the selection with these causes instead, of a model that was fitted with them.

    They are not eliminated for explaining little in the records of the fit.
    """
    reduction = selection.null.chi2 - fit.chi2
    causes = [suspect.refitted(fit, reduction) for suspect in suspects]
    reason = "with both, all records have the same sizes and leave noise alone"
    state = state_of(selection).with_causes([(cause, (cause,)) for cause in causes], fit, reason)
    kept = Elimination(state.causes, fit, is_explained=True)
    return as_selection(fitter, replace(state, elimination=kept, attained=min(selection.attained, fit.chi2)))


def _criterion(pair: _Pair) -> float:
    """Akaike's criterion of a pair in all records, less a constant."""
    return pair.joint.excess_chi2 + pair.aic_penalty


def _does_less(single: JointMisfit | None, both: JointMisfit, threshold: float) -> bool:
    """Whether all records are fitted significantly worse with one cause than with both."""
    return single is not None and bool(deviate(single.excess_chi2 - both.excess_chi2, 1) > threshold)
