"""The chapter of a page that says how sure the calibrated values are: intervals, profiles, what differs and why."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import xarray as xr

from calib.confidence.document import (
    AT_LIMIT,
    ComparedModelResult,
    ComparisonResult,
    ConfidenceResult,
    EndResult,
    MarginalResult,
    ModeResult,
    PosteriorResult,
    PredictedRecordResult,
    ProfileResult,
)
from calib.confidence.profile import WINDOW_END
from calib.records import is_response
from calib.report.formatting import capitalised
from calib.report.pages.diagnosis.conclusion import MAX_RELATIVE_CHANGE
from calib.report.pages.picture import Picture
from calib.report.plots.predictive import predictive_of_record
from calib.report.plots.profiles import profiles_figure
from calib.study import CalibrationResult
from calib.units import count, plain_number, reading, shown

PROFILES = (
    "Likelihood-ratio statistic (twice the fall of the log-likelihood from its best value) over each parameter, all "
    "others searched again. Where it crosses the quantile the interval ends; the parabola is what the curvature at the "
    "best value alone says."
)
PREDICTED = (
    "phase curves, and channels less their medians over time. Bands hold 50 % and 95 % of the curves of the posterior "
    "distribution (orange) and of samples with noise (blue); that of a phase curve is taken across it. Velocities "
    "beside an impact have no band."
)
PREDICTED_RESPONSE = (
    "amplitudes over frequency, and less their medians. Bands hold 95 % of the curves of the posterior distribution "
    "(dark) and of readings with noise (light), in the colour of the level. A point that too few draws reach has none."
)
PAIRS = " Of two parameters: the region of the joint quantile, and that of a quarter of it."


@dataclass(frozen=True)
class IntervalRow:
    """The intervals of one parameter."""

    name: str
    value: str
    profile: str
    local: str
    posterior: str
    text: str


@dataclass(frozen=True)
class MarginalRow:
    """The posterior distribution of one parameter."""

    name: str
    mean: str
    deviation: str
    interval: str
    prior: str


@dataclass(frozen=True)
class PredictedRow:
    """A channel beside what the posterior distribution predicts of it."""

    record: str
    held_out: bool
    body: str
    channel: str
    inside: str
    noise: str
    source: str


@dataclass(frozen=True)
class ModelRow:
    """A model beside others, by its evidence."""

    name: str
    effects: str
    likelihood: str
    evidence: str
    factor: str


@dataclass(frozen=True)
class ConfidenceChapter:
    """Everything that a page shows of the profiles, in the order of the page."""

    stale: bool
    rows: tuple[IntervalRow, ...]
    posterior: bool
    caption: str
    remarks: tuple[str, ...]
    picture: Picture | None
    effort: str
    marginals: tuple[MarginalRow, ...]
    sampling: str
    sampling_remarks: tuple[str, ...]
    confirmed: str
    predicted: tuple[PredictedRow, ...]
    prediction_remarks: tuple[str, ...]
    predictions: tuple[Picture, ...]
    models: tuple[ModelRow, ...]
    model_remarks: tuple[str, ...]


def confidence_chapter(
    confidence: ConfidenceResult, result: CalibrationResult, bands: Mapping[str, xr.Dataset]
) -> ConfidenceChapter:
    """Everything that a page shows of the profiles.

    Parameters
    ----------
    result : of the calibration as it is now
    bands : of the records that the posterior distribution predicts, by name
    """
    then, now = confidence.calibrated, result.values
    stale = any(n in then and not math.isclose(then[n], x, rel_tol=MAX_RELATIVE_CHANGE) for n, x in now.items())
    posterior = confidence.posterior
    sampled = {} if posterior is None else {own.name: own for own in posterior.parameters}
    predicted = () if posterior is None else posterior.predicted
    rows = [
        IntervalRow(
            profile.name,
            shown(profile.value, profile.unit),
            f"{_end(profile, profile.low)} .. {_end(profile, profile.high)}",
            "" if profile.local is None else _interval(profile, *profile.local),
            _interval(profile, sampled[profile.name].low, sampled[profile.name].high) if sampled else "",
            profile.text,
        )
        for profile in confidence.profiles
    ]
    return ConfidenceChapter(
        stale=stale,
        rows=tuple(rows),
        posterior=bool(sampled),
        caption=f"{confidence.level:.1%} intervals. {capitalised(confidence.noise)}.",
        remarks=tuple(map(capitalised, confidence.remarks)),
        picture=Picture(profiles_figure(confidence), "profiles", PROFILES + (PAIRS if confidence.pairs else ""))
        if confidence.profiles
        else None,
        effort=f"{count(confidence.evaluations, 'evaluation')} of the calibrated records",
        marginals=() if posterior is None else tuple(map(_marginal, posterior.parameters)),
        sampling="" if posterior is None else _sampling(confidence.level, posterior),
        sampling_remarks=() if posterior is None else tuple(map(capitalised, sampling_remarks(posterior))),
        confirmed="" if posterior is None or posterior.confirmed is None else posterior.confirmed.text,
        predicted=tuple(row for record in predicted for row in _predicted(record)),
        prediction_remarks=tuple(text for record in predicted for text in prediction_remarks(record)),
        predictions=tuple(
            Picture(predictive_of_record(own), f"predicted-{name}", f"{name}: {_caption(own)}")
            for name, own in bands.items()
        ),
        models=() if confidence.comparison is None else tuple(map(_model, confidence.comparison.models)),
        model_remarks=() if confidence.comparison is None else tuple(comparison_remarks(confidence.comparison)),
    )


def comparison_remarks(comparison: ComparisonResult) -> list[str]:
    """What the evidence of models says, a sentence each, without its full stop."""
    return [
        *(f"{own.name}: {own.text}" for own in comparison.models if own.text),
        f"noise of all models: the residuals of {comparison.noise}",
        comparison.diagnosis,
    ]


def _model(own: ComparedModelResult) -> ModelRow:
    return ModelRow(
        own.name, ", ".join(own.effects) or "-", f"{own.log_likelihood:.2f}",
        f"{own.log_evidence:.2f} ± {own.log_evidence_error:.2f}",
        f"{own.factor:+.2f} ± {own.factor_error:.2f}" if own.text else "-",
    )  # fmt: skip


def prediction_remarks(record: PredictedRecordResult) -> list[str]:
    """What to mind of a record that the posterior distribution predicts, a sentence each, without its full stop."""
    if record.reason:
        return [f"{record.name} is not predicted: {record.reason}"]
    remarks = []
    if record.failed:
        remarks.append(f"{record.name}: {record.failed} of {count(record.draws, 'draw')} fail and are left out")
    if record.other_kind:
        remarks.append(
            f"{record.name}: the motion of {record.other_kind} of {count(record.draws, 'draw')} is of another kind "
            "than measured"
        )
    if record.unreached:
        remarks.append(
            f"{record.name}: {record.unreached:.2%} of its points, over all draws, are reached by no stable motion, "
            "and are left out of the bands"
        )
    if record.points_without_band:
        remarks.append(
            f"{record.name}: {count(record.points_without_band, 'point')} that too few draws reach have no band and do "
            "not count"
        )
    if record.samples_left_out:
        remarks.append(f"{record.name}: its last {count(record.samples_left_out, 'sample')} are not predicted")
    if record.bodies_left_out:
        remarks.append(f"{record.name}: bodies that are not predicted: {record.bodies_left_out}")
    return remarks


def _caption(bands: xr.Dataset) -> str:
    return PREDICTED_RESPONSE if is_response(bands) else PREDICTED


def _marginal(own: MarginalResult) -> MarginalRow:
    factor, unit = reading(own.unit, own.mean)
    deviation = f"{plain_number(factor * own.standard_deviation, 2)} {unit}".rstrip()
    interval = f"{shown(own.low, own.unit)} .. {shown(own.high, own.unit)}"
    return MarginalRow(own.name, shown(own.mean, own.unit), deviation, interval, own.prior)


def _sampling(level: float, own: PosteriorResult) -> str:
    return (
        f"{level:.1%} intervals of equal tails. Effective sample size {own.effective_size:.0f}, from "
        f"{count(own.evaluations, 'evaluation')}. Logarithm of the evidence over the likelihood of the best point: "
        f"{own.log_evidence:.2f} ± {own.log_evidence_error:.2f}."
    )


def sampling_remarks(own: PosteriorResult) -> list[str]:
    """What to mind of a posterior distribution, a sentence each, without its full stop."""
    remarks = []
    if own.status == AT_LIMIT:
        remarks.append(
            f"the sampling ended at its limit, after {count(own.evaluations, 'evaluation')}, with an effective sample "
            f"size of {own.effective_size:.0f}: the likelihood may have a plateau; parts of the distribution, and of "
            "its evidence, may be missing"
        )
    if own.modes:
        parts = "; ".join(f"{100.0 * mode.share:.0f} % with {_mode(own, mode)}" for mode in own.modes)
        remarks.append(
            f"the posterior distribution has {len(own.modes)} separate modes, over all of which means, standard "
            f"deviations and intervals are taken: {parts}"
        )
    return remarks


def _mode(own: PosteriorResult, mode: ModeResult) -> str:
    return ", ".join(
        f"{one.name} {shown(mode.mean[one.name], one.unit)} ± {shown(mode.standard_deviation[one.name], one.unit, 2)}"
        for one in own.parameters
    )


def _predicted(record: PredictedRecordResult) -> list[PredictedRow]:
    return [
        PredictedRow(
            record.name, record.held_out, own.body, own.channel, "-" if own.inside is None else f"{own.inside:.1%}",
            shown(own.noise, own.unit, 2), own.source,
        )
        for own in record.channels
    ]  # fmt: skip


def _end(profile: ProfileResult, end: EndResult) -> str:
    return "open" if end.cause == WINDOW_END else shown(end.value, profile.unit)


def _interval(profile: ProfileResult, low: float, high: float) -> str:
    return f"{shown(low, profile.unit)} .. {shown(high, profile.unit)}"
