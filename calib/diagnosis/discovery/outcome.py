"""The outcome of a search for a force law."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from calib.diagnosis.discovery.document import OF_HISTORY
from calib.diagnosis.discovery.formulas import FormulaTrial
from calib.diagnosis.discovery.history import HistoryTrial
from calib.diagnosis.discovery.left_out import LeftOutMisfit
from calib.diagnosis.discovery.partial_spline import PartialSpline
from calib.diagnosis.discovery.penalised import States
from calib.diagnosis.discovery.summary import explained_share
from calib.diagnosis.discovery.trial import ForceTrial
from calib.diagnosis.fit import Fit
from calib.diagnosis.gates import Gate

FOUND, NOTHING, UNDETERMINED, NOT_DIAGNOSABLE = "found", "nothing", "undetermined", "not_diagnosable"


@dataclass(frozen=True, eq=False)
class Discovery:
    """The result of a search for a force law.

    Attributes
    ----------
    verdict : "found", "history_dependent" (a law with internal states predicts better than any function of the state),
        "nothing", "undetermined" (the records cannot tell, of what it is a function at least) or "not_diagnosable"
    summary : the verdict in a sentence
    gates : that were tested
    trials : models that were fitted, in their order
    chosen : the simplest model that predicts as well as the best; None where nothing was found
    rivals : places at which a force predicts as well, the chosen one excluded
    states : of the place in the simulations of the chosen model, None without one
    null : the calibrated model, fitted; None where a gate failed
    null_left_out : misfit of the left-out records without a force
    excess_chi2 : of the calibrated model, and of the chosen one (0 without one)
    formulas : of the chosen model, the best first; empty without one
    histories : laws with internal states that were refitted in its place, the one that predicts best first
    cut_short : whether the budget ended it before all was tried
    curves : places at which all records visit one curve of states, with what coincides there in words
    frequencies : lowest and highest at which responses among the records were measured; None without one  [Hz]
    seconds, simulations : of the search  [s]
    """

    verdict: str
    summary: str
    gates: tuple[Gate, ...]
    trials: tuple[ForceTrial, ...] = ()
    chosen: ForceTrial | None = None
    rivals: tuple[str, ...] = ()
    states: States | None = None
    null: Fit | None = None
    null_left_out: LeftOutMisfit | None = None
    excess_chi2: tuple[float, float] = (0.0, 0.0)
    formulas: tuple[FormulaTrial, ...] = ()
    histories: tuple[HistoryTrial, ...] = ()
    cut_short: bool = False
    curves: Mapping[str, str] = field(default_factory=dict)
    frequencies: tuple[float, float] | None = None
    seconds: float = 0.0
    simulations: int = 0

    @property
    def formula_trial(self) -> FormulaTrial | None:
        """Formula of the force: the first, where it predicts as well as the free force; None where history counts."""
        if self.verdict == OF_HISTORY:
            return None
        return next((trial for trial in self.formulas[:1] if trial.predicts), None)

    @cached_property
    def partial_spline(self) -> PartialSpline | None:
        """Force as the formula and what the records add to it; None where no formula predicts as well."""
        trial = self.formula_trial
        return None if trial is None or self.chosen is None else PartialSpline.of(self.chosen.fitted, trial)

    @property
    def explained(self) -> float:
        """Share of the excess chi-square that the chosen model explains  [1]."""
        return explained_share(*self.excess_chi2)
