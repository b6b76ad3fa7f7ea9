"""What was found, in sentences."""

from typing import Any

from calib.objective import MISFIT
from calib.records import OK
from calib.records.cycles import NOT_PERIODIC
from calib.report.tables import unreachable
from calib.report.words import count, number, percent
from calib.study import CalibrationResult
from calib.study.result import MotionSummary

LARGE = 0.05  # a distance that is no agreement, 0.10 being a curve 10 % too large


def verdict(result: CalibrationResult) -> dict[str, Any]:
    """Say in sentences what was found: {"tone": "good" | "mind" | "bad", "headline": str, "points": [str]}."""
    total = result.score.total
    if total is None:
        return {
            "tone": "bad",
            "headline": "No trial ended with a score: nothing was calibrated.",
            "points": ["Why the trials failed is listed below."],
        }
    wrong = result.motion.wrong
    points = [_kind_sentence(result.motion), *_agreement(result), *_hold_out_sentence(result)]
    missed = result.unreachable
    if missed:
        listed = "; ".join(unreachable(feature)["sentence"] for feature in missed[:4])
        more = f"; and {len(missed) - 4} more" if len(missed) > 4 else ""
        points.append(
            f"No point of the windows reaches {count(len(missed), 'measured feature')}: {listed}{more}. "
            "Windows that are too narrow, or a cause that the model lacks."
        )
    edges = _edges(result)
    if edges:
        points.append(
            f"At the edge of {'its window' if len(edges) == 1 else 'their windows'}: {', '.join(edges)}. "
            "A better value may lie outside."
        )
    points += [f"{group.text}." for group in result.undetermined]
    much = total > LARGE
    if much:
        points.append(f"More than {100.0 * LARGE:.0f} % is left unexplained; see below what the simulation leaves.")
    remarks = result.remarks
    points += [f"{remark[0].upper()}{remark[1:]}." for remark in remarks]
    confidence = result.confidence
    if confidence is not None and confidence.status == "not available":
        points.append(f"No standard errors: {confidence.reason}.")
    elif confidence is not None and confidence.reason:
        points.append(f"Mind: {confidence.reason}.")
    lost = [name for name, held in result.holdout.items() if held.status != OK]
    unconfirmed = result.confirmation is not None and not result.confirmed
    tone = "bad" if wrong or unconfirmed else "mind" if missed or edges or lost or remarks or much else "good"
    headline = f"Best simulation at a distance of {number(total, 3)} from the measurement."
    if unconfirmed:
        headline = f"{headline[:-1]}, not confirmed."
    elif wrong:
        headline = f"{headline[:-1]}, but of another kind of motion."
    elif missed:
        out = f"{count(len(missed), 'measured feature')} out of reach of the windows"
        headline = f"{headline[:-1]}; {out}."
    return {"tone": tone, "headline": headline, "points": [p for p in points if p]}


def _kind_sentence(motion: MotionSummary) -> str:
    kind = motion.kind
    if not kind:
        return ""
    if kind == NOT_PERIODIC:
        return "Kinds of motion do not apply: what is simulated is no steady motion under a periodic excitation."
    if motion.wrong:
        return (
            f"The best simulated motion is {kind}, which is not the measured kind in {', '.join(motion.wrong)}: "
            "as long as the kinds differ, a distance between the curves says little."
        )
    return f"Kind of motion of the best simulation: {kind}, as measured."


def _agreement(result: CalibrationResult) -> list[str]:
    if result.starts is not None:
        agree, starts = result.starts
        if starts < 2:
            return ["One start only: whether another would end elsewhere is not known."]
        changed = result.confirmation is not None and result.confirmation.changed
        where = f"the best of the search, trial {result.searched_best}" if changed else "this point"
        one = f"{agree} of {starts} starts of the search ended at {where}"
        return [f"{one}." if agree > 1 else f"{one}: it may not be the best of the windows."]
    entries = (result.agreement or {}).items()
    said = [f"{k.replace('_', ' ')} {number(v)}" for k, v in entries if isinstance(v, int | float | str)]
    return [f"Of the search itself: {', '.join(said)}."] if said else []


def _hold_out_sentence(result: CalibrationResult) -> list[str]:
    parts = []
    for name, held in result.holdout.items():
        if held.status != OK:
            parts.append(f"{name} failed ({held.status})")
        else:
            kind = f" ({held.kind})" if held.kind not in (None, "", NOT_PERIODIC) else ""
            parts.append(f"{name} {percent(held.misfit, 3)}{kind}")
    return [f"Misfit of the records held out: {'; '.join(parts)} ({MISFIT})."] if parts else []


def _edges(result: CalibrationResult) -> list[str]:
    sides = {} if result.confidence is None else result.confidence.at_edge
    return [f"{name} ({sides[name]} end)" if name in sides else name for name in result.at_edge]
