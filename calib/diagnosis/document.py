"""The result of a diagnosis: what diagnosis.json holds, typed."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from calib.errors import CalibError
from calib.store.plain import typed

Ends = tuple[float | None, float | None]  # of an interval or a range; None where there is no end
MISFIT_KEYS = {  # field -> key of diagnosis.json
    "excess_chi2": "excess", "remaining_chi2": "left", "chi2_std": "blur", "heterogeneity_z": "inconstancy",
}  # fmt: skip


@dataclass(frozen=True)
class GateResult:
    """Whether a condition of the diagnosis holds, what was found, and whether it could be tested at all."""

    name: str
    passed: bool
    summary: str
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
    share : of the excess chi-square that it explains  [1]
    absorbed : share of its signature that the calibrated parameters absorb  [1]
    detectable : smallest size that would pass the threshold
    chi2_reduction : of the whitened residuals by the effect alone  [1]
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
    chi2_reduction: float = 0.0
    refitted: bool = False
    null: Mapping[str, float | None] = field(default_factory=dict)
    cosine: float | None = None
    reason: str = ""


@dataclass(frozen=True)
class JointSize:
    """Sizes of a cause by parameter, all causes and calibrated parameters being fitted together; in SI.

    `bias` is the standard deviation of the bias that what is not modelled may give a size.
    """

    size: Mapping[str, float | None] = field(default_factory=dict)
    interval: Mapping[str, Ends] = field(default_factory=dict)
    bias: Mapping[str, float | None] = field(default_factory=dict)
    limits: Mapping[str, Ends] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    null: Mapping[str, float | None] = field(default_factory=dict)


@dataclass(frozen=True)
class PredictionResult:
    """Reduction of chi-square on left-out data with its standard error, and chi-square there without the cause."""

    reduction: float | None = None
    error: float | None = None
    without: float | None = None


@dataclass(frozen=True)
class RoundResult:
    """A round of the search: the effect that was added to the model, or why none was.

    Attributes
    ----------
    threshold : of |z|
    chosen : name of the effect that was added, None where none was
    share : of the excess chi-square that it explains  [1]
    rivals : names of the effects that are indistinguishable from it, itself included
    prediction : of left-out data
    rejected, rejection : the effect that explains most where none was added, and why it was not
    cosines : rival -> cosine of the angle between its signature and that of the chosen effect  [1]
    """

    threshold: float
    chosen: str | None = None
    share: float | None = None
    rivals: tuple[str, ...] = ()
    prediction: PredictionResult | None = None
    rejected: str | None = None
    rejection: str = ""
    cosines: Mapping[str, float | None] = field(default_factory=dict)


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
    share: float
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
    """Whether an effect has the same size everywhere: normal deviate z, and relative variation of the size  [1]."""

    effect: str
    z: float
    variation: float
    among: str | None = None


@dataclass(frozen=True)
class ChannelResult:
    """A channel that is compared."""

    record: str
    body: str
    channel: str


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

    excess_chi2: float = 0.0
    remaining_chi2: float = 0.0
    chi2_std: float = 1.0
    share: float = 0.0
    heterogeneity_z: float | None = None
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

    `held` says whether the record was held out; `bias` is the standard deviation of what the model leaves there.
    """

    record: str
    parameter: str
    size: float | None = None
    error: float | None = None
    held: bool = False
    bias: float | None = None
    half_width: float | None = None


@dataclass(frozen=True)
class AgreementResult:
    """Whether the records agree on the size of a parameter: chi-square, degrees of freedom, normal deviate."""

    parameter: str
    chi2: float
    degrees: int
    z: float
    agree: bool


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
    failed : record -> why it could not be simulated
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
    transfers: tuple[TransferResult, ...] = ()
    agreements: tuple[AgreementResult, ...] = ()
    shifts: tuple[ShiftResult, ...] = ()


@dataclass(frozen=True)
class DesignPointResult:
    """A measurement that was simulated, and the predicted separation z of the two least distinguishable models.

    Amplitudes are in the unit of the excitation, frequencies in Hz, displacements of release in m.
    """

    test: str
    stage: str
    status: str
    amplitude: float | None = None
    frequency: float | None = None
    release: float | None = None
    impacts: bool | None = None
    z: float | None = None


@dataclass(frozen=True)
class DesignVariableResult:
    """A setting of the next measurement with its bounds, stated in the study file or derived from the records."""

    name: str
    unit: str
    low: float
    high: float
    stated: bool = False


@dataclass(frozen=True)
class RecordSetting:
    """Amplitude and frequency [Hz] of the excitation of a record that exists."""

    record: str
    amplitude: float | None = None
    frequency: float | None = None


@dataclass(frozen=True)
class DesignResult:
    """The search for a next measurement: its models, variables, simulated points, and what it cost."""

    models: tuple[str, ...] = ()
    variables: tuple[DesignVariableResult, ...] = ()
    points: tuple[DesignPointResult, ...] = ()
    unavailable: Mapping[str, str] = field(default_factory=dict)
    known: tuple[RecordSetting, ...] = ()
    simulations: int = 0
    max_simulations: int = 0
    decisive_z: float = 3.0


@dataclass(frozen=True)
class MeasurementResult:
    """The best measurement of a kind of test.

    `z` and `z_max` are the predicted separations of the two least and the two most distinguishable models, `z_refit`
    that of the two least from simulations at refitted parameters; `channel` names one that would be measured too.
    """

    kind: str
    description: str
    prediction: str = ""
    channel: str = ""
    amplitude: float | None = None
    frequency: float | None = None
    release: float | None = None
    z: float = 0.0
    z_max: float = 0.0
    z_refit: float | None = None
    confirmed: bool = False


def setting_of(measurement: DesignPointResult | MeasurementResult, name: str) -> float:
    """Return the "amplitude", "frequency" or "release" of a measurement that has one.

    Raises
    ------
    CalibError : it has none
    """
    settings = {"amplitude": measurement.amplitude, "frequency": measurement.frequency, "release": measurement.release}
    value = settings[name]
    if value is None:
        raise CalibError(f"diagnosis.json: a measurement that needs a {name} has none; run `calib diagnose` again")
    return value


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
    rounding : share of the noise of a channel that is quantisation  [1]
    misfit : None where the records could not be compared
    joint_sizes : cause -> its sizes
    gain : None where nothing was added to the model
    measurements, design : best next measurements, and the search for them
    threshold : of |z| in the first round
    simulations, seconds : cost; wall-clock time  [s]
    values : calibrated values that were diagnosed
    """

    verdict: str
    summary: str = ""
    causes: tuple[str, ...] = ()
    classes: tuple[tuple[str, ...], ...] = ()
    stand_ins: tuple[str, ...] = ()
    remainder: RemainderResult | None = None
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
    joint_sizes: Mapping[str, JointSize] = field(default_factory=dict)
    gain: GainResult | None = None
    measurements: tuple[MeasurementResult, ...] = ()
    design: DesignResult | None = None
    threshold: float | None = None
    simulations: int = 0
    seconds: float = 0.0
    values: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> "DiagnosisResult":
        """Return the diagnosis that the object of diagnosis.json describes; what it does not say takes its default.

        Raises
        ------
        ValueError : the object is no diagnosis
        """
        fields = _renamed(document, {"summary": "said", "classes": "class", "remainder": "remains"})
        if isinstance(document, Mapping):
            fields["gates"] = _each_renamed(document.get("gates"), {"summary": "said"})
            fields["suspects"] = _each_renamed(document.get("suspects"), {"chi2_reduction": "drop", "cosine": "alike"})
            fields["rounds"] = _each_renamed(document.get("rounds"), {"cosines": "alike"})
            fields["misfit"] = _renamed(document.get("misfit") or None, MISFIT_KEYS)
        return typed(cls, fields)


def _renamed(entry: Any, keys: Mapping[str, str]) -> Any:
    """Return a JSON object with its fields by the names that they have here (field -> key), another value as it is."""
    return {**entry, **{field: entry.get(key) for field, key in keys.items()}} if isinstance(entry, Mapping) else entry


def _each_renamed(entries: Any, keys: Mapping[str, str]) -> Any:
    return [_renamed(entry, keys) for entry in entries] if isinstance(entries, list | tuple) else entries
