"""Frequency responses over their levels: the objects of the key `levels` of diagnosis.json."""

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class PeakResult:
    """Largest amplitude of the body in a sweep as a model has it [m], and its frequency  [Hz]."""

    amplitude: float
    frequency: float


@dataclass(frozen=True)
class SweepPeakResult:
    """Largest amplitude of the body in one measured sweep, and that of models.

    Attributes
    ----------
    sweep : number
    level : of the excitation [its unit]; of sweeps at a held amplitude that [m]
    amplitude, frequency : measured  [m], [Hz]; of sweeps at a held amplitude as the record has it, at one level
    amplitude_error, frequency_error : their standard errors  [m], [Hz]
    resolved : whether the sweep passes the peak, and does not end or jump at it
    models : "calibrated", "extended" or the name of a rival -> its peak
    """

    sweep: float
    level: float
    amplitude: float
    frequency: float
    amplitude_error: float
    frequency_error: float
    resolved: bool
    models: Mapping[str, PeakResult] = field(default_factory=dict)


@dataclass(frozen=True)
class DampingTrendResult:
    """Power of the amplitude that the equivalent damping goes with over the levels, and its standard error  [1].

    `models` has that of each model, None where one of its peaks is not resolved.
    """

    power: float
    error: float
    significant: bool
    models: Mapping[str, float | None] = field(default_factory=dict)


@dataclass(frozen=True)
class ResonanceTrendResult:
    """Change of the resonance frequency from the least to the greatest level, and its standard error  [Hz]."""

    change: float
    error: float
    significant: bool
    models: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class LawTrendResult:
    """Equivalent damping and stiffness of the force law of an effect between the least and the greatest amplitude.

    Attributes
    ----------
    effect : name
    cause : whether it is in the extended model
    damping_power : of the amplitude; None where the law has no equivalent damping, or one that changes its sign  [1]
    damping_change, stiffness_change : 1 where it rises with the amplitude, -1 where it falls, 0 where it does not
        change; None where that depends on the sign of a size that is not known
    """

    effect: str
    cause: bool
    damping_power: float | None
    damping_change: int | None
    stiffness_change: int | None


@dataclass(frozen=True)
class LevelsResult:
    """A frequency response of several levels.

    Attributes
    ----------
    record, body : whose body has the largest amplitude
    held : whether a level is an amplitude that was held
    unit : of the levels
    sweeps : in the order measured
    damping, resonance : trends over the levels; None where there are fewer than three
    laws : of the causes, then of other effects with a significant score test
    """

    record: str
    body: str
    held: bool
    unit: str
    sweeps: tuple[SweepPeakResult, ...] = ()
    damping: DampingTrendResult | None = None
    resonance: ResonanceTrendResult | None = None
    laws: tuple[LawTrendResult, ...] = ()
