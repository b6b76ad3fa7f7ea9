"""The result of a diagnosis: the objects of diagnosis.json, their fields in the order of its keys."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from calib.diagnosis.design_document import DesignResult, MeasurementResult
from calib.diagnosis.levels.document import LevelsResult
from calib.store.plain import plain, typed

Ends = tuple[float | None, float | None]  # of an interval or a range; None where there is no end


@dataclass(frozen=True)
class GateResult:
    """Whether a condition of the diagnosis holds, what was found, and whether it could be tested at all."""

    name: str
    passed: bool
    summary: str = field(metadata={"key": "said"})
    z: float | None = None
    tried: bool = True


@dataclass(frozen=True)
class SuspectResult:
    """An effect that was compared with the residuals; sizes by parameter, in SI.

    Attributes
    ----------
    effect, meaning, equation : name, sentence and law of the effect
    bodies : on which it acts, None where it acts on all
    z : of the score test  [standard deviations]; None where the effect was not tested
    size, interval : of its parameters, with their 95 % intervals
    held : size of parameters that were not fitted
    limits, units, null : range and SI unit of each parameter, and its value where the effect is absent
    share : of the excess chi-square that it explains, in the noise as it is known at the end  [1]
    absorbed : share of its signature that the calibrated parameters absorb  [1]
    detectable : smallest size that would pass the threshold
    chi2_reduction : of the whitened residuals by the effect alone, in the noise of the first search  [1]
    refitted : whether share and size are from a fit, not estimated from the score test
    cosine : of the angle between its signature and that of the effect chosen in the first round  [1]
    reason : why it was not tested or not fitted, "" where it was
    """

    effect: str
    meaning: str = ""
    equation: str = ""
    bodies: tuple[str, ...] | None = None
    z: float | None = None
    size: Mapping[str, float | None] = field(default_factory=dict)
    interval: Mapping[str, Ends] = field(default_factory=dict)
    held: Mapping[str, float | None] = field(default_factory=dict)
    limits: Mapping[str, Ends] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    share: float | None = None
    absorbed: float = 0.0
    detectable: Mapping[str, float | None] = field(default_factory=dict)
    chi2_reduction: float = field(default=0.0, metadata={"key": "drop"})
    refitted: bool = False
    null: Mapping[str, float | None] = field(default_factory=dict)
    cosine: float | None = field(default=None, metadata={"key": "alike"})
    reason: str = ""


@dataclass(frozen=True)
class JointSize:
    """Sizes of a cause by parameter, all causes and calibrated parameters being fitted together; in SI.

    Parameters that give it its form, such as an exponent, are among them where they were fitted. `bias` is the
    standard deviation of the bias that what is not modelled may give a size.
    """

    size: Mapping[str, float | None] = field(default_factory=dict)
    interval: Mapping[str, Ends] = field(default_factory=dict)
    bias: Mapping[str, float | None] = field(default_factory=dict)
    limits: Mapping[str, Ends] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class PredictionResult:
    """Reduction of chi-square on left-out data by a cause.

    Attributes
    ----------
    reduction, error : of chi-square, with its standard error  [1]
    without : chi-square of the left-out data without the cause  [1]
    folds : that were left out in turn
    uncertainty : expected increase of chi-square by the errors of the refitted parameters  [1]
    share_error : standard error of the reduction over `without`  [1]
    """

    reduction: float | None = None
    error: float | None = None
    without: float | None = None
    folds: tuple[str, ...] = ()
    uncertainty: float | None = None
    share_error: float | None = None


@dataclass(frozen=True)
class RoundResult:
    """A round of the search: the effect that was added to the model, or why none was.

    Attributes
    ----------
    threshold : of |z|
    chosen : name of the effect that was added, None where none was
    share : of the excess chi-square that it explains, in the noise as it is known at the end  [1]
    rivals : names of the effects that are indistinguishable from it, itself included
    prediction : of left-out data
    rejected, rejection : the effect that explains most where none was added, and why it was not
    untried : effects that were to be refitted when the budget was spent
    cosines : rival -> cosine of the angle between its signature and that of the chosen effect  [1]
    """

    threshold: float | None
    chosen: str | None = None
    share: float | None = None
    rivals: tuple[str, ...] = ()
    prediction: PredictionResult | None = None
    rejected: str | None = None
    rejection: str = ""
    untried: tuple[str, ...] = ()
    cosines: Mapping[str, float | None] = field(default_factory=dict, metadata={"key": "alike"})


@dataclass(frozen=True)
class ExchangeResult:
    """Causes that were exchanged for others after the rounds, and why."""

    before: tuple[str, ...]
    after: tuple[str, ...]
    reason: str


@dataclass(frozen=True)
class LeftOutResult:
    """An effect that is not named although it explains a share of the excess that the causes beside it may leave."""

    effect: str
    share: float | None
    beside: tuple[str, ...]
    reason: str = ""


@dataclass(frozen=True)
class DeviationResult:
    """A feature, measured with its standard error and simulated, in SI; z = (predicted - measured) / error."""

    label: str
    record: str
    body: str
    unit: str
    measured: float | None = None
    simulated: float | None = None
    error: float | None = None
    z: float | None = None


@dataclass(frozen=True)
class ConstancyResult:
    """Whether an effect has the same size everywhere: normal deviate z, and relative variation of the size  [1].

    `chi2` is that by which the sum of squares would rise without the effect; `among` says what is compared.
    """

    effect: str
    z: float | None
    variation: float | None
    chi2: float | None = None
    among: str | None = None


@dataclass(frozen=True)
class ChannelResult:
    """A channel that is compared: residual and noise in its unit.

    Attributes
    ----------
    record, body, channel : whose
    rms, noise : root mean square of the residual, and of the noise
    orders : amplitudes of the residual's harmonics, from order 0
    floor : amplitude of noise in a harmonic, on average
    """

    record: str
    body: str
    channel: str
    rms: float | None = None
    noise: float | None = None
    orders: tuple[float | None, ...] = ()
    floor: float | None = None


@dataclass(frozen=True)
class ParameterResult:
    """Value of a parameter in the calibrated model, None where that has none, and in the extended one  [SI]."""

    before: float | None = None
    after: float | None = None


@dataclass(frozen=True)
class MisfitResult:
    """Chi-square of the residuals beyond that of the noise.

    Attributes
    ----------
    excess_chi2, remaining_chi2 : of the calibrated and of the extended model, less what noise makes on average
    chi2_std : standard deviation of the chi-square of noise
    share : of the excess that the extended model explains  [1]
    heterogeneity_z : Cochran's Q of the sizes among channels or records, as a normal deviate; None where not tested
    constancy : of each cause
    features : simulated and measured, the largest deviation first
    channels : that are compared
    """

    excess_chi2: float = field(default=0.0, metadata={"key": "excess"})
    remaining_chi2: float = field(default=0.0, metadata={"key": "left"})
    chi2_std: float = field(default=1.0, metadata={"key": "blur"})
    share: float = 0.0
    heterogeneity_z: float | None = field(default=None, metadata={"key": "inconstancy"})
    constancy: tuple[ConstancyResult, ...] = ()
    features: tuple[DeviationResult, ...] = ()
    channels: tuple[ChannelResult, ...] = ()


@dataclass(frozen=True)
class RemainderRow:
    """Chi-square beyond the noise that the extended model leaves in a channel."""

    record: str
    body: str
    channel: str
    beyond_noise: float


@dataclass(frozen=True)
class RemainderResult:
    """What the extended model leaves: whether it is more than noise, and how much of it is in each channel."""

    share: float | None = None
    above_noise: bool = False
    rows: tuple[RemainderRow, ...] = ()


@dataclass(frozen=True)
class TransferResult:
    """Size of a parameter refitted to one record alone, with standard error and half width of its 95 % interval; in SI.

    `held` says whether the record was held out; `freedom` is the number of degrees of freedom of the error, None where
    infinite; `bias` is the standard deviation of what the model leaves there.
    """

    record: str
    parameter: str
    size: float | None = None
    error: float | None = None
    held: bool = False
    freedom: float | None = None
    bias: float | None = None
    half_width: float | None = None


@dataclass(frozen=True, kw_only=True)
class AgreementResult:
    """Whether the records, each alone, agree on the size of a parameter.

    Attributes
    ----------
    parameter : name
    chi2, degrees, z : chi-square of the sizes about their mean, its degrees of freedom, and its normal deviate
    variation : of the sizes beyond their errors, relative to their mean  [1]
    agree : whether z is not above the threshold
    detectable : variation above which they would not agree  [1]
    records : that have such a size
    """

    parameter: str
    chi2: float | None
    degrees: int
    z: float | None
    variation: float | None = None
    agree: bool
    detectable: float | None = None
    records: tuple[str, ...] = ()


@dataclass(frozen=True)
class ShiftResult:
    """A calibrated parameter without and with the extension, with standard errors [SI]; the shift in these errors."""

    parameter: str
    before: float
    after: float
    before_error: float | None = None
    after_error: float | None = None
    unit: str = "1"
    errors: float | None = None


@dataclass(frozen=True)
class GainResult:
    """Misfit of data that the diagnosis did not use, before and after the extension.

    Attributes
    ----------
    metric : what misfit is
    kind : of the data, "records held out" or parts of the calibrated records
    before, after : misfit over all of them  [1]
    interval : 95 % interval of the reduction  [1]
    records : names
    proven : whether that interval lies above zero
    each : record -> misfit before and after  [1]
    failed : record -> why it could not be simulated or compared
    unaffected : records that no cause changes
    """

    metric: str = ""
    kind: str = ""
    before: float | None = None
    after: float | None = None
    interval: Ends = (None, None)
    records: tuple[str, ...] = ()
    proven: bool = False
    each: Mapping[str, Ends] = field(default_factory=dict)
    failed: Mapping[str, str] = field(default_factory=dict)
    unaffected: tuple[str, ...] = ()
    transfers: tuple[TransferResult, ...] = ()
    agreements: tuple[AgreementResult, ...] = ()
    shifts: tuple[ShiftResult, ...] = ()


@dataclass(frozen=True)
class GrossErrorsResult:
    """Points of a frequency response that are gross errors.

    Attributes
    ----------
    record : its name
    points : number of its points
    numbers : of those that are gross errors, the first point being number 1
    frequencies : of these  [Hz]
    """

    record: str
    points: int
    numbers: tuple[int, ...]
    frequencies: tuple[float, ...]


@dataclass(frozen=True)
class DiagnosisResult:
    """What a diagnosis found; numbers in SI, None where they are not known or not finite.

    Attributes
    ----------
    verdict, summary : of `calib.diagnosis.verdict`
    causes : names of the effects, or faults of the records, that are named
    classes : indistinguishable models, each the names of its effects
    stand_ins : effects that come closest although their sizes differ from record to record
    remainder : what the extended model leaves
    closest : effects that explain most where none is named
    suspects, rounds, exchanges, left_out : of the search
    refused : effect -> why it could not be tested
    gates : conditions of the diagnosis
    outliers : share of the samples  [1]
    gross_errors : points of frequency responses, which have little weight
    rounding : share of the noise of a channel that is quantisation  [1]
    misfit : None where the records could not be compared
    parameters : calibrated ones, and those of the causes
    joint_sizes : cause -> its sizes
    gain : None where nothing was added to the model
    next_measurement, measurements : the best next measurement, and that of each kind of test
    design : the search for them
    levels : frequency responses of several levels, compared with models level by level
    threshold : of |z| in the first round
    cut_short : whether the budget was spent before all was tried
    simulations, seconds : cost; wall-clock time  [s]
    values : calibrated values that were diagnosed
    omitted : what was left out for the budget, each as a clause
    """

    verdict: str
    summary: str = field(default="", metadata={"key": "said"})
    causes: tuple[str, ...] = ()
    classes: tuple[tuple[str, ...], ...] = field(default=(), metadata={"key": "class"})
    stand_ins: tuple[str, ...] = ()
    remainder: RemainderResult | None = field(default=None, metadata={"key": "remains"})
    closest: tuple[str, ...] = ()
    suspects: tuple[SuspectResult, ...] = ()
    rounds: tuple[RoundResult, ...] = ()
    exchanges: tuple[ExchangeResult, ...] = ()
    left_out: tuple[LeftOutResult, ...] = ()
    refused: Mapping[str, str] = field(default_factory=dict)
    gates: tuple[GateResult, ...] = ()
    outliers: float = 0.0
    rounding: float = 0.0
    misfit: MisfitResult | None = None
    parameters: Mapping[str, ParameterResult] = field(default_factory=dict)
    joint_sizes: Mapping[str, JointSize] = field(default_factory=dict)
    gain: GainResult | None = None
    next_measurement: MeasurementResult | None = None
    measurements: tuple[MeasurementResult, ...] = ()
    design: DesignResult | None = None
    levels: tuple[LevelsResult, ...] = ()
    threshold: float | None = None
    cut_short: bool = False
    simulations: int = 0
    seconds: float = 0.0
    values: Mapping[str, float] = field(default_factory=dict)
    omitted: tuple[str, ...] = ()
    gross_errors: tuple[GrossErrorsResult, ...] = ()

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> "DiagnosisResult":
        """Return the diagnosis that the object of diagnosis.json describes; what it does not say takes its default.

        Raises
        ------
        ValueError : the object is no diagnosis
        """
        if isinstance(document, Mapping):
            document = {**document, "misfit": document.get("misfit") or None}
        return typed(cls, document)

    @property
    def full_summary(self) -> str:
        """The summary, and what was left out for the budget."""
        return f"{self.summary} (the budget was spent: {'; '.join(self.omitted)})" if self.omitted else self.summary

    def as_dict(self) -> dict[str, Any]:
        """Return the object of diagnosis.json, which `json.dumps(..., allow_nan=False)` takes."""
        document = plain(self)
        for name, value in (("omitted", self.omitted), ("levels", self.levels), ("gross_errors", self.gross_errors)):
            if not value:  # as in documents of 0.1
                del document[name]
        return {**document, "misfit": document["misfit"] or {}}
