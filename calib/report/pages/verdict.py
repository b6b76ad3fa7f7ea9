"""The verdict of a calibration: what was found, in sentences."""

from dataclasses import dataclass
from typing import Literal

from calib.objective import MISFIT
from calib.objective.objective import MAX_AGREEMENT_DISTANCE
from calib.records import OK
from calib.records.cycles import NOT_PERIODIC, SWEPT, WITHOUT_KIND
from calib.report.formatting import capitalised, number, percent
from calib.report.pages.tables import unreachable
from calib.study import CalibrationResult
from calib.study.result import MotionSummary
from calib.units import count

MAX_LISTED_FEATURES = 4  # out of reach that a sentence lists

Tone = Literal["good", "mind", "bad"]  # class of the box that a verdict stands in


@dataclass(frozen=True)
class Verdict:
    """What was found: the colour of its box, a headline, and a sentence for each point."""

    tone: Tone
    headline: str
    points: tuple[str, ...]


def verdict(result: CalibrationResult) -> Verdict:
    """Summarise a calibration in sentences."""
    total = result.score.total
    if total is None:
        reasons = "The reasons why the trials failed are listed below."
        return Verdict("bad", "No trial ended with a score: nothing was calibrated.", (reasons,))
    lost = any(held.status != OK for held in result.holdout.values())
    unconfirmed = result.confirmation is not None and not result.confirmed
    tone: Tone = "good"
    doubtful = result.unreachable or result.at_edge or lost or result.remarks or total > MAX_AGREEMENT_DISTANCE
    if doubtful or not all(one.is_noise for one in result.residual):
        tone = "mind"
    if result.motion.wrong or unconfirmed:
        tone = "bad"
    distance = f"Best simulation at a distance of {number(total, 3)} from the measurement"
    if unconfirmed:
        headline = f"{distance}, not confirmed."
    elif result.motion.wrong:
        headline = f"{distance}, but of another kind of motion."
    elif result.unreachable:
        headline = f"{distance}; {count(len(result.unreachable), 'measured feature')} out of reach of the windows."
    else:
        headline = f"{distance}."
    return Verdict(tone, headline, tuple(_points(result, total)))


def _points(result: CalibrationResult, total: float) -> list[str]:
    """Sentences on kind of motion, agreement of the starts, held-out records, windows, residual and confidence."""
    points = [*_kind_of_motion(result.motion), *_agreement(result), *_held_out(result), *_out_of_reach(result)]
    edges = _edges(result)
    if edges:
        points.append(
            f"At the edge of {'its window' if len(edges) == 1 else 'their windows'}: {', '.join(edges)}. "
            "A better value may lie outside."
        )
    points += [f"{group.text}." for group in result.undetermined]
    points += [f"{sentence}." for sentence in (*far_sentences(total), *residual_sentences(result))]
    points += [f"{capitalised(remark)}." for remark in result.remarks]
    confidence = result.confidence
    if confidence is not None and confidence.status == "not available":
        points.append(f"No standard errors: {confidence.reason}.")
    elif confidence is not None and confidence.reason:
        points.append(f"Note on the standard errors: {confidence.reason}.")
    return points


def far_sentences(total: float | None) -> list[str]:
    """Say, without a full stop, that the simulation does not agree with the measurement, where it does not.

    total : distance  [1]
    """
    if total is None or not total > MAX_AGREEMENT_DISTANCE:
        return []
    limit = f"{100.0 * MAX_AGREEMENT_DISTANCE:.0f} %"
    return [f"The distance is more than {limit}; the residuals in the report show where the motions differ"]


def residual_sentences(result: CalibrationResult) -> list[str]:
    """Say, without a full stop, whether what the calibration leaves is noise, where that is known."""
    channels = result.residual
    if not channels:
        return []
    beyond = [one for one in channels if not one.is_noise]
    largest = max(beyond or channels, key=lambda one: one.ratio)
    ratio = f"{number(largest.ratio, 3)} times its noise ({largest.source})"
    where = f"{largest.channel} of {largest.body} in {largest.record}"
    if not beyond:
        return [f"The residual is noise, as far as that is known: at most {ratio}, in {where}"]
    of = f", and more than noise in {len(beyond)} of {count(len(channels), 'channel')}" if len(channels) > 1 else ""
    return [
        f"The residual is more than noise: {ratio} in {where}{of}. calib diagnose tests which effect the model lacks"
    ]


def _kind_of_motion(motion: MotionSummary) -> list[str]:
    if not motion.kind:
        return []
    if motion.kind == SWEPT:
        return []
    if motion.kind == NOT_PERIODIC:
        return ["Kinds of motion do not apply: the simulation is no steady motion under a periodic excitation."]
    if motion.wrong:
        return [
            f"The best simulated motion is {motion.kind}, which is not the measured kind in {', '.join(motion.wrong)}: "
            "as long as the kinds differ, the distance between the curves does not measure agreement."
        ]
    return [f"Kind of motion of the best simulation: {motion.kind}, as measured."]


def _agreement(result: CalibrationResult) -> list[str]:
    """Say how many starts of the search ended at the best point, or what else the optimiser reports."""
    if result.starts is not None:
        return [f"{capitalised(sentence)}." for sentence in starts_sentences(result)]
    entries = (result.agreement or {}).items()
    reports = [f"{k.replace('_', ' ')} {number(v)}" for k, v in entries if isinstance(v, int | float | str)]
    return [f"The optimiser reports: {', '.join(reports)}."] if reports else []


def starts_sentences(result: CalibrationResult) -> list[str]:
    """Say at which point the starts of the search ended, if any did; nothing where it has no several starts."""
    if result.starts is None:
        return []
    agree, starts = result.starts
    if agree == 0:  # those that have ended count the best of them
        one = "no start of the search has" if starts != 1 else "the one start of the search has not"
        return [f"{one} come to its end: a larger budget may find a better point"]
    if starts < 2:
        return ["the search had one start only: another may end at another point"]
    changed = result.confirmation is not None and result.confirmation.changed
    where = f"the best of the search, trial {result.searched_best}" if changed else "this point"
    one = f"{agree} of {starts} starts of the search ended at {where}"
    return [one if agree > 1 else f"{one}: it may not be the best of the windows"]


def _held_out(result: CalibrationResult) -> list[str]:
    parts = []
    for name, held in result.holdout.items():
        if held.status != OK:
            parts.append(f"{name} failed ({held.status})")
        else:
            kind = f" ({held.kind})" if held.kind not in (None, "", *WITHOUT_KIND) else ""
            parts.append(f"{name} {percent(held.misfit, 3)}{kind}")
    return [f"Misfit of the records held out: {'; '.join(parts)} ({MISFIT})."] if parts else []


def _out_of_reach(result: CalibrationResult) -> list[str]:
    missed = result.unreachable
    if not missed:
        return []
    listed = "; ".join(unreachable(feature).sentence for feature in missed[:MAX_LISTED_FEATURES])
    more = f"; and {len(missed) - MAX_LISTED_FEATURES} more" if len(missed) > MAX_LISTED_FEATURES else ""
    return [
        f"No trial reaches {count(len(missed), 'measured feature')}: {listed}{more}. "
        "Either the windows are too narrow or an effect is missing in the model."
    ]


def _edges(result: CalibrationResult) -> list[str]:
    """Parameters at the edge of their window, with the end where it is known."""
    sides = {} if result.confidence is None else result.confidence.at_edge
    return [f"{name} ({sides[name]} end)" if name in sides else name for name in result.at_edge]
