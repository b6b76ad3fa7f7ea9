"""The state of a stepwise selection."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.diagnosis.constancy import constancies
from calib.diagnosis.elimination import Elimination, eliminated
from calib.diagnosis.excess import chi2_std, excess_over, significant
from calib.diagnosis.fit import Fit
from calib.diagnosis.harmonic_excess import harmonic_excess
from calib.diagnosis.refit import Fitter
from calib.diagnosis.screening import KnownDerivatives
from calib.diagnosis.search import Round
from calib.diagnosis.selection import Exchange, Selection
from calib.diagnosis.suspect import Cause


@dataclass(frozen=True, eq=False)
class StepwiseState:
    """A stepwise selection so far.

    Attributes
    ----------
    null, final : the calibrated model, and the one with the causes
    known : derivatives of candidates
    rounds : searches one after the other
    causes : in the final model
    exchanges : of causes for others
    elimination : of these causes; None before it
    attained : least chi-square of a model that went through elimination: what its causes explained remains without them
    stand_ins : names of causes that were eliminated for their several sizes
    """

    null: Fit
    final: Fit
    known: KnownDerivatives
    rounds: tuple[Round, ...] = ()
    causes: tuple[Cause, ...] = ()
    exchanges: tuple[Exchange, ...] = ()
    elimination: Elimination | None = None
    attained: float = np.inf
    stand_ins: frozenset[str] = frozenset()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the causes."""
        return tuple(cause.name for cause, _ in self.causes)

    @property
    def is_explained(self) -> bool:
        """Whether the causes, after elimination, explain enough."""
        return self.elimination is not None and self.elimination.is_explained

    def with_untried(self, names: Sequence[str]) -> "StepwiseState":
        """Return the state in whose last search these suspects were left out or broken off for the budget."""
        last = self.rounds[-1]
        untried = dict.fromkeys((*last.untried, *(name for name in names if name not in self.names)))
        return replace(self, rounds=(*self.rounds[:-1], replace(last, untried=tuple(untried))))

    def with_causes(self, causes: Sequence[Cause], final: Fit, reason: str) -> "StepwiseState":
        """Return the state with these causes instead of its own.

        reason : why, as the end of a sentence
        """
        before, after = (tuple(cause.name for cause, _ in own) for own in (self.causes, causes))
        if set(before) == set(after):
            return replace(self, causes=tuple(causes), final=final)
        exchanges = (*self.exchanges, Exchange(before, after, reason))
        return replace(self, causes=tuple(causes), final=final, exchanges=exchanges, elimination=None)


def state_of(selection: Selection) -> StepwiseState:
    """Return the state in which a selection ended, before another elimination."""
    causes = tuple(zip(selection.causes, selection.alternatives, strict=True))
    return StepwiseState(
        selection.null, selection.final, {}, selection.rounds, causes, selection.exchanges, attained=selection.attained
    )


def through_elimination(fitter: Fitter, state: StepwiseState) -> StepwiseState:
    """Eliminate causes that explain little beside the remainder; if all do, they stay as the closest ones."""
    if not state.causes or state.elimination is not None:
        return state
    attained = min(state.attained, state.final.chi2)
    left = eliminated(fitter, state.null, state.causes, state.final, state.rounds[0].threshold, attained)
    stand_ins = state.stand_ins | {one.effect for one in left.left_out if one.reason}
    return replace(
        state, causes=left.causes, final=left.final, elimination=left, attained=attained, stand_ins=stand_ins
    )


def as_selection(fitter: Fitter, state: StepwiseState) -> Selection:
    """Compare the calibrated and the final model where the simulations of both are reliable."""
    null, final, causes, elimination = state.null, state.final, state.causes, state.elimination
    common = fitter.evidence.with_weights([null.point.simulated, final.point.simulated])
    excess, whole, std = excess_over(common, null), null.chi2_over(common), chi2_std(common)
    named = {rival.name for _, rivals in causes for rival in rivals}
    return Selection(
        rounds=state.rounds,
        null=null,
        final=final,
        causes=tuple(cause.within(final) for cause, _ in causes),
        alternatives=tuple(rivals for _, rivals in causes),
        is_explained=state.is_explained if causes else not significant(excess, std),
        excess_chi2=excess,
        remaining_chi2=excess_over(common, final),
        share_above_noise=excess / whole if whole > 0.0 else 0.0,
        chi2_std=std,
        harmonics=harmonic_excess(fitter.evidence, final),
        constancy=constancies(fitter.evidence, final) if causes else (),
        exchanges=state.exchanges,
        left_out=tuple(one for one in elimination.left_out if one.effect not in named) if elimination else (),
        elimination_margin=elimination.margin if elimination else np.inf,
        attained=state.attained,
        cut_short=fitter.effort.spent,
    )
