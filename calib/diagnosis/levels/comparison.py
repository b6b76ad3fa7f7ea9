"""Comparison of frequency responses with models, level by level."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.diagnosis.bench import Bench, Run, simulated
from calib.diagnosis.effort import Effort
from calib.diagnosis.levels.document import (
    DampingTrendResult,
    LawTrendResult,
    LevelsResult,
    PeakResult,
    ResonanceTrendResult,
    SweepPeakResult,
)
from calib.diagnosis.levels.laws import law_trends
from calib.diagnosis.levels.peak import MIN_PEAK_POINTS, Peak, peak
from calib.diagnosis.levels.trend import damping_trend, resonance_trend
from calib.diagnosis.part import Part
from calib.diagnosis.selection import Selection
from calib.diagnosis.signature import Point
from calib.objective import Reference, gross_errors
from calib.records.held_response import is_held
from calib.records.replicates import levels_of_sweeps
from calib.records.response import HELD_AMPLITUDE, PARTS, complex_amplitude, sweeps, tolerances

CALIBRATED, EXTENDED = "calibrated", "extended"  # models, beside rivals by their names
MAX_COMPARED_RIVALS = 2  # that are simulated again, of those whose fits are known  [count]
MIN_TREND_LEVELS = 3  # that a trend needs: a line through two has no contradiction  [count]


@dataclass(frozen=True, eq=False)
class LevelledResponse:
    """A frequency response of several levels, as the body with the largest amplitude has it.

    Attributes
    ----------
    reference, part : the record, and as a diagnosis compares it
    gross : indices of its points that are gross errors, which no peak is read from
    """

    reference: Reference
    part: Part
    gross: np.ndarray

    @cached_property
    def body(self) -> int:
        """Number of the body with the largest amplitude, of those that are compared."""
        names = [str(name) for name in self.reference.record.body.values]
        compared = {body for (body, _), used in zip(self.part.rows, self.part.used, strict=True) if used.any()}
        largest = np.delete(np.abs(complex_amplitude(self.reference.record)), self.gross, axis=1).max(axis=1)
        return int(np.argmax([size if name in compared else 0.0 for name, size in zip(names, largest, strict=True)]))

    @property
    def name(self) -> str:
        """Name of that body."""
        return str(self.reference.record.body.values[self.body])

    @property
    def held(self) -> bool:
        """Whether its levels are amplitudes that were held."""
        return is_held(self.reference.record)

    @cached_property
    def points(self) -> dict[float, np.ndarray]:
        """Points of each sweep that is long enough for a peak."""
        own = {number: np.setdiff1d(points, self.gross) for number, points in sweeps(self.reference.record)}
        return {number: points for number, points in own.items() if points.size >= MIN_PEAK_POINTS}

    @cached_property
    def level(self) -> dict[float, float]:
        """Level of each sweep  [unit of the levels, or m where they were held]."""
        own = self.reference.record[HELD_AMPLITUDE if self.held else "level"].values
        return {number: float(np.median(own[points])) for number, points in self.points.items()}

    @cached_property
    def group(self) -> dict[float, int]:
        """Number of the level of each sweep."""
        groups = levels_of_sweeps(self.reference.record)
        return {number: int(groups[points[0]]) for number, points in self.points.items()}

    def peaks(self, amplitude: np.ndarray) -> dict[float, Peak]:
        """Peak of the receptance of each sweep, of complex amplitudes (point,) of the body at the measured points."""
        record, own = self.reference.record, [(self.name, part) for part in PARTS]
        rows = [k for k, row in enumerate(self.part.rows) if row in own]
        noises = [self.part.noise[k] for k in rows if self.part.used[k].any()]
        ratio = np.sqrt(np.mean([(noise.sigma * noise.profile * np.ones(amplitude.size)) ** 2 for noise in noises], 0))
        of_frequency, of_parts = tolerances(record)
        level, found = record["level"].values, {}
        for number, points in self.points.items():
            correlation = np.mean([noise.autocorrelation(points.size) for noise in noises], axis=0)
            found[number] = peak(
                record["frequency"].values[points],
                np.abs(amplitude[points]) / level[points],
                (ratio * of_parts[self.body])[points] / level[points],
                (ratio * of_frequency)[points],
                correlation,
            )
        return found

    @cached_property
    def measured(self) -> dict[float, Peak]:
        """Peak of each measured sweep."""
        return self.peaks(complex_amplitude(self.reference.record)[self.body])

    def amplitude(self, number: float, own: Peak) -> float:
        """Amplitude of the body at a peak of a sweep  [m]."""
        record = self.reference.record
        return own.receptance * float(np.median(record["level"].values[self.points[number]]))


def compared_levels(
    pool: Effort, bench: Bench, parts: Sequence[Part], selection: Selection
) -> tuple[LevelsResult, ...]:
    """Compare frequency responses of several levels with the calibrated model, the extended one, and rivals.

    Simulated once more with each: where the curves of a fit are known, beside these. Where the budget does not suffice
    for that, only what was measured is told.
    """
    several = [
        one
        for one in (_levelled(part, bench, selection) for part in parts if part.is_swept)
        if len(set(one.group.values())) > 1
    ]
    models = _models(selection)
    models = models if pool.left >= len(models) * len(several) else {}
    runs = [
        Run(one.part.name, point.values, point.effects, sweeps=point.simulated[one.part.name].sweeps,
            stepped=one.reference.record)
        for one in several
        for point in models.values()
    ]  # fmt: skip
    views = iter(simulated(pool, runs))
    found = []
    for one in several:
        read = {name: next(views).read for name in models}
        known = {name: one.peaks(own[0, one.body]) for name, own in read.items() if own.shape[-1]}
        found.append(_result(one, known, bench, selection))
    return tuple(found)


def _levelled(part: Part, bench: Bench, selection: Selection) -> LevelledResponse:
    gross = gross_errors(selection.final.point.simulated[part.name].trust)
    return LevelledResponse(bench.objective.references[part.name], part, gross)


def _models(selection: Selection) -> dict[str, Point]:
    """Points of the models: the calibrated one, the extended one, and the best rivals whose fits are known."""
    models = {CALIBRATED: selection.null.point}
    if selection.causes:
        models[EXTENDED] = selection.final.point
    rivals = [(rival.name, rival.fit.point) for rival in selection.runners_up[:MAX_COMPARED_RIVALS]]
    return models | dict(rivals)


def _result(
    one: LevelledResponse, models: Mapping[str, Mapping[float, Peak]], bench: Bench, selection: Selection
) -> LevelsResult:
    sweep_peaks = tuple(
        SweepPeakResult(
            number, one.level[number], one.amplitude(number, own), own.frequency,
            one.amplitude(number, own) * own.relative_error, own.frequency_error, own.resolved,
            {
                name: PeakResult(one.amplitude(number, peaks[number]), peaks[number].frequency)
                for name, peaks in models.items()
            },
        )
        for number, own in one.measured.items()
    )  # fmt: skip
    record = one.reference.record
    return LevelsResult(
        record=one.part.name,
        body=one.name,
        held=one.held,
        unit="m" if one.held else str(record["level"].attrs["units"]),
        sweeps=sweep_peaks,
        damping=_damping(one, models),
        resonance=_resonance(one, models),
        laws=_laws(one, sweep_peaks, bench, selection),
    )


def _damping(one: LevelledResponse, models: Mapping[str, Mapping[float, Peak]]) -> DampingTrendResult | None:
    """Trend of the equivalent damping over the sweeps that pass their peaks."""
    numbers = [number for number, own in one.measured.items() if own.resolved]
    group = [one.group[number] for number in numbers]
    if len(set(group)) < MIN_TREND_LEVELS:
        return None
    level, powers = [one.level[number] for number in numbers], {}
    for name, peaks in models.items():
        own = [peaks[number] for number in numbers]
        trend = damping_trend(level, own, group, one.held) if all(p.resolved for p in own) else None
        powers[name] = None if trend is None else trend.slope
    measured = damping_trend(level, [one.measured[number] for number in numbers], group, one.held)
    if measured is None:
        return None
    return DampingTrendResult(measured.slope, measured.error, measured.significant, powers)


def _resonance(one: LevelledResponse, models: Mapping[str, Mapping[float, Peak]]) -> ResonanceTrendResult | None:
    """Trend of the frequency of the largest amplitude over all sweeps."""
    group, level = list(one.group.values()), list(one.level.values())
    if len(set(group)) < MIN_TREND_LEVELS:
        return None
    measured = resonance_trend(level, list(one.measured.values()), group)
    changes = {name: resonance_trend(level, list(peaks.values()), group).slope for name, peaks in models.items()}
    return ResonanceTrendResult(measured.slope, measured.error, measured.significant, changes)


def _laws(
    one: LevelledResponse, own: Sequence[SweepPeakResult], bench: Bench, selection: Selection
) -> tuple[LawTrendResult, ...]:
    visited = [s.level if one.held else s.amplitude for s in own]
    amplitude = np.array([min(visited), max(visited)])
    if not amplitude[1] > amplitude[0] > 0.0:
        return ()
    omega = 2.0 * math.pi * float(np.median([s.frequency for s in own]))
    return law_trends(bench.model, selection, one.part.name, one.name, amplitude, omega)
