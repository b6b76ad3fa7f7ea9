"""The next measurement in diagnosis.json, and the search for it; fields in the order of its keys."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from calib.errors import CalibError


@dataclass(frozen=True, kw_only=True)
class SettingsResult:
    """Settings of a test: amplitude in the unit of the excitation, frequencies in Hz, displacement of release in m."""

    test: str
    amplitude: float | None = None
    frequency: float | None = None
    end_frequency: float | None = None
    release: float | None = None


@dataclass(frozen=True, kw_only=True)
class DesignPointResult(SettingsResult):
    """A measurement that was simulated; `calib.diagnosis.measurement.EvaluatedPoint` says what each field is.

    `z` is the predicted separation of the two least distinguishable models, `z_max` that of the two most
    distinguishable.
    """

    stage: str
    status: str
    reason: str = ""
    impacts: bool | None = None
    z: float | None = None
    z_max: float | None = None


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

    record: str = ""
    models: tuple[str, ...] = ()
    variables: tuple[DesignVariableResult, ...] = ()
    unavailable: Mapping[str, str] = field(default_factory=dict)
    known: tuple[RecordSetting, ...] = ()
    simulations: int = 0
    max_simulations: int = 0
    points: tuple[DesignPointResult, ...] = ()
    decisive_z: float = 3.0


@dataclass(frozen=True, kw_only=True)
class MeasurementResult(SettingsResult):
    """The best measurement of a kind of test; `calib.diagnosis.measurement.Measurement` says what each field is.

    `z` and `z_max` are the predicted separations of the two least and the two most distinguishable models, `z_refit`
    that of the two least from simulations at refitted parameters; `channel` names one that would be measured too.
    """

    test: str = ""
    kind: str
    description: str
    record: str = ""
    channel: str = ""
    impacts: bool | None = None
    distinguished: int = 0
    pairs: int = 0
    unchecked: int = 0
    z: float = 0.0
    z_max: float = 0.0
    z_refit: float | None = None
    confirmed: bool = False
    prediction: str = ""


def setting_of(measurement: SettingsResult, name: str) -> float:
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
