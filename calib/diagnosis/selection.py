"""The result of a stepwise selection of causes."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from calib.diagnosis.constancy import CHANNELS, RECORDS, Constancy, differing
from calib.diagnosis.elimination import LeftOut
from calib.diagnosis.excess import bias_std, significant
from calib.diagnosis.fit import Fit
from calib.diagnosis.harmonic_excess import UNTESTED, HarmonicExcess, model_error_chi2
from calib.diagnosis.search import Round
from calib.diagnosis.suspect import Refitted, leading_variants
from calib.diagnosis.transfer import Agreement


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
    rounds : searches one after the other; the last chose no cause unless there were enough, or the budget was spent
    null, final : the calibrated model, and the one with the causes
    causes : that are in the final model
    alternatives : of each cause, suspects indistinguishable from it beside the others, itself included
    is_explained : whether only noise is left, or each cause explains several times the remainder
    excess_chi2, remaining_chi2 : excess chi-square of the calibrated and of the final model
    share_above_noise : of the chi-square of the calibrated model that is excess, by the noise as known at the end  [1]
    chi2_std : standard deviation of the chi-square of noise alone
    harmonics : excess chi-square of the final model in the low harmonics of steady tones
    constancy : how much the size of each cause differs among the channels of the records, and from record to record
    record_spread : parameter of a cause on which the records do not agree -> standard deviation of the mean of their
        sizes, relative to that  [1]
    fitted_records_agree : whether the records of the fit agree on the sizes of the causes; if not, a cause is
        missing, though the sum of squares may not be significant
    exchanges : of causes for others after the rounds, in order
    left_out : that explain part of the remainder of the causes, and too little to be causes
    elimination_margin : excess chi-square by which it is decided that the causes explain enough, and these do not
    attained : least chi-square of a model that was considered
    cut_short : whether the budget was spent before all was tried that might change the result
    """

    rounds: tuple[Round, ...]
    null: Fit
    final: Fit
    causes: tuple[Refitted, ...]
    alternatives: tuple[tuple[Refitted, ...], ...]
    is_explained: bool
    excess_chi2: float
    remaining_chi2: float
    share_above_noise: float
    chi2_std: float
    harmonics: HarmonicExcess = UNTESTED
    constancy: tuple[Constancy, ...] = ()
    record_spread: Mapping[str, float] = field(default_factory=dict)
    fitted_records_agree: bool = True
    exchanges: tuple[Exchange, ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    elimination_margin: float = np.inf
    attained: float = np.inf
    cut_short: bool = False

    def without_causes(self) -> "Selection":
        """Return the same search with the calibrated model as its result."""
        return replace(
            self,
            final=self.null,
            causes=(),
            alternatives=(),
            is_explained=not self.is_significant,
            remaining_chi2=self.excess_chi2,
            harmonics=UNTESTED,
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
    def model_error_chi2(self) -> float:
        """Chi-square of the model error that the causes leave; 0 where what they leave may be noise."""
        return model_error_chi2(self.remaining_chi2, self.chi2_std, self.harmonics)

    @property
    def heterogeneous(self) -> tuple[Constancy, ...]:
        """Causes whose sizes differ among the records or their channels: each stands in for another cause."""
        several = len(self.causes) > 1 and not self.remainder_is_significant
        remainder = self.remainder_is_significant or not self.fitted_records_agree
        return differing(
            self.constancy, self.rounds[0].threshold, explained_by_several=several, is_remainder_significant=remainder
        )

    @property
    def differing_by_record(self) -> tuple[Constancy, ...]:
        """Causes whose sizes differ significantly from record to record, by whatever amount."""
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
        """Standard deviation of the bias of a parameter of a fit by the model error  [its unit].

        By what is left of that, and by the variation of the parameter among records.
        """
        spread = self.record_spread.get(name, 0.0) * abs(fit.value(name))
        return math.hypot(spread, bias_std(self.model_error_chi2, fit.information(name)))

    def with_records_compared(self, agreements: Sequence[Agreement], fitted_agree: bool = True) -> "Selection":
        """Return the selection with the constancy of its causes from record to record, by the sizes of each alone.

        fitted_agree : whether the records of the fit agree
        """
        among_channels = {c.effect: c for c in self.constancy}
        among_records = []
        for cause in self.causes:
            own = [a for a in agreements if a.parameter in cause.candidate.free]
            if own:
                most = max(own, key=lambda a: a.z)
                among_records.append(
                    Constancy(cause.name, most.z, most.variation, among_channels[cause.name].chi2, RECORDS)
                )
        spread = {a.parameter: a.variation / math.sqrt(len(a.records)) for a in agreements if not a.agree}
        return replace(
            self, constancy=(*self.constancy, *among_records), record_spread=spread, fitted_records_agree=fitted_agree
        )

    @property
    def is_sufficient(self) -> bool:
        """Whether the causes explain enough to be named, with one size each."""
        return self.is_explained and self.is_homogeneous

    @property
    def margin(self) -> float:
        """Reduction of chi-square on which the result rests: an error of a smaller one does not change it.

        Of each cause its reduction beyond that by the best distinguishable one, and beyond the one required beside the
        remainder; the excess where there is no cause; zero where causes were replaced by others. Of causes that explain
        enough, but have several sizes, the significance of that.
        """
        if self.is_explained and not self.is_homogeneous:
            return (max(c.z for c in self.heterogeneous) - self.rounds[0].threshold) ** 2
        by_name = {r.chosen.name: r.margin for r in self.rounds if r.chosen is not None}
        if not all(cause.name in by_name for cause in self.causes):
            return 0.0
        margins = [by_name[cause.name] for cause in self.causes]
        decisive = margins if self.is_sufficient and margins else [self.remaining_chi2, *margins]
        return max(0.0, min(self.elimination_margin, *decisive))

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
        """Suspects indistinguishable from a cause: from the last one that has several."""
        several = [rivals for rivals in self.alternatives if len(rivals) > 1]
        return several[-1] if several else self.alternatives[-1] if self.alternatives else ()

    @property
    def runners_up(self) -> tuple[Refitted, ...]:
        """Suspects that explained less in the search that chose the only cause, the best first."""
        names = {cause.name for cause in self.causes}
        search = next((r for r in self.rounds if r.chosen is not None and {r.chosen.name} == names), None)
        if search is None:
            return ()
        rivals = {rival.name for rival in self.rivals}
        suspects = [s for s in search.suspects if isinstance(s, Refitted) and s.fit.names and s.name not in rivals]
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
