"""A diagnosis as what diagnosis.json holds."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from calib.diagnosis.candidate import Candidate
from calib.diagnosis.design_document import (
    DesignPointResult,
    DesignResult,
    DesignVariableResult,
    MeasurementResult,
    RecordSetting,
)
from calib.diagnosis.diagnose import Diagnosis
from calib.diagnosis.document import (
    AgreementResult,
    ChannelResult,
    ConstancyResult,
    DeviationResult,
    DiagnosisResult,
    Ends,
    ExchangeResult,
    GainResult,
    GateResult,
    GrossErrorsResult,
    JointSize,
    LeftOutResult,
    MisfitResult,
    ParameterResult,
    PredictionResult,
    RemainderResult,
    RemainderRow,
    RoundResult,
    ShiftResult,
    SuspectResult,
    TransferResult,
)
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.excess import gross_excess_by_row
from calib.diagnosis.fit import Fit
from calib.diagnosis.gain import Gain
from calib.diagnosis.measurement import DECISIVE_Z, Measurement
from calib.diagnosis.misfit import Misfit
from calib.diagnosis.next_measurement import Design
from calib.diagnosis.search import Round
from calib.diagnosis.selection import Selection
from calib.diagnosis.suspect import Refitted, Scored, Suspect, cosine, leading_variants
from calib.diagnosis.verdict import NOT_DIAGNOSABLE, UNEXPLAINED
from calib.objective import MISFIT, gross_errors

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T", bound="DataclassInstance")
MAX_HALF_WIDTH = 10.0  # of a 95 % interval, over the natural scale of its parameter: wider ones are undetermined  [1]


def diagnosis_result(diagnosis: Diagnosis, values: Mapping[str, float]) -> DiagnosisResult:
    """Everything that diagnosis.json holds of a diagnosis of the calibrated `values`, in SI."""
    selection, evidence, deviations = diagnosis.selection, diagnosis.evidence, diagnosis.misfit
    first = selection.rounds[0] if selection else None
    design = diagnosis.design
    measurements = () if design is None else tuple(measurement_result(m) for m in design.measurements)
    return DiagnosisResult(
        verdict=diagnosis.verdict,
        summary=diagnosis.summary,
        causes=diagnosis.causes,
        classes=diagnosis.classes,
        stand_ins=diagnosis.stand_ins,
        remainder=None if selection is None or evidence is None else _remainder(selection, evidence),
        closest=tuple(c.name for c in selection.causes) if selection and _is_open(diagnosis) else (),
        suspects=() if selection is None else _suspects(selection),
        rounds=() if selection is None else tuple(_round(r, selection.share_above_noise) for r in selection.rounds),
        exchanges=() if selection is None else _each(ExchangeResult, selection.exchanges),
        left_out=() if selection is None else _each(LeftOutResult, selection.left_out),
        refused=diagnosis.refused,
        gates=_each(GateResult, diagnosis.gates),
        outliers=diagnosis.outliers,
        rounding=diagnosis.rounding,
        misfit=None if selection is None or deviations is None else _misfit(selection, deviations),
        parameters={} if selection is None else _parameters(selection),
        joint_sizes={} if selection is None else {c.name: _joint_size(c, selection) for c in selection.causes},
        gain=None if diagnosis.gain is None else _gain(diagnosis.gain),
        next_measurement=measurements[0] if measurements else None,
        measurements=measurements,
        design=None if design is None else design_result(design),
        levels=diagnosis.levels,
        threshold=None if first is None else first.threshold,
        cut_short=diagnosis.cut_short if selection is None else selection.cut_short,
        simulations=diagnosis.simulations,
        seconds=diagnosis.seconds,
        values=values,
        omitted=diagnosis.omitted,
        gross_errors=() if selection is None or evidence is None else _gross_errors(selection, evidence),
    )


def _gross_errors(selection: Selection, evidence: Evidence) -> tuple[GrossErrorsResult, ...]:
    """Points of frequency responses that are gross errors beside the extended model."""
    found = []
    for part in evidence.parts:
        if part.frequency is not None:
            places = gross_errors(selection.final.point.simulated[part.name].trust)
            if places.size:
                numbers, frequencies = tuple((places + 1).tolist()), tuple(part.frequency[places].tolist())
                found.append(GrossErrorsResult(part.name, part.time.size, numbers, frequencies))
    return tuple(found)


def _is_open(diagnosis: Diagnosis) -> bool:
    """Whether the causes that explain most are not named."""
    return diagnosis.verdict in (UNEXPLAINED, NOT_DIAGNOSABLE)


def measurement_result(measurement: Measurement) -> MeasurementResult:
    """Settings of a measurement, its predicted separations, and these in words."""
    return _taken(MeasurementResult, measurement.point, measurement)


def design_result(design: Design) -> DesignResult:
    """The search for the next measurement without its results, as the map of the separation shows it."""
    return DesignResult(
        record=design.record,
        models=design.models,
        variables=_each(DesignVariableResult, design.variables),
        unavailable=design.unavailable,
        known=_each(RecordSetting, design.known),
        simulations=design.simulations,
        max_simulations=design.max_simulations,
        points=tuple(_taken(DesignPointResult, outcome.point, outcome) for outcome in design.points),
        decisive_z=DECISIVE_Z,
    )


def _taken(kind: type[T], *sources: Any, **more: Any) -> T:
    """Return the dataclass `kind` with what the sources have under the names of its fields, and with `more`."""
    names = [field.name for field in fields(kind) if field.name not in more]
    return kind(**{name: _first(name, sources) for name in names}, **more)


def _first(name: str, sources: tuple[Any, ...]) -> Any:
    return getattr(next((source for source in sources if hasattr(source, name)), sources[-1]), name)


def _each(kind: type[T], sources: Iterable[Any]) -> tuple[T, ...]:
    return tuple(_taken(kind, source) for source in sources)


def _intervals(
    candidate: Candidate, names: Sequence[str], sizes: Iterable[float], halves: Iterable[float]
) -> dict[str, Ends]:
    """Ends of the 95 % intervals of these parameters of an effect.

    None of a size that is infinite where the effect is absent, nor of one that the records do not determine.
    """
    ends: dict[str, Ends] = {}
    for name, size, half in zip(names, sizes, halves, strict=True):
        determined = np.isfinite(size) and half < MAX_HALF_WIDTH * candidate.scale.get(name, np.inf)
        ends[name] = (size - half, size + half) if determined else (None, None)
    return ends


def _limits(candidate: Candidate) -> dict[str, Ends]:
    return {p.name: (p.low, p.high) for p in candidate.parameters}


def _units(candidate: Candidate) -> dict[str, str]:
    return {p.name: p.unit for p in candidate.effect.parameters}


def _suspects(selection: Selection) -> tuple[SuspectResult, ...]:
    """Suspects of the first search, whose noise was perhaps not known as well as at the end."""
    first = selection.rounds[0]
    excess = selection.share_above_noise * first.base_chi2
    return tuple(_suspect(s, excess, first.chosen) for s in leading_variants(first.suspects))


def _suspect(suspect: Suspect, excess: float, chosen: Suspect | None) -> SuspectResult:
    """A suspect of the first search beside the chosen one."""
    names, null = suspect.candidate.free, suspect.candidate.null
    reduction = suspect.known_reduction
    return SuspectResult(
        effect=suspect.name,
        meaning=suspect.candidate.effect.meaning,
        equation=suspect.candidate.effect.equation,
        bodies=suspect.candidate.effect.bodies,
        z=suspect.z,
        size=dict(zip(names, suspect.size, strict=True)),
        interval=_intervals(suspect.candidate, suspect.candidate.free, suspect.size, suspect.half_width),
        held=suspect.candidate.held,
        limits=_limits(suspect.candidate),
        units=_units(suspect.candidate),
        share=reduction / excess if excess > 0.0 else None,
        absorbed=suspect.absorbed,
        detectable=dict(zip(names, suspect.detectable, strict=True)),
        chi2_reduction=reduction,
        refitted=isinstance(suspect, Refitted),
        null=dict(zip(names, null, strict=True)),
        cosine=None if chosen is None else cosine(suspect, chosen),
        reason=suspect.reason or _without_effect(suspect) or _unfitted(suspect),
    )


def _without_effect(suspect: Suspect) -> str:
    """State that a suspect changes no simulation where it is absent; "" of one that does."""
    none = isinstance(suspect, Scored) and not suspect.derivatives.any()
    return (
        "it changes nothing in these records: their derivative with respect to its size is zero where it is absent"
        if none
        else ""
    )


def _unfitted(suspect: Suspect) -> str:
    """Why the refit of a suspect could not begin; "" where it did, or there was none."""
    return suspect.fit.reason if isinstance(suspect, Refitted) and not suspect.fit.names else ""


def _round(outcome: Round, share_above_noise: float) -> RoundResult:
    """One search for a cause, with that share of the calibrated model's chi-square above noise.

    The first search is beside that model: there it is compared on the samples that its suspects are.
    """
    excess = share_above_noise * (outcome.chi2_of_null if outcome.base.candidates else outcome.base_chi2)
    chosen = outcome.chosen
    return RoundResult(
        threshold=outcome.threshold,
        chosen=None if chosen is None else chosen.name,
        share=None if chosen is None or not excess > 0.0 else chosen.chi2_reduction / excess,
        rivals=tuple(rival.name for rival in outcome.rivals),
        prediction=None if outcome.prediction is None else _taken(PredictionResult, outcome.prediction),
        rejected=None if outcome.rejected is None else outcome.rejected.name,
        rejection=outcome.rejection,
        untried=outcome.untried,
        cosines={r.name: cosine(r, chosen) for r in outcome.rivals if chosen is not None and r is not chosen},
    )


def _misfit(selection: Selection, deviations: Misfit) -> MisfitResult:
    """The misfit of the calibrated model, and the part of it that the causes explain."""
    return MisfitResult(
        excess_chi2=selection.excess_chi2,
        remaining_chi2=selection.remaining_chi2,
        chi2_std=selection.chi2_std,
        share=selection.explained_share if selection.causes else 0.0,
        heterogeneity_z=selection.heterogeneity_z,
        constancy=_each(ConstancyResult, selection.constancy),
        features=_each(DeviationResult, deviations.features),
        channels=tuple(
            _taken(ChannelResult, channel, orders=tuple(channel.orders.tolist())) for channel in deviations.channels
        ),
    )


def _remainder(selection: Selection, evidence: Evidence) -> RemainderResult:
    """The remaining misfit: its share, whether it is above the noise, and the part of each row in it.

    In the low harmonics of a row, where only those show that there is a model error.
    """
    in_harmonics = selection.model_error_chi2 > 0.0 and not selection.remainder_is_significant
    names = [(part.name, body, channel) for part in evidence.parts for body, channel in part.rows]
    excess = selection.harmonics.rows if in_harmonics else _excess_by_row(evidence, selection.final)
    rows = [RemainderRow(*name, max(0.0, float(row))) for name, row in zip(names, excess, strict=True)]
    return RemainderResult(
        share=selection.remaining_chi2 / selection.excess_chi2 if selection.is_significant else None,
        above_noise=selection.model_error_chi2 > 0.0,
        rows=tuple(rows),
    )


def _excess_by_row(evidence: Evidence, fit: Fit) -> list[float]:
    """Chi-square of each row of all records beyond its number of residuals that count, without that of gross errors."""
    excess = []
    for part in evidence.parts:
        residual = fit.residual[evidence.of(part.name)]
        gross = gross_excess_by_row(part, fit.point.simulated[part.name], residual)
        squares = np.square(residual).reshape(part.measured.shape).sum(axis=1)
        excess += (squares - gross - np.square(part.weight).sum(axis=1)).tolist()
    return excess


def _joint_size(cause: Suspect, selection: Selection) -> JointSize:
    """Sizes of a cause with their 95 % intervals, all causes and calibrated parameters being fitted together.

    Those of its form are among them where it was fitted.
    """
    candidate, final = cause.candidate, selection.final
    names = (*candidate.free, *candidate.form)
    size = [final.value(name) for name in names]
    return JointSize(
        size=dict(zip(names, size, strict=True)),
        interval=_intervals(candidate, names, size, final.half_width(names)),
        bias={name: selection.bias_std(final, name) for name in names},
        limits=_limits(candidate) | {name: candidate.bounds[name] for name in candidate.form},
        units=_units(candidate),
    )


def _parameters(selection: Selection) -> dict[str, ParameterResult]:
    """Calibrated values before and, where there are causes, after."""
    null, final = selection.null, selection.final
    return {
        name: ParameterResult(null.value(name) if name in null.names else None, final.value(name))
        for name in final.names
    }


def _gain(gain: Gain) -> GainResult:
    """The gain by the causes on records held out."""
    return GainResult(
        metric=MISFIT,
        kind=gain.kind,
        before=gain.before,
        after=gain.after,
        interval=gain.interval,
        records=gain.records,
        proven=gain.proven,
        each=gain.each,
        failed=gain.failed,
        unaffected=gain.unaffected,
        transfers=_each(TransferResult, gain.transfers),
        agreements=_each(AgreementResult, gain.agreements),
        shifts=_each(ShiftResult, gain.shifts),
    )
