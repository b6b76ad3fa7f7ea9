"""Stepwise selection of causes: forward, each beside the others, and in pairs."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from calib.diagnosis.candidate import Candidate
from calib.diagnosis.constancy import CHANNELS, RECORDS, Constancy, constancies, differing
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.elimination import Elimination, LeftOut, eliminated
from calib.diagnosis.evidence import Evidence, clocks_differ
from calib.diagnosis.excess import (
    bias_std,
    chi2_std,
    degrees_of_freedom,
    dominant,
    excess_chi2,
    significant,
)
from calib.diagnosis.gain import Agreement
from calib.diagnosis.noise import ORDER
from calib.diagnosis.refit import Fit, Fitter
from calib.diagnosis.rejection import extension, is_negligible, rejection
from calib.diagnosis.remainder import remainder
from calib.diagnosis.replacement import aic, best_pair, pair_shows, replaced, without_cause
from calib.diagnosis.screening import Derivatives, KnownDerivatives, screened
from calib.diagnosis.search import Round, chi2_of_a_rival, rival_suspects, search, simplest, with_those_behind
from calib.diagnosis.suspect import Cause, Refitted, leading_variants


@dataclass(frozen=True)
class Exchange:
    """Causes that were put in the place of others.

    Attributes
    ----------
    before, after : names of all causes
    reason : why, as the end of a sentence
    """

    before: tuple[str, ...]
    after: tuple[str, ...]
    reason: str


@dataclass(frozen=True, eq=False)
class Selection:
    """The result of a stepwise selection.

    Attributes
    ----------
    rounds : searches one after the other; the last has no chosen one unless there were enough, or the budget was spent
    null, final : the calibrated model, and the one with the causes
    causes : that are in the final model
    alternatives : of each cause, suspects indistinguishable from it beside the others, itself included
    is_explained : whether nothing but noise is left, or each cause explains several times what is left
    excess_chi2, remaining_chi2 : excess chi-square of the calibrated and of the final model
    chi2_std : standard deviation of the chi-square of noise alone
    constancy : how much the size of each cause differs among the channels of the records, and from record to record
    record_spread : parameter of a cause on which the records do not agree -> standard deviation of the mean of their
        sizes, relative to that  [1]
    fitted_records_agree : whether the records of the fit agree on the sizes of the causes; if not, something remains,
        though no sum of squares may show it
    exchanges : of causes for others after the rounds, in order
    left_out : that explain part of what the causes leave, and too little to be causes
    elimination_margin : excess chi-square by which it is decided that the causes explain enough, and these do not
    attained : least chi-square of a model that was considered
    cut_short : whether the budget was spent before all that might change the answer was tried
    """

    rounds: tuple[Round, ...]
    null: Fit
    final: Fit
    causes: tuple[Refitted, ...]
    alternatives: tuple[tuple[Refitted, ...], ...]
    is_explained: bool
    excess_chi2: float
    remaining_chi2: float
    chi2_std: float
    constancy: tuple[Constancy, ...] = ()
    record_spread: Mapping[str, float] = field(default_factory=dict)
    fitted_records_agree: bool = True
    exchanges: tuple[Exchange, ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    elimination_margin: float = np.inf
    attained: float = np.inf
    cut_short: bool = False

    def without_causes(self) -> "Selection":
        """Return the same search with the calibrated model as its answer."""
        return replace(
            self,
            final=self.null,
            causes=(),
            alternatives=(),
            is_explained=not self.is_significant,
            remaining_chi2=self.excess_chi2,
            constancy=(),
            record_spread={},
            fitted_records_agree=True,
            left_out=(),
            elimination_margin=np.inf,
        )

    @property
    def explained_share(self) -> float:
        """Share of the excess chi-square that the causes explain; 1 where there is no misfit  [1]."""
        return (self.excess_chi2 - self.remaining_chi2) / self.excess_chi2 if self.is_significant else 1.0

    @property
    def is_significant(self) -> bool:
        """Whether the calibrated model has a misfit at all."""
        return significant(self.excess_chi2, self.chi2_std)

    @property
    def remainder_is_significant(self) -> bool:
        """Whether the causes leave more than noise."""
        return significant(self.remaining_chi2, self.chi2_std)

    @property
    def heterogeneous(self) -> tuple[Constancy, ...]:
        """Causes whose sizes differ among the records or their channels: each acts like an effect, and is none."""
        several = len(self.causes) > 1 and not self.remainder_is_significant
        remains = self.remainder_is_significant or not self.fitted_records_agree
        return differing(self.constancy, self.rounds[0].threshold, explained_by_several=several, remains=remains)

    @property
    def differing_by_record(self) -> tuple[Constancy, ...]:
        """Causes whose sizes differ from record to record for sure, by however little."""
        return tuple(c for c in self.constancy if c.among == RECORDS and c.z > self.rounds[0].threshold)

    @property
    def is_homogeneous(self) -> bool:
        """Whether each cause has one size in all records and in all their channels."""
        return not self.heterogeneous

    @property
    def heterogeneity_z(self) -> float:
        """Largest normal deviate by which the size of a cause differs among the channels of the records."""
        return max((c.z for c in self.constancy if c.among == CHANNELS), default=0.0)

    def bias_std(self, fit: Fit, name: str) -> float:
        """Standard deviation of the bias that what is not modelled may make of a parameter of a fit  [its unit].

        By what remains, where that is more than noise, and by what makes the records differ on the parameter.
        """
        spread = self.record_spread.get(name, 0.0) * abs(fit.value(name))
        if not self.remainder_is_significant:
            return spread
        return math.hypot(spread, bias_std(self.remaining_chi2, fit.information(name)))

    def with_records_compared(self, agreements: Sequence[Agreement], fitted_agree: bool = True) -> "Selection":
        """Return the selection with the constancy of its causes from record to record: of what each alone has.

        fitted_agree : whether the records of the fit do
        """
        among_channels, found = {c.effect: c for c in self.constancy}, []
        for cause in self.causes:
            own = [a for a in agreements if a.parameter in cause.candidate.free]
            if own:
                most = max(own, key=lambda a: a.z)
                found.append(Constancy(cause.name, most.z, most.variation, among_channels[cause.name].chi2, RECORDS))
        spread = {a.parameter: a.variation / math.sqrt(len(a.records)) for a in agreements if not a.agree}
        return replace(
            self, constancy=(*self.constancy, *found), record_spread=spread, fitted_records_agree=fitted_agree
        )

    @property
    def is_sufficient(self) -> bool:
        """Whether the causes explain enough to be named, with one size each."""
        return self.is_explained and self.is_homogeneous

    @property
    def margin(self) -> float:
        """Reduction of chi-square that the answer rests on: an error that moves less of it does not change it.

        Of each cause what it explains more than the best that is distinguishable from it, and by how much more than is
        asked beside what remains; the excess where there is no cause; nothing where causes were replaced by others. Of
        causes that explain enough, but have several sizes, what shows that.
        """
        if self.is_explained and not self.is_homogeneous:
            return (max(c.z for c in self.heterogeneous) - self.rounds[0].threshold) ** 2
        by_name = {r.chosen.name: r.margin for r in self.rounds if r.chosen is not None}
        if not all(cause.name in by_name for cause in self.causes):
            return 0.0
        margins = [by_name[cause.name] for cause in self.causes]
        rests_on = margins if self.is_sufficient and margins else [self.remaining_chi2, *margins]
        return max(0.0, min(self.elimination_margin, *rests_on))

    def with_rivals(self, rivals: Sequence[Refitted]) -> "Selection":
        """Return the selection with these indistinguishable from the one of its causes that is among them."""
        names = {rival.name for rival in rivals}
        alternatives = [
            tuple(rivals) if cause.name in names else own
            for cause, own in zip(self.causes, self.alternatives, strict=True)
        ]
        return replace(self, alternatives=tuple(alternatives))

    @property
    def rivals(self) -> tuple[Refitted, ...]:
        """Suspects indistinguishable from a cause: from the last one that has such."""
        several = [rivals for rivals in self.alternatives if len(rivals) > 1]
        return several[-1] if several else self.alternatives[-1] if self.alternatives else ()

    @property
    def runners_up(self) -> tuple[Refitted, ...]:
        """Suspects that explained less in the search that chose the only cause, the best first."""
        names = {cause.name for cause in self.causes}
        found = next((r for r in self.rounds if r.chosen is not None and {r.chosen.name} == names), None)
        if found is None:
            return ()
        told = {rival.name for rival in self.rivals}
        suspects = [s for s in found.suspects if isinstance(s, Refitted) and s.fit.names and s.name not in told]
        return tuple(sorted(leading_variants(suspects), key=lambda s: -s.chi2_reduction))

    @property
    def classes(self) -> tuple[tuple[str, ...], ...]:
        """Names of causes that act together, of each indistinguishable model: one cause at a time exchanged."""
        names = tuple(cause.name for cause in self.causes)
        models = [
            (*names[:index], rival.name, *names[index + 1 :])
            for index, rivals in enumerate(self.alternatives)
            for rival in rivals
        ]
        return tuple(dict.fromkeys([names, *models])) if names else ()


@dataclass(frozen=True, eq=False)
class _Stepwise:
    """A stepwise selection so far.

    Attributes
    ----------
    null, final : the calibrated model, and the one with the causes
    known : derivatives of candidates
    rounds : searches one after the other
    causes : in the final model
    exchanges : of causes for others
    elimination : of these causes; None before they have been through it
    attained : least chi-square of a model that went through elimination: what its causes explained remains without them
    """

    null: Fit
    final: Fit
    known: KnownDerivatives
    rounds: tuple[Round, ...] = ()
    causes: tuple[Cause, ...] = ()
    exchanges: tuple[Exchange, ...] = ()
    elimination: Elimination | None = None
    attained: float = np.inf

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the causes."""
        return tuple(cause.name for cause, _ in self.causes)

    @property
    def is_explained(self) -> bool:
        """Whether the causes, which have been through elimination, explain enough."""
        return self.elimination is not None and self.elimination.is_explained

    def with_causes(self, causes: Sequence[Cause], final: Fit, reason: str) -> "_Stepwise":
        """Return it with these causes instead of its own, and why."""
        before, after = (tuple(cause.name for cause, _ in own) for own in (self.causes, causes))
        told = () if set(before) == set(after) else (Exchange(before, after, reason),)
        exchanges, elimination = (*self.exchanges, *told), None if told else self.elimination
        return replace(self, causes=tuple(causes), final=final, exchanges=exchanges, elimination=elimination)


def select(
    fitter: Fitter,
    null: Fit,
    candidates: Sequence[Candidate],
    seed: int,
    on_stage: Callable[[str], None] = lambda text: None,
) -> Selection:
    """Search for causes one after the other, at most three; then look for each earlier one again beside the others.

    Those go that explain little beside what remains. Where the causes leave more than noise, one of them may be a
    compromise between two: then the best pair is tried in their place.
    """
    state = _forward(fitter, _recalibrated(fitter, null), candidates, seed, on_stage)
    state = _looked_for_again(fitter, state, candidates, seed)
    if _may_be_compromise(fitter, state, candidates) and not fitter.effort.spent:
        on_stage("pairs")
        state = _with_best_pair(fitter, state, candidates, seed)
    return _selection(fitter, _through_elimination(fitter, state))


def _recalibrated(fitter: Fitter, null: Fit) -> Fit:
    """Fit the calibrated model from the middle of its windows too, where a value is at an edge; keep the better fit.

    Where no misfit that dominates the noise is left there is nothing to be gained.
    """
    evidence = fitter.evidence
    if not fitter.is_at_an_edge(null) or not dominant(excess_chi2(evidence, null), chi2_std(evidence)):
        return null
    middle = fitter.in_the_middle(null)
    again = None if middle is None else fitter.fit(middle.point, columns=middle.columns, rival=null.chi2)
    if again is None or not again.names or not null.chi2 - again.chi2 > CRITERIA.aic_tie:
        return null
    return fitter.with_derivatives(again)


def _looked_for_again(fitter: Fitter, state: _Stepwise, candidates: Sequence[Candidate], seed: int) -> _Stepwise:
    """Look for each cause again beside the others, once those are left out that explain little beside what remains.

    The last one was found beside the others and has its rivals from there, unless one of these was left out.
    """
    for again in range(CRITERIA.max_causes):
        found, state = state.names, _through_elimination(fitter, state)
        last_too = state.names != found[: len(state.names)]
        if fitter.effort.spent or not (last_too or (len(state.causes) > 1 and not again)):
            break
        causes, final = replaced(
            fitter, state.null, state.causes, state.final, candidates, seed, state.known, last_too=last_too
        )
        state = state.with_causes(causes, final, "each was looked for again beside the others")
    return _through_elimination(fitter, state)


def _through_elimination(fitter: Fitter, state: _Stepwise) -> _Stepwise:
    """Leave out causes that explain little beside what remains; if that is all, they stay as what comes closest."""
    if not state.causes or state.elimination is not None:
        return state
    attained = min(state.attained, state.final.chi2)
    left = eliminated(fitter, state.null, state.causes, state.final, state.rounds[0].threshold, attained)
    return replace(state, causes=left.causes, final=left.final, elimination=left, attained=attained)


def _with_best_pair(fitter: Fitter, state: _Stepwise, candidates: Sequence[Candidate], seed: int) -> _Stepwise:
    """Put the best pair in the place of the causes where it explains more, and each is a cause beside the other.

    The other candidates are scored anew, about the model so far: its noise may have been re-estimated.
    """
    null, known = state.null, None if state.causes else state.known
    others = [candidate for candidate in candidates if candidate.name not in state.names]
    suspects, threshold = screened(fitter, state.final, others, seed, known)
    pair = best_pair(fitter, null, state.causes, state.final, suspects)
    if pair is None or not _explains_more(fitter.evidence, null, state.causes, state.final, pair):
        return state
    was_explained, state = state.is_explained, _fitted_from(fitter, state, pair[1])
    if not _explains_more(fitter.evidence, null, state.causes, state.final, pair):
        return state
    causes, final = replaced(fitter, null, *pair, candidates, seed, {}, last_too=True)
    if not _explains_more(fitter.evidence, null, state.causes, state.final, (causes, final)):
        return state
    if was_explained:
        left = eliminated(fitter, null, causes, final, threshold, final.chi2)
        if left.left_out or not left.is_explained:
            return state
    rejected = _any_rejected(fitter, null, [cause for cause, _ in causes], final, threshold)
    reason = "of all pairs this one explains most, and more than what was chosen before"
    return state if rejected else state.with_causes(causes, final, reason)


def _fitted_from(fitter: Fitter, state: _Stepwise, other: Fit) -> _Stepwise:
    """Fit the causes again from the calibrated values of another model, and keep that fit where it explains more.

    Steps of Gauss and Newton end at the nearest minimum: what explains more may owe that to where it began.
    """
    if not state.causes:
        return state
    candidates = [cause.candidate for cause, _ in state.causes]
    values = {**state.final.point.values, **{name: other.value(name) for name in state.null.names}}
    sizes = {name: state.final.value(name) for candidate in candidates for name in candidate.free}
    fit = fitter.fit(replace(state.final.point, values=values), candidates, sizes, rival=state.final.chi2)
    lower = state.final.chi2 - fit.chi2
    if not fit.names or not lower > CRITERIA.aic_tie:
        return state
    fit, causes = fitter.with_derivatives(fit), []
    for cause, rivals in state.causes:
        again = cause.refitted(fit, cause.chi2_reduction + lower)
        causes.append((again, tuple(again if rival.name == cause.name else rival for rival in rivals)))
    return replace(state, causes=tuple(causes), final=fit, elimination=None)


def _any_rejected(fitter: Fitter, null: Fit, causes: Sequence[Refitted], final: Fit, threshold: float) -> bool:
    """Whether some cause of a model would be rejected as the last one to enter it."""
    for cause in causes:
        others = tuple(other.candidate for other in causes if other is not cause)
        base = without_cause(fitter, null, final, cause, others)
        if not base.names:  # no motion without it
            continue
        base = fitter.with_derivatives(base)
        again = cause.refitted(final, base.chi2 - final.chi2)
        made = extension(fitter.evidence, base, final, again, threshold)
        if rejection(fitter.evidence, null, made, further=bool(others)):
            return True
    return False


def _explains_more(
    evidence: Evidence, null: Fit, causes: Sequence[Cause], final: Fit, other: tuple[Sequence[Cause], Fit]
) -> bool:
    """Whether other causes explain more than those that they would replace; if they are more, no negligible part more.

    Of what those leave they explain several times what they leave themselves, unless that is noise, as a cause that is
    added has to.
    """
    reduction, remains = final.chi2 - other[1].chi2, excess_chi2(evidence, other[1])
    lower = aic(*other) < aic(causes, final) - CRITERIA.aic_tie
    noise = not significant(remains, chi2_std(evidence))
    enough = noise or reduction > CRITERIA.min_over_remainder * remains
    worth = len(other[0]) <= len(causes) or not is_negligible(evidence, null, final, reduction)
    return lower and enough and worth


def _may_be_compromise(fitter: Fitter, state: _Stepwise, candidates: Sequence[Candidate]) -> bool:
    """Whether causes leave more than noise; without a cause, whether no misfit that dominates it is left.

    A sum of squares sees less than a score test: beside a cause, a suspect beyond the threshold that was rejected shows
    it too, or a pair. It may have been rejected because that cause stands for both. Where nothing is a cause, it may
    explain half.
    """
    excess, std = excess_chi2(fitter.evidence, state.final), chi2_std(fitter.evidence)
    rejected = state.rounds[-1].rejected
    shown = rejected is not None and rejected.name not in state.names
    if state.causes:
        more = shown or significant(excess, std)
        return more or pair_shows(state.null, state.causes, state.final, candidates, state.known)
    return significant(excess, std) and not dominant(excess - (rejected.chi2_reduction if shown else 0.0), std)


def exchanged(fitter: Fitter, selection: Selection, cause: Refitted, rival: Refitted, reason: str) -> Selection | None:
    """Return a selection with a rival in the place of a cause, fitted beside the others, and no rival beside it.

    None where it cannot be fitted there, or would be rejected as a cause.

    Parameters
    ----------
    reason : why, as the end of a sentence
    """
    own, new = cause.candidate, rival.candidate
    others = [other.candidate for other in selection.causes if other is not cause]
    rest = {name: value for name, value in selection.final.point.values.items() if name not in own.absent()}
    sizes = {name: rest[name] for candidate in others for name in candidate.absent()}
    sizes |= {name: rival.fit.value(name) for name in new.absent()}
    fit = fitter.fit(replace(selection.final.point, values=rest), (*others, new), sizes)
    if not fit.names:
        return None
    final = fitter.with_derivatives(fit)
    put = rival.refitted(final, rival.chi2_reduction)
    pairs = list(zip(selection.causes, selection.alternatives, strict=True))
    causes = [(put, (put,)) if known is cause else (known, rivals) for known, rivals in pairs]
    threshold = selection.rounds[0].threshold
    if _any_rejected(fitter, selection.null, [known for known, _ in causes], final, threshold):
        return None
    state = _Stepwise(
        selection.null, selection.final, {}, selection.rounds, tuple(pairs), selection.exchanges,
        attained=selection.attained,
    )  # fmt: skip
    state = _through_elimination(fitter, state.with_causes(causes, final, reason))
    return _selection(fitter, state) if put.name in state.names else None


def paired(fitter: Fitter, selection: Selection, candidates: Sequence[Candidate], seed: int) -> Selection | None:
    """Return a selection with the best pair in the place of its causes, or with these as they fit where that was found.

    None where neither explains more.
    """
    causes = tuple(zip(selection.causes, selection.alternatives, strict=True))
    state = _Stepwise(
        selection.null, selection.final, {}, selection.rounds, causes, selection.exchanges, attained=selection.attained
    )
    found = _with_best_pair(fitter, state, candidates, seed)
    return None if found is state else _selection(fitter, _through_elimination(fitter, found))


def left_out(fitter: Fitter, selection: Selection, cause: Refitted, reason: str) -> Selection | None:
    """Return a selection without one of its causes; None where the others do not explain enough without it.

    Parameters
    ----------
    reason : why, as a clause
    """
    others = [pair for pair in zip(selection.causes, selection.alternatives, strict=True) if pair[0] is not cause]
    names = tuple(other.name for other, _ in others)
    candidates = tuple(other.candidate for other, _ in others)
    fit = without_cause(fitter, selection.null, selection.final, cause, candidates)
    if not fit.names:
        return None
    rise, attained = fit.chi2 - selection.final.chi2, min(selection.attained, selection.final.chi2)
    out = LeftOut(cause.name, rise / (rise + max(0.0, selection.remaining_chi2)), names, reason)
    state = _Stepwise(
        selection.null, fitter.with_derivatives(fit), {}, selection.rounds, tuple(others), selection.exchanges,
        attained=attained,
    )  # fmt: skip
    state = _through_elimination(fitter, state)
    if not state.is_explained:
        return None
    told = (*selection.left_out, out, *state.elimination.left_out)
    return _selection(fitter, replace(state, elimination=replace(state.elimination, left_out=told)))


def _selection(fitter: Fitter, state: _Stepwise) -> Selection:
    """Compare both models where the simulations of both are to be trusted."""
    null, final, causes, left = state.null, state.final, state.causes, state.elimination
    common = fitter.evidence.with_weights([null.point.simulated, final.point.simulated])
    excess, std = null.chi2_over(common) - degrees_of_freedom(common, null), chi2_std(common)
    told = {rival.name for _, rivals in causes for rival in rivals}
    return Selection(
        rounds=state.rounds,
        null=null,
        final=final,
        causes=tuple(cause.within(final) for cause, _ in causes),
        alternatives=tuple(rivals for _, rivals in causes),
        is_explained=state.is_explained if causes else not significant(excess, std),
        excess_chi2=excess,
        remaining_chi2=final.chi2_over(common) - degrees_of_freedom(common, final),
        chi2_std=std,
        constancy=constancies(fitter.evidence, final) if causes else (),
        exchanges=state.exchanges,
        left_out=tuple(one for one in left.left_out if one.effect not in told) if left else (),
        elimination_margin=left.margin if left else np.inf,
        attained=state.attained,
        cut_short=fitter.effort.spent,
    )


# --- forward selection ------------------------------------------------------------------------------------------------


def _forward(
    fitter: Fitter, null: Fit, candidates: Sequence[Candidate], seed: int, on_stage: Callable[[str], None]
) -> _Stepwise:
    """Choose causes one after the other, until one is rejected."""
    state = _Stepwise(null, null, {})
    for number in range(CRITERIA.max_causes):
        if number and fitter.effort.spent:
            break
        on_stage(f"suspects {number + 1}")
        outcome, extended = _round(fitter, state, candidates, seed + number)
        state = replace(state, rounds=(*state.rounds, outcome))
        if outcome.chosen is None:
            break
        cause = replace(outcome.chosen, fit=extended), outcome.rivals
        state = _reestimated(fitter, replace(state, final=extended, causes=(*state.causes, cause)))
    return state


def _round(fitter: Fitter, state: _Stepwise, candidates: Sequence[Candidate], seed: int) -> tuple[Round, Fit | None]:
    """Search for a further cause and judge it; beside it the model with it, None where nothing was chosen."""
    evidence, base = fitter.evidence, state.final
    rest = [c for c in candidates if c.name not in state.names]
    outcome = search(fitter, base, rest, seed, excess_chi2(evidence, base) / chi2_std(evidence), state.known)
    outcome = replace(outcome, excess_chi2_of_null=excess_chi2(evidence, state.null))
    if outcome.chosen is None:
        return outcome, None
    extended = fitter.with_derivatives(outcome.chosen.fit)
    made = extension(evidence, base, extended, outcome.chosen, outcome.threshold)
    outcome = replace(outcome, prediction=made.prediction)
    reason = rejection(evidence, state.null, made, further=bool(state.causes))
    return (outcome.without_cause(reason) if reason else outcome), extended


def _reestimated(fitter: Fitter, state: _Stepwise) -> _Stepwise:
    """Re-estimate the noise of what does not repeat by what no candidate explains beside the causes; refit the models.

    What follows is looked for in that noise, and the last cause is compared with its rivals in it again. Where what the
    causes leave is mostly error of the model it tells no noise, only how far it hides the uncertainty of clocks.
    """
    old, residual = fitter.evidence, state.final.residual
    evidence = old
    if not dominant(excess_chi2(old, state.final), chi2_std(old)):
        left = remainder(old, state.final, [derivatives.columns for derivatives in state.known.values()])
        evidence = old.with_reestimated_noise(left)
        residual = evidence.carried(residual[:, None], old)[:, 0]
    evidence = evidence.with_remainder(residual)
    if not _differs(evidence, old):
        return state
    fitter.evidence = evidence
    null = fitter.fit(state.null.point)
    earlier = [cause.candidate for cause, _ in state.causes[:-1]]
    base = fitter.fit(state.rounds[-1].base.point, earlier) if earlier else null
    refitted = _refitted_rivals(fitter, base, state) if null.names and base.names else []
    rivals = rival_suspects(fitter.evidence, refitted, state.rounds[-1].threshold)
    if not rivals:
        fitter.evidence = old
        return state
    for key, known in state.known.items():
        state.known[key] = Derivatives(evidence.carried(known.columns, old), known.relative_error)
    chosen = simplest(rivals)
    final = fitter.with_derivatives(chosen.fit)
    cause = replace(chosen, fit=final), with_those_behind(fitter.evidence, rivals, refitted)
    return replace(state, null=null, final=final, causes=(*state.causes[:-1], cause))


def _refitted_rivals(fitter: Fitter, base: Fit, state: _Stepwise) -> list[Refitted]:
    """The last cause and its rivals fitted in another noise, as far as they can be.

    And all suspects of the round that explain about as much, which that noise may tell from it in another way.

    base : the model without them, in that noise
    """
    cause, rivals = state.causes[-1]
    threshold = state.rounds[-1].threshold
    known, least = {rival.name for rival in rivals}, CRITERIA.min_explained_share * cause.chi2_reduction
    others = [s for s in state.rounds[-1].suspects if isinstance(s, Refitted) and s.fit.names and s.name not in known]
    refitted = []
    for rival in (*rivals, *leading_variants(s for s in others if s.chi2_reduction >= least)):
        bound = chi2_of_a_rival(refitted, base, threshold)
        fit = fitter.fit(rival.fit.point, rival.fit.candidates, rival=bound)
        if fit.names:
            refitted.append(rival.refitted(fit, base.chi2 - fit.chi2))
    return refitted


def _differs(one: Evidence, other: Evidence) -> bool:
    """Whether the same records have another noise: its level, its autocorrelation, or what clocks add to it."""
    pairs = [pair for p, q in zip(one.parts, other.parts, strict=True) for pair in zip(p.noise, q.noise, strict=True)]
    levels = [abs(p.sigma / q.sigma - 1.0) for p, q in pairs]
    correlations = [np.abs(p.autocorrelation(ORDER) - q.autocorrelation(ORDER)).max() for p, q in pairs]
    return clocks_differ(one, other) or bool(max((*levels, *correlations), default=0.0) > CRITERIA.max_noise_change)
