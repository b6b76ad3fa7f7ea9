"""Fourth part of the chapter: what the extension of the model changes."""

from collections.abc import Mapping
from dataclasses import dataclass

from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.document import AgreementResult, DiagnosisResult, GainResult, ShiftResult
from calib.modelling.parameter import Parameter
from calib.report.formatting import number, percent, signed, with_error
from calib.report.pages.diagnosis.conclusion import is_heterogeneous
from calib.report.pages.diagnosis.sizes import (
    SHIFT_ERRORS,
    biased_half_width,
    half_width,
    intervals_by_record,
    written_by_record,
)
from calib.report.pages.picture import Picture, pictured
from calib.report.plots.extension import CommonSize, RecordSize, misfit_change, sizes_by_record, value_shifts
from calib.units import count, shown_unit

GAIN = (
    "Misfit of data that the search for the cause did not use, before and after; only nuisances of those records "
    "were estimated."
)
SIZES = (
    "Size of the effect refitted to each record alone, all other parameters free, with its 95\u00a0% interval by "
    "Student's t; a record that does not distinguish it from these parameters has none. The remaining misfit of a "
    "record may bias its size: the pale bar includes that. A law of nature has one size in all records: an effect "
    f"whose sizes differ by more than {percent(CRITERIA.max_variation)} (standard deviation over mean) imitates "
    "another cause (a stand-in). A smaller difference may come from unmodelled effects, where the fit indicates them: "
    "its remaining misfit is more than noise, or the records it was fitted to disagree."
)
SHIFTS = (
    "Shift of the calibrated parameters once the cause is in the model, in their standard errors as this diagnosis "
    "weights the records (the calibration weighs otherwise, so that its standard errors differ); grey band: two "
    "standard errors. A parameter that moves further may have compensated for the missing effect, or the effect takes "
    "over its part."
)


MIN_WRITTEN_STATISTIC = 0.01  # chi-square or z, of which a smaller value says no more  [1]


@dataclass(frozen=True)
class ShiftRow:
    """A calibrated parameter without and with the extension, in the unit shown."""

    parameter: str
    before: str
    after: str
    unit: str
    errors: str


@dataclass(frozen=True)
class ExtensionSection:
    """Figures, sentences and table of what the extension changes."""

    failed: Mapping[str, str]
    gain: Picture | None
    sizes: Picture | None
    agreement: tuple[str, ...]
    shifts: Picture | None
    moved: tuple[ShiftRow, ...]


def extension(diagnosis: DiagnosisResult, parameters: Mapping[str, Parameter]) -> ExtensionSection | None:
    """Everything that the page shows of what the extension changes; None where nothing was added."""
    gain = diagnosis.gain
    if gain is None:
        return None
    units = {name: unit for suspect in diagnosis.suspects for name, unit in suspect.units.items()}
    figure = sizes_by_record(_record_sizes(gain), _common_sizes(diagnosis), units)
    return ExtensionSection(
        failed=gain.failed,
        gain=pictured(misfit_change(gain), "gain", GAIN),
        sizes=pictured(figure, "transfers", SIZES),
        agreement=tuple(_agreement(one, gain, diagnosis) for one in gain.agreements),
        shifts=pictured(value_shifts(gain.shifts), "shifts", SHIFTS),
        moved=tuple(_shift(shift, parameters) for shift in gain.shifts),
    )


def _record_sizes(gain: GainResult) -> list[RecordSize]:
    """Sizes that each record alone has, of those that it determines."""
    return [
        RecordSize(t.record, t.parameter, t.size, half_width(t), biased_half_width(t) if t.bias else None, t.held)
        for t in gain.transfers
        if t.size is not None and t.error is not None
    ]


def _common_sizes(diagnosis: DiagnosisResult) -> dict[str, CommonSize]:
    """Size that the fitted records together have, by parameter, of those that they determine."""
    sizes = {}
    for joint in diagnosis.joint_sizes.values():
        for name, size in joint.size.items():
            low, high = joint.interval.get(name) or (None, None)
            if size is not None and low is not None and high is not None:
                sizes[name] = CommonSize(size, low, high)
    return sizes


def _shift(shift: ShiftResult, parameters: Mapping[str, Parameter]) -> ShiftRow:
    known = parameters.get(shift.parameter.partition("@")[0])
    factor, unit = shown_unit(known.unit if known else "1", max(abs(shift.before), abs(shift.after)))
    half = SHIFT_ERRORS * factor
    return ShiftRow(
        parameter=shift.parameter,
        before=with_error(factor * shift.before, half * (shift.before_error or 0.0)),
        after=with_error(factor * shift.after, half * (shift.after_error or 0.0)),
        unit=unit,
        errors="-" if shift.errors is None else signed(shift.errors, "+"),
    )


def _agreement(agreement: AgreementResult, gain: GainResult, diagnosis: DiagnosisResult) -> str:
    """Say whether the records agree on a size."""
    text = (
        f"The records, each alone, {'agree' if agreement.agree else 'do not agree'} on {agreement.parameter} "
        f"(chi-square {_not_tiny(agreement.chi2)} for {count(agreement.degrees, 'degree')} of freedom, z = "
        f"{_not_tiny(agreement.z)}, threshold {number(diagnosis.threshold, 3)})"
    )
    z = None if diagnosis.misfit is None else diagnosis.misfit.heterogeneity_z
    channels_differ = z is not None and diagnosis.threshold is not None and z > diagnosis.threshold
    if agreement.agree and is_heterogeneous(diagnosis) and channels_differ:
        text += "; the channels within them differ"
    sizes = written_by_record(agreement.parameter, gain, diagnosis)
    return f"{text}: {sizes} ({intervals_by_record([agreement.parameter], gain)})."


def _not_tiny(x: float | None) -> str:
    """Write a statistic to three digits; of a small one only the bound."""
    return f"below {MIN_WRITTEN_STATISTIC:g}" if x is not None and 0.0 < x < MIN_WRITTEN_STATISTIC else number(x, 3)
