"""How sure calibrated values are: the objects of confidence.json, their fields in the order of its keys."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from calib.records import OK
from calib.store.plain import plain, typed

AT_LIMIT = "limit"  # status of a sample whose evaluations were not enough


@dataclass(frozen=True)
class PointResult:
    """A point of a profile.

    Attributes
    ----------
    value : of the parameter, in SI
    ratio : likelihood ratio there, the other parameters fitted; None where no motion can be compared
    kind : of the simulated motion
    reason : why it cannot be compared; "" where it can
    values : of all searched parameters, in SI
    """

    value: float
    ratio: float | None
    kind: str | None
    reason: str
    values: Mapping[str, float]


@dataclass(frozen=True)
class EndResult:
    """An end of an interval.

    Attributes
    ----------
    value : in SI; where the interval is open, the end of the window
    cause : "crossed" (the likelihood ratio reaches the quantile), "window end" (it does not: the interval is open),
        "no comparable motion" (beyond), "jump" (of the likelihood ratio over the quantile) or "not located"
    text : in words
    """

    value: float
    cause: str
    text: str


@dataclass(frozen=True)
class ProfileResult:
    """The profile of the likelihood over one parameter.

    Attributes
    ----------
    name, unit : of the parameter
    scale : of its window, "linear" or "log"
    value : best one, in SI
    low, high : ends of the interval
    local : (low, high) of the local interval; None where there is none
    quantile : of the likelihood ratio, at which the interval ends
    half_width : of the local interval on the scale of the window (natural logarithm of a log one); None without one
    text : how the interval differs from the local one
    points : by their value; the best point is not among them
    """

    name: str
    unit: str
    scale: str
    value: float
    low: EndResult
    high: EndResult
    local: tuple[float, float] | None
    quantile: float
    half_width: float | None
    text: str
    points: tuple[PointResult, ...]


@dataclass(frozen=True)
class PairResult:
    """The profile of the likelihood over two parameters.

    Attributes
    ----------
    names, units, scales : of the parameters
    first, second : values of each on the grid, in SI
    ratio : likelihood ratio, for each value of the first those over the second; None where no motion can be compared
    quantile : of the joint likelihood ratio, that bounds their joint region
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    scales: tuple[str, ...]
    first: tuple[float, ...]
    second: tuple[float, ...]
    ratio: tuple[tuple[float | None, ...], ...]
    quantile: float


@dataclass(frozen=True)
class MarginalResult:
    """The marginal posterior distribution of a parameter, in SI.

    Attributes
    ----------
    name, unit, scale : of the parameter and its window
    mean, standard_deviation : of the distribution
    low, high : of the interval of equal tails, at the level of all intervals
    prior : in words
    """

    name: str
    unit: str
    scale: str
    mean: float
    standard_deviation: float
    low: float
    high: float
    prior: str


@dataclass(frozen=True)
class ModeResult:
    """One of several separate modes of a posterior distribution, in SI.

    Attributes
    ----------
    share : of the probability  [1]
    mean, standard_deviation : of each parameter in it
    """

    share: float
    mean: Mapping[str, float]
    standard_deviation: Mapping[str, float]


@dataclass(frozen=True)
class PredictedChannelResult:
    """A channel of a body beside what the posterior distribution predicts of it.

    Attributes
    ----------
    body, channel : whose
    inside : share of its samples inside the 95 % band of curve and noise  [1]; None where no sample counts
    samples : that count; velocities beside an impact and points without a band do not
    noise, unit : standard deviation of the noise, in SI
    source : where it comes from, in words
    """

    body: str
    channel: str
    inside: float | None
    samples: int
    noise: float
    unit: str
    source: str


@dataclass(frozen=True)
class PredictedRecordResult:
    """A record beside what the posterior distribution predicts of it.

    Attributes
    ----------
    name : of the record
    held_out : whether it was not calibrated on
    draws, failed, other_kind : draws of the posterior that were simulated, those that failed, and those whose motion is
        of another kind than measured
    channels : of each channel that is compared; none where the record cannot be predicted
    reason : why not; "" where it is
    samples_left_out, bodies_left_out : of a long record and one of many bodies, that are not predicted
    unreached : share of the points of a frequency response, over all draws, that no stable motion reaches  [1]; they
        are left out of the bands
    points_without_band : of a frequency response, that too few draws reach
    """

    name: str
    held_out: bool
    draws: int
    failed: int
    other_kind: int
    channels: tuple[PredictedChannelResult, ...] = ()
    reason: str = ""
    samples_left_out: int = 0
    bodies_left_out: int = 0
    unreached: float = 0.0
    points_without_band: int = 0


@dataclass(frozen=True)
class ConfirmedMarginalResult:
    """A parameter in the draws that the confirming simulator has reweighted, in SI.

    Attributes
    ----------
    mean, standard_deviation : of the reweighted draws
    shift : of the mean, over the standard deviation of the posterior distribution  [1]
    """

    name: str
    mean: float
    standard_deviation: float
    shift: float


@dataclass(frozen=True)
class ConfirmedResult:
    """Draws of a posterior distribution that the confirming simulator has computed again.

    Attributes
    ----------
    draws, failed : number of them, and of those that cannot be compared there
    effective_size : of the reweighted draws  [count]
    reweighted : whether that is enough, and `pareto_k` small enough
    spread : standard deviation over the draws of the difference of both log-likelihoods  [1]
    parameters : of the reweighted draws; none where these are too few
    text : in words
    pareto_k : shape of the tail of the weights, by Pareto-smoothed importance sampling  [1]; None where too few draws
        have a weight
    """

    draws: int
    failed: int
    effective_size: float
    reweighted: bool
    spread: float
    parameters: tuple[ConfirmedMarginalResult, ...]
    text: str
    pareto_k: float | None = None


@dataclass(frozen=True)
class PosteriorResult:
    """The posterior distribution of the parameters; its sample is in posterior.nc.

    Attributes
    ----------
    parameters : marginal distribution of each
    log_evidence, log_evidence_error : logarithm of the evidence of the model over the likelihood of its best point
    effective_size : of the sample  [count]
    evaluations : that it took, of all calibrated records
    predicted : records beside what it predicts of them, the calibrated ones first
    confirmed : by the confirming simulator; None where there is none
    modes : separate ones, the heaviest first; none where there is only one
    status : "ok", or "limit" where the sampling reached its largest number of evaluations
    """

    parameters: tuple[MarginalResult, ...]
    log_evidence: float
    log_evidence_error: float
    effective_size: float
    evaluations: int
    predicted: tuple[PredictedRecordResult, ...] = ()
    confirmed: ConfirmedResult | None = None
    modes: tuple[ModeResult, ...] = ()
    status: str = OK


@dataclass(frozen=True)
class ComparedModelResult:
    """A model beside others of the same measurement.

    Attributes
    ----------
    name : of its study
    effects : of the model
    parameters : that it searches, and this study does not
    log_likelihood : of its best point, over that of the best of all models
    log_evidence, log_evidence_error : logarithm of its evidence over that likelihood, and the error of the sampling
    factor, factor_error : logarithm of its Bayes factor against this study's model; 0 of that itself
    evaluations : that its posterior distribution took
    text : how strong the evidence is and what prior windows do to it, in words
    """

    name: str
    effects: tuple[str, ...]
    parameters: tuple[str, ...]
    log_likelihood: float
    log_evidence: float
    log_evidence_error: float
    factor: float
    factor_error: float
    evaluations: int
    text: str


@dataclass(frozen=True)
class ComparisonResult:
    """Competing models by their evidence, all with the noise of the one that fits best.

    Attributes
    ----------
    models : this study's first
    noise : name of the study whose residuals show the noise
    diagnosis : what the diagnosis of this study says, in words
    """

    models: tuple[ComparedModelResult, ...]
    noise: str
    diagnosis: str


@dataclass(frozen=True)
class ConfidenceResult:
    """How sure the calibrated values of a study are.

    Attributes
    ----------
    name : of the study
    level : of the intervals  [1]
    noise : where the size of the noise comes from, in words
    calibrated : values that `calib run` has found, from which the profiles began, in SI
    values : best values, in SI
    kind : of their motion
    profiles : of each parameter
    pairs : of two parameters each
    remarks : what a reader should know, a sentence each
    evaluations : that the profiles took, of all calibrated records
    seconds : wall-clock time of the last run  [s]
    posterior : distribution of the values; None where it was not sampled
    comparison : with other models; None where there was none
    """

    name: str
    level: float
    noise: str
    calibrated: Mapping[str, float]
    values: Mapping[str, float]
    kind: str | None
    profiles: tuple[ProfileResult, ...]
    pairs: tuple[PairResult, ...] = ()
    remarks: tuple[str, ...] = ()
    evaluations: int = 0
    seconds: float = 0.0
    posterior: PosteriorResult | None = None
    comparison: ComparisonResult | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return what confidence.json holds."""
        document: dict[str, Any] = plain(self)
        return document

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> "ConfidenceResult":
        """Read what `as_dict` returns.

        Raises
        ------
        ValueError : the document describes none
        """
        return typed(cls, document)
