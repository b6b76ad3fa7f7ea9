"""Sizes of effects in sentences: with intervals and units, record by record, alone and beside others."""

import math
from collections.abc import Sequence

from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.document import (
    DiagnosisResult,
    Ends,
    GainResult,
    JointSize,
    ShiftResult,
    SuspectResult,
    TransferResult,
)
from calib.diagnosis.verdict import joined
from calib.report.formatting import HALF_WIDTH_ERRORS_95, quantity

SHIFT_ERRORS = 2.0  # written with calibrated values, and beyond which they count as moved  [standard errors]
MAX_ABSORBED = 0.995  # share of a signature that calibration absorbs, above which its score gives no size  [1]
MAX_LISTED = 4  # records whose own sizes a sentence gives
LIMIT_TOLERANCE = 1e-6  # relative distance of a size from the end of its range at which it lies  [1]


def is_untested(suspect: SuspectResult) -> bool:
    """Whether nothing is known of a suspect: it has no score test, and was not refitted."""
    return not suspect.refitted and all(x is None for x in suspect.detectable.values())


def is_absorbed(suspect: SuspectResult) -> bool:
    """Whether calibration absorbs so much of an effect that neither its score nor its refit gives a size."""
    explains = suspect.refitted and (suspect.share or 0.0) > CRITERIA.negligible_share
    return suspect.absorbed > MAX_ABSORBED and not explains


def size_alone(suspect: SuspectResult, diagnosis: DiagnosisResult) -> SuspectResult | JointSize:
    """What is known of the size of a suspect with no other effect in the model, as its z and its share are.

    That of the only cause is the size in the final model.
    """
    only = len(diagnosis.joint_sizes) == 1
    return diagnosis.joint_sizes.get(suspect.effect, suspect) if only else suspect


def sizes_together(effect: str, diagnosis: DiagnosisResult) -> list[str]:
    """Write the sizes of one of several causes that were fitted together; empty for any other suspect."""
    several = len(diagnosis.joint_sizes) > 1
    return sizes(diagnosis.joint_sizes[effect]) if several and effect in diagnosis.joint_sizes else []


def sizes(known: SuspectResult | JointSize) -> list[str]:
    """Write the sizes of an effect with their 95 % intervals and units, of those parameters that are determined.

    A size at an end of its range has no two-sided interval; that is written instead.
    """
    return _with_intervals(known) or _without_intervals(known) or ["-"]


def _with_intervals(known: SuspectResult | JointSize) -> list[str]:
    """Write each size that has an interval."""
    written = []
    for name, size in known.size.items():
        low, high = known.interval.get(name) or (None, None)
        if size is None or low is None or high is None:
            continue
        unit = known.units.get(name)
        if _at_limit(size, known.limits.get(name) or (None, None)):
            written.append(f"{name} = {quantity(size, unit)}, the end of its range")
        else:
            written.append(f"{name} = {quantity(size, unit, half=0.5 * (high - low))}")
    return written


def _without_intervals(known: SuspectResult | JointSize) -> list[str]:
    """Write the sizes of an effect in the model whose intervals are unknown, for want of a derivative."""
    absent = known.null if isinstance(known, SuspectResult) else {}
    present = {n: x for n, x in known.size.items() if x is not None and x != absent.get(n)}
    return [f"{name} = {quantity(size, known.units.get(name))}" for name, size in present.items()]


def _at_limit(size: float, limits: Ends) -> bool:
    """Whether a size is at the end of its range; 0, where an effect is absent, is none."""
    return size != 0.0 and any(end is not None and math.isclose(size, end, rel_tol=LIMIT_TOLERANCE) for end in limits)


def size_text(joint: JointSize, name: str, bias: float) -> str:
    """Write the bias of a size that is not exceeded in 95 % of cases, from its standard deviation."""
    return quantity(HALF_WIDTH_ERRORS_95 * bias, joint.units.get(name), 2)


def half_width(transfer: TransferResult) -> float:
    """Half width of the 95 % interval of the size that a record alone has [SI]; 0 where it has none."""
    return transfer.half_width or HALF_WIDTH_ERRORS_95 * (transfer.error or 0.0)


def biased_half_width(transfer: TransferResult) -> float:
    """The same, wider by the bias that what the model leaves in the record may cause."""
    return math.hypot(half_width(transfer), HALF_WIDTH_ERRORS_95 * (transfer.bias or 0.0))


def disagreements(diagnosis: DiagnosisResult) -> list[str]:
    """Say of which causes the records, each alone, have different sizes."""
    if diagnosis.gain is None:
        return []
    apart = [one.parameter for one in diagnosis.gain.agreements if not one.agree]
    names = [name for name, joint in diagnosis.joint_sizes.items() if set(joint.size) & set(apart)]
    if not names:
        return []
    sizes = [written_by_record(parameter, diagnosis.gain, diagnosis) for parameter in apart]
    return [
        f"The records, each alone, disagree on the size of {joined(names)} ({'; '.join(sizes)}; "
        f"{intervals_by_record(apart, diagnosis.gain)}): an unmodelled effect with a similar signature changes it, or "
        f"is the cause; the interval of {_fitted_size(diagnosis.gain.transfers, apart)} does not allow for that"
        f"{_biases(diagnosis, apart)}."
    ]


def written_by_record(parameter: str, gain: GainResult, diagnosis: DiagnosisResult) -> str:
    """Write the size that each record alone has of a parameter; intervals are those by which they are compared."""
    own = [one for one in gain.transfers if one.parameter == parameter and one.error is not None]
    unit = next((j.units.get(parameter) for j in diagnosis.joint_sizes.values() if parameter in j.size), None)
    each = [f"{quantity(t.size, unit, half=biased_half_width(t))} in {t.record}" for t in own if t.size is not None]
    more = f" and {len(each) - MAX_LISTED} more" if len(each) > MAX_LISTED else ""
    return f"{parameter} = {', '.join(each[:MAX_LISTED])}{more}" if each else parameter


def intervals_by_record(parameters: Sequence[str], gain: GainResult) -> str:
    """Say what the intervals of `written_by_record` are."""
    biased = any(transfer.bias for transfer in gain.transfers if transfer.parameter in parameters)
    more = ", with the bias that what the model leaves in a record may cause" if biased else ""
    return f"95\u00a0% intervals by Student's t{more}"


def _biases(diagnosis: DiagnosisResult, parameters: Sequence[str]) -> str:
    """Write by how much the sizes on which the records disagree may be biased, as the end of a sentence."""
    biases = [
        f"{name} by no more than {size_text(joint, name, bias)}"
        for joint in diagnosis.joint_sizes.values()
        for name in parameters
        if (bias := joint.bias.get(name))
    ]
    return f"; in 95\u00a0% of cases it biases {joined(biases)}" if biases else ""


def _fitted_size(transfers: Sequence[TransferResult], parameters: Sequence[str]) -> str:
    """Name the size that the model has: that of the only record it was fitted to, or that common to several."""
    fitted = dict.fromkeys(t.record for t in transfers if t.parameter in parameters and not t.held)
    return f"the size that {next(iter(fitted))} alone has" if len(fitted) == 1 else "the common size"


def moved_sizes(diagnosis: DiagnosisResult) -> list[str]:
    """Say which sizes leave their own 95 % interval where other causes are fitted beside them."""
    fitted = diagnosis.joint_sizes
    if len(fitted) < 2:
        return []
    alone = {suspect.effect: suspect for suspect in diagnosis.suspects if suspect.refitted}
    changes = [text for name, joint in fitted.items() if name in alone for text in _moved(alone[name], joint)]
    if not changes:
        return []
    return [f"Causes fitted together change each other's sizes by more than their intervals: {'; '.join(changes)}."]


def _moved(alone: SuspectResult, joint: JointSize) -> list[str]:
    """Write the sizes of a cause that the others move out of its interval, before and after."""
    changes = []
    for name, size in joint.size.items():
        low, high = alone.interval.get(name) or (None, None)
        if low is None or high is None or size is None or low <= size <= high:
            continue
        if not _at_limit(size, joint.limits.get(name) or (None, None)):
            beside = _written(joint, name).removeprefix(f"{name} = ")
            changes.append(f"{_written(alone, name)} alone and {beside} beside the others")
    return changes


def _written(known: SuspectResult | JointSize, name: str) -> str:
    """Write the size of a parameter, or its name alone where the size is not known."""
    return next((text for text in sizes(known) if text.startswith(f"{name} = ")), name)


def moved_values(gain: GainResult) -> list[str]:
    """Write calibrated parameters that move by more than two standard errors in the extended model: both values."""
    return [
        f"{s.parameter} from {_with_error(s, s.before, s.before_error)} to {_with_error(s, s.after, s.after_error)}"
        for s in gain.shifts
        if s.errors is not None and abs(s.errors) > SHIFT_ERRORS
    ]


def _with_error(shift: ShiftResult, value: float, error: float | None) -> str:
    """Write a calibrated value with two standard errors where they are known."""
    return quantity(value, shift.unit, half=None if error is None else SHIFT_ERRORS * error)
