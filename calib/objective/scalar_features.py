"""Scalar features of a measured and a simulated record, with the difference that matters."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calib.records.cycles import harmonics, impact, mean_cycle
from calib.records.cycles.impacts import PULSE_FOOT

RELATIVE_TOLERANCE = 0.02  # of the measured value  [1]
PHASE_TOLERANCE = 0.01  # of an impact, in periods
MIN_HARMONIC_TOLERANCE = 0.005  # over the fundamental  [1]


@dataclass(frozen=True)
class FeatureValue:
    """One number that was measured and simulated.

    Attributes
    ----------
    label, record, body, unit : what, of which record and body, in which unit
    measured, simulated : values; simulated is None where the simulation does not show the feature (no impact)  [unit]
    tolerance : 2 % of the measured value, or twice its standard uncertainty where that is more  [unit]
    resolution : standard uncertainty of a difference due to sampling, the same for both records  [unit]
    """

    label: str
    record: str
    body: str
    unit: str
    measured: float
    simulated: float | None
    tolerance: float
    resolution: float = 0.0


@dataclass(frozen=True)
class Scalar:
    """A number with its unit, its least significant difference, and the full turn of an angle.

    resolution : standard uncertainty of a difference between two such numbers that finite sampling leaves  [unit]
    """

    value: float
    unit: str
    floor: float = 0.0
    turn: float | None = None
    resolution: float = 0.0

    @property
    def tolerance(self) -> float:
        """2 % of the value or the floor; of an angle the floor, for its zero is arbitrary."""
        return self.floor if self.turn else max(RELATIVE_TOLERANCE * abs(self.value), self.floor)

    def near(self, other: float) -> float:
        """Return `other`; of an angle, plus whole turns so that it is nearest to this one."""
        if self.turn is None:
            return other
        return other - self.turn * round((other - self.value) / self.turn)


def scalars(
    time: np.ndarray,
    values: Mapping[str, np.ndarray],
    units: Mapping[str, str],
    period: float | None,
    sigmas: Mapping[str, float],
) -> dict[str, Scalar]:
    """Scalar features of one body, by label; those that are absent in the record are left out.

    With a period: amplitude of each channel (half peak to peak of the mean loop), second and third harmonic over the
    fundamental, and phase, velocity change and contact time of the strongest impact. Without: amplitude (half peak to
    peak) and root mean square about its mean of each channel.

    Parameters
    ----------
    time : (n,)  [s]
    values : channel -> (n,)
    units : channel -> unit
    period : of the excitation  [s], None without one
    sigmas : channel -> standard uncertainty of a sample
    """
    features = {}
    for channel, row in values.items():
        sigma, unit = sigmas.get(channel, 0.0), units[channel]
        if period is None:
            features[f"{channel} amplitude"] = Scalar(0.5 * float(np.ptp(row)), unit, 2.0 * sigma)
            features[f"{channel} rms"] = Scalar(float(np.std(row)), unit, 2.0 * sigma / np.sqrt(row.size))
            continue
        mean = mean_cycle(time, row[None], period)
        loop, sigma = mean.loop[0], sigma / np.sqrt(mean.cycles)
        features[f"{channel} amplitude"] = Scalar(0.5 * float(np.ptp(loop)), unit, 2.0 * sigma)
        features |= _harmonics(channel, loop, sigma)
        if channel == "velocity":
            features |= _impact(mean.phase, loop, sigma)
    return features


def _harmonics(channel: str, loop: np.ndarray, sigma: float) -> dict[str, Scalar]:
    if loop.size < 8:
        return {}
    size = np.abs(harmonics(loop, 3))
    if not size[0] > 0.0:
        return {}
    floor = max(MIN_HARMONIC_TOLERANCE, 2.0 * sigma * np.sqrt(2.0 / loop.size) / size[0])
    names = {1: "second", 2: "third"}
    return {f"{name} harmonic of {channel}": Scalar(float(size[i] / size[0]), "1", floor) for i, name in names.items()}


def _impact(phase: np.ndarray, loop: np.ndarray, sigma: float) -> dict[str, Scalar]:
    at, change, contact = impact(phase, loop)
    if np.isnan(at):
        return {}
    sampling = float(phase[1] - phase[0]) / np.sqrt(6.0)  # of a difference of two instants known to a sample each
    return {
        "impact phase": Scalar(at, "1", PHASE_TOLERANCE, turn=1.0, resolution=sampling),
        "velocity change at impact": Scalar(change, "m/s", 4.0 * sigma, resolution=PULSE_FOOT * abs(change)),
        "contact time": Scalar(contact, "1", float(phase[1] - phase[0]), resolution=sampling),
    }


def compared(
    record: str, body: str, measured: Mapping[str, Scalar], simulated: Mapping[str, Scalar]
) -> Sequence[FeatureValue]:
    """Pair each measured scalar with the simulated one."""
    return [
        FeatureValue(
            label=label,
            record=record,
            body=body,
            unit=scalar.unit,
            measured=scalar.value,
            simulated=scalar.near(simulated[label].value) if label in simulated else None,
            tolerance=scalar.tolerance,
            resolution=scalar.resolution,
        )
        for label, scalar in measured.items()
    ]
