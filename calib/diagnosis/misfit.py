"""The misfit of the calibrated model: deviations of features, and residuals by channel."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.diagnosis.bench import Bench, Run, SimulatedRows, simulated
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.fit import Fit
from calib.diagnosis.part import Part
from calib.objective import FeatureValue
from calib.records.cycles import harmonics, mean_cycle
from calib.study import Pool

FEATURE_DRAWS = 40  # for the standard errors of the features  [count]
MAX_HARMONIC = 12  # order of the residual's harmonics  [1]


@dataclass(frozen=True)
class Deviation:
    """A scalar feature, measured and simulated.

    Attributes
    ----------
    label, record, body, unit : name of the feature, of which record and body, in which unit
    measured, simulated, error : values, and the standard error of the measured one by the noise; simulated None where
        the simulation has no such feature
    z : predicted value, noise and sampling included, less the measured one, in standard errors; None where
        one of the three is missing
    """

    label: str
    record: str
    body: str
    unit: str
    measured: float
    simulated: float | None
    error: float
    z: float | None


@dataclass(frozen=True, eq=False)
class ChannelMisfit:
    """The residual of one channel of a body in one record.

    Attributes
    ----------
    record, body, channel : whose
    rms, noise : root mean square of measured less simulated, and of the noise  [unit of the channel]
    orders : (MAX_HARMONIC + 1,) amplitude of the residual's harmonics, 0 the mean; empty without a period
    floor : amplitude of noise on average
    """

    record: str
    body: str
    channel: str
    rms: float
    noise: float
    orders: np.ndarray
    floor: float


@dataclass(frozen=True, eq=False)
class Misfit:
    """The misfit of the calibrated model.

    Attributes
    ----------
    features : of all records, those with the largest |z| first
    channels : of all records
    """

    features: tuple[Deviation, ...]
    channels: tuple[ChannelMisfit, ...]


def misfit(pool: Pool, bench: Bench, evidence: Evidence, null: Fit, seed: int) -> Misfit:
    """Compare the calibrated model with the records, feature by feature and channel by channel."""
    runs = [Run(name, null.point.values) for name in evidence.names]
    views = dict(zip(evidence.names, simulated(pool, runs), strict=True))
    rng = np.random.default_rng(seed)
    features = [d for part in evidence.parts for d in feature_deviations(bench, part, views[part.name], rng)]
    features.sort(key=lambda deviation: -abs(deviation.z or 0.0))
    channels = [c for part in evidence.parts for c in _channels(part, null.point.simulated[part.name])]
    return Misfit(tuple(features), tuple(channels))


def feature_deviations(bench: Bench, part: Part, view: SimulatedRows, rng: np.random.Generator) -> list[Deviation]:
    """Deviations of the features of a record from those that the model predicts, noise and sampling included.

    Noise is added to the simulation at the record's own instants, and features are evaluated as of the record. Their
    mean is the prediction of the measured value - noise increases a magnitude, sampling misses a peak between two
    samples in both - and their standard deviation its standard error. Those of a frequency response are known as its
    points are.

    Parameters
    ----------
    view : simulated, with its features
    """
    if part.is_swept:
        return [_of_points(feature) for feature in view.features]
    record = bench.objective.references[part.name].record
    bodies = [str(body) for body in record.body.values]
    drawn: dict[tuple[str, str], list[float]] = {}
    for _ in range(FEATURE_DRAWS):
        predicted = record.copy(deep=True)
        for (body, channel), noise, row in zip(part.rows, part.noise, view.rows, strict=True):
            predicted[channel].values[bodies.index(body)] = row + noise.drawn(rng, part.time.size)
        for feature in bench.objective.features(part.name, predicted):
            if feature.simulated is not None:
                drawn.setdefault((feature.label, feature.body), []).append(feature.simulated - feature.measured)
    return [_deviation(feature, drawn.get((feature.label, feature.body), [])) for feature in view.features]


def _deviation(feature: FeatureValue, differences: Sequence[float]) -> Deviation:
    """Compare a feature by the differences of draws of its prediction from the measured value."""
    error = math.hypot(np.std(differences), feature.resolution) if len(differences) > FEATURE_DRAWS // 2 else np.nan
    z = float(np.mean(differences)) / error if feature.simulated is not None and error > 0.0 else None
    return Deviation(
        feature.label, feature.record, feature.body, feature.unit, feature.measured, feature.simulated, error, z
    )


def _of_points(feature: FeatureValue) -> Deviation:
    """Compare a feature of a frequency response, which is known as its points are."""
    apart, error = None if feature.simulated is None else feature.simulated - feature.measured, feature.resolution
    return Deviation(
        feature.label, feature.record, feature.body, feature.unit, feature.measured, feature.simulated, error,
        None if apart is None or not error > 0.0 else apart / error,
    )  # fmt: skip


def _channels(part: Part, view: SimulatedRows) -> list[ChannelMisfit]:
    """Residuals of the channels of a record that are compared."""
    channels = []
    for index, ((body, channel), noise) in enumerate(zip(part.rows, part.noise, strict=True)):
        if not part.used[index].any():
            continue
        residual = part.measured[index] - view.rows[index]
        weight = part.weight[index]
        orders, floor = np.zeros(0), 0.0
        if part.period is not None:
            loop = mean_cycle(part.time, (residual * weight)[None], part.period).loop[0]
            orders = np.concatenate([[abs(loop.mean())], np.abs(harmonics(loop, MAX_HARMONIC))])
            floor = float(noise.sigma * np.sqrt(2.0 / part.time.size))
        rms = float(np.sqrt(((residual * weight) ** 2).sum() / max(1.0, (weight**2).sum())))
        channels.append(ChannelMisfit(part.name, body, channel, rms, noise.sigma, orders, floor))
    return channels
