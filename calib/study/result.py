"""The result of a calibration: what result.json holds."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from calib.modelling.model import Model
from calib.modelling.parameter import Window
from calib.records import OK
from calib.store.document import read_document, write_document
from calib.store.plain import plain, typed
from calib.study.reachability import UnreachableFeature

FILE_NAME = "result.json"
FAILED = "failed"


@dataclass(frozen=True)
class ScoreSummary:
    """Distance of the best simulation from the references, in all and by term  [1]; None where there is none."""

    total: float | None = None
    terms: Mapping[str, float | None] = field(default_factory=dict)


@dataclass(frozen=True)
class MotionSummary:
    """Kind of the best simulated motion, what it was judged by, and the records whose measured kind is another."""

    kind: str | None = None
    evidence: str | None = None
    wrong: tuple[str, ...] = ()


@dataclass(frozen=True)
class HeldOutSummary:
    """How the best point predicts a record that was held out.

    Attributes
    ----------
    misfit : as `calib.objective.MISFIT` has it  [1]; None where the record could not be simulated
    score, terms : of the study's terms on that record alone  [1]
    kind : of the simulated motion
    status, reason : "ok", or why the record could not be simulated
    nuisances : nuisance -> value that was solved for  [SI]
    """

    misfit: float | None = None
    score: float | None = None
    terms: Mapping[str, float | None] = field(default_factory=dict)
    kind: str | None = None
    status: str = OK
    reason: str = ""
    nuisances: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class LeaderSummary:
    """A leader of the search: number of its trial, its score in the search and in the confirming simulator  [1]."""

    trial: int
    searched: float | None = None
    confirmed: float | None = None
    status: str = OK
    reason: str = ""
    kind: str | None = None


@dataclass(frozen=True)
class ConfirmationSummary:
    """What became of the leaders of a search in the confirming simulator.

    Attributes
    ----------
    leaders : the best of the search first
    chosen : number of the trial with the lowest confirmed score
    changed : whether another trial than the best of the search was chosen
    seconds : wall-clock time  [s]
    """

    leaders: tuple[LeaderSummary, ...]
    chosen: int
    changed: bool = False
    seconds: float = 0.0

    @property
    def succeeded(self) -> bool:
        """Whether the chosen leader could be simulated with the confirming simulator."""
        return any(leader.trial == self.chosen and leader.confirmed is not None for leader in self.leaders)


@dataclass(frozen=True)
class UndeterminedGroup:
    """Parameters of which the measurement determines a combination much better than each alone, or one not at all.

    Attributes
    ----------
    members : names of the parameters
    direction : change of each member, as a share of its window, that leaves the residuals (nearly) unchanged
    text : the combination in words
    reason : "wider than the window" or "nearly collinear"
    """

    members: tuple[str, ...]
    direction: Mapping[str, float] = field(default_factory=dict)
    text: str = ""
    reason: str = ""


@dataclass(frozen=True)
class CorrelationSummary:
    """Correlation matrix of the estimates, in the order of `names`."""

    names: tuple[str, ...] = ()
    matrix: tuple[tuple[float | None, ...], ...] = ()


@dataclass(frozen=True)
class ConfidenceSummary:
    """Standard errors and intervals at the best point, as `calib.confidence.Confidence` has them; None: infinite."""

    status: str
    reason: str = ""
    standard_error: Mapping[str, float | None] = field(default_factory=dict)
    interval: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    correlation: CorrelationSummary = CorrelationSummary()
    undetermined: tuple[UndeterminedGroup, ...] = ()
    at_edge: Mapping[str, str] = field(default_factory=dict)
    degrees_of_freedom: Mapping[str, float | None] = field(default_factory=dict)
    evaluations: int = 0


@dataclass(frozen=True)
class ParameterSummary:
    """A parameter of the model: its unit, its nominal value [unit], None where it is infinite, and its meaning."""

    unit: str
    nominal: float | None
    meaning: str = ""


@dataclass(frozen=True)
class ModelSummary:
    """What a report shows of the model.

    Attributes
    ----------
    name : of simulator and effects
    bodies : of the simulator
    parameters : of the simulator and its effects, by name
    initial : parameter of the initial state -> body and channel
    incidental : options of the simulator without influence on records
    title : what a report calls it
    takes_laws : whether the simulator takes force laws
    """

    name: str
    bodies: tuple[str, ...] = ()
    parameters: Mapping[str, ParameterSummary] = field(default_factory=dict)
    initial: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    incidental: tuple[str, ...] = ()
    title: str = ""
    takes_laws: bool = True

    @classmethod
    def of(cls, model: Model) -> "ModelSummary":
        """Summarise a model."""
        return cls(
            model.name,
            tuple(model.bodies),
            {name: ParameterSummary(one.unit, one.nominal, one.meaning) for name, one in model.parameters.items()},
            dict(model.initial),
            tuple(sorted(getattr(model.simulator, "incidental", ()))),
            model.title,
            bool(model.simulator.sites),
        )


@dataclass(frozen=True)
class FailureSummary:
    """Trials that failed for one cause: the status, how many, and the reason of the first with its details."""

    status: str
    trials: int
    reason: str = ""


@dataclass(frozen=True)
class ChannelResidual:
    """The residual of a channel beside its noise, where that is known.

    Attributes
    ----------
    record, body, channel : that it is of
    ratio : root mean square of the residual in units of the noise, whitened by its autocorrelation  [1]
    source : of the noise level: "stated in the record", "estimated by order tracking" or "cycle to cycle"
    is_noise : whether it is no more than noise, a level that is 10 % off allowed for
    """

    record: str
    body: str
    channel: str
    ratio: float
    source: str
    is_noise: bool


@dataclass(frozen=True)
class CalibrationResult:
    """What a calibration found; numbers in SI, None where they are not known or not finite.

    Attributes
    ----------
    name : of the study
    status : "ok", or "failed" where no trial ended ok
    stopped : why the search ended
    values, units : of the best point, by parameter
    windows : searched parameter -> its window
    intervals : searched parameter -> its 95 % interval (low, high)
    undetermined : groups of parameters of which only a combination is determined
    at_edge : parameters whose value lies at an edge of its window
    unreachable : measured features that no trial reaches
    score, motion : of the best simulation
    nuisances : record -> nuisance -> value that was solved for
    nuisance_units : nuisance -> SI unit
    agreement : what the optimiser says of how far its search may be trusted, in its own words
    holdout : record that was held out -> how it is predicted
    confirmation : of the leaders of the search; None where the simulator has no confirming one
    confidence : at the best point
    residual : of each channel whose noise is known
    remarks : what else to mind, a sentence each, without its full stop
    best_trial : number of the best trial
    reproduced : whether it gave its logged score when it was evaluated again; None where it was not
    trials, failed : number of trials, and of those that did not end ok
    failures : for which causes, the most frequent first
    simulations : runs of the simulator, everything counted
    seconds : wall-clock time  [s]
    model : that was calibrated; None where a former version did not say
    """

    name: str = ""
    status: str = OK
    stopped: str = ""
    values: Mapping[str, float] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    windows: Mapping[str, Window] = field(default_factory=dict)
    intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    undetermined: tuple[UndeterminedGroup, ...] = ()
    at_edge: tuple[str, ...] = ()
    unreachable: tuple[UnreachableFeature, ...] = ()
    score: ScoreSummary = ScoreSummary()
    motion: MotionSummary = MotionSummary()
    nuisances: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    nuisance_units: Mapping[str, str] = field(default_factory=dict)
    agreement: Mapping[str, Any] | None = None
    holdout: Mapping[str, HeldOutSummary] = field(default_factory=dict)
    confirmation: ConfirmationSummary | None = None
    confidence: ConfidenceSummary | None = None
    residual: tuple[ChannelResidual, ...] = ()
    remarks: tuple[str, ...] = ()
    best_trial: int | None = None
    reproduced: bool | None = None
    trials: int = 0
    failed: int = 0
    failures: tuple[FailureSummary, ...] = ()
    simulations: int | None = None
    seconds: float = 0.0
    model: ModelSummary | None = None

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> "CalibrationResult":
        """Return the result that a JSON object describes; what it does not say takes its default."""
        return typed(cls, document)

    def as_dict(self) -> dict[str, Any]:
        """Return the object of result.json, which `json.dumps(..., allow_nan=False)` takes.

        `reproduced` and `model` are left out where they are None, `residual` where no noise is known.
        """
        own = plain(self)
        for key, absent in (("reproduced", None), ("model", None), ("residual", [])):
            if own[key] == absent:
                del own[key]
        return own

    @property
    def confirmed(self) -> bool:
        """Whether values and score are those of a confirming simulator."""
        return self.confirmation is not None and self.confirmation.succeeded

    @property
    def searched_best(self) -> int | None:
        """Number of the trial that the search found best, whatever was chosen after it."""
        return self.best_trial if self.confirmation is None else self.confirmation.leaders[0].trial

    @property
    def starts(self) -> tuple[int, int] | None:
        """How many starts of the search ended at its best point, of how many; None where it has no several starts."""
        agreement = self.agreement or {}
        return (agreement["agree"], agreement["starts"]) if {"agree", "starts"} <= set(agreement) else None


def write(calibration: CalibrationResult, folder: Path) -> Path:
    """Write `result.json` so that it is either whole or absent; return its path."""
    path = folder / FILE_NAME
    write_document(calibration.as_dict(), path)
    return path


def read(folder: Path) -> CalibrationResult | None:
    """Return the result in `folder`, None where there is none.

    Raises
    ------
    CalibError : `result.json` is not JSON, or no result of a calibration
    """
    return read_document(folder / FILE_NAME, CalibrationResult.from_dict, "result of a calibration", "calib run")
