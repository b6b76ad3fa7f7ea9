"""The verdict of a diagnosis, and its summary in a sentence."""

from collections.abc import Sequence

import numpy as np

from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.gain import RECORDS, Gain
from calib.diagnosis.gates import Gate
from calib.diagnosis.noise import RESIDUAL
from calib.diagnosis.preparation import Prepared
from calib.diagnosis.selection import Selection
from calib.diagnosis.suspect import Refitted, Scored

NONE, NAMED, ONE_OF, UNEXPLAINED = "none", "named", "one_of", "unexplained"
NOT_DIAGNOSABLE = "not_diagnosable"


def verdict_of(
    selection: Selection, gates: Sequence[Gate], ready: Prepared, gain: Gain | None = None
) -> tuple[str, str]:
    """Verdict, and its summary in a sentence.

    From one steady tone alone no single cause is named: it repeats any model error, so that no part of it tests a
    prediction. A record held out tests it: the causes predict where its misfit falls, and do not where it rises.
    """
    if not all(gate.passed for gate in gates):
        return NOT_DIAGNOSABLE, failures(gates) + _leading(selection)
    if not selection.causes:
        return _without_causes(selection, ready)
    if not selection.is_sufficient:
        return UNEXPLAINED, _insufficient(selection)
    if gain is not None and gain.refutes:
        return UNEXPLAINED, _refuted(selection, gain)
    share = f"{explained(selection.explained_share)} of the excess misfit"
    if len(selection.rivals) > 1:
        equally = f"; {_alternatives(selection)} explain {share} equally well" if selection.is_significant else ""
        return ONE_OF, joined(_ways(selection)) + equally + _differing(selection)
    names, s = _subject(selection)
    text = (f"{names}: explain{s} {share}" if selection.is_significant else names) + _differing(selection)
    if _is_one_tone(ready) and not (gain is not None and gain.kind == RECORDS and gain.proven):
        return ONE_OF, f"{text}; or an effect that is the same in this one steady tone, which cannot test a prediction"
    return NAMED, text


def _leading(selection: Selection) -> str:
    """The causes that explain most where a gate fails, as the end of a sentence; "" without any."""
    if not selection.causes:
        return ""
    names, s, share = _closest_ways(selection)
    return f"; {names} explain{s} most: {share}"


def _differing(selection: Selection) -> str:
    """By how much sizes of causes differ from record to record, as the end of a sentence; "" where they do not."""
    sizes = [f"that of {c.effect} by {c.variation:.0%}" for c in selection.differing_by_record]
    return f"; sizes differ from record to record, {joined(sizes)}" if sizes else ""


def _is_one_tone(ready: Prepared) -> bool:
    """Whether the evidence is one record of a periodic excitation."""
    return [part.period is None for part in ready.fitter.evidence.parts] == [False]


def failures(gates: Sequence[Gate]) -> str:
    """Gates that failed and why, in a sentence."""
    return "; ".join(f"{gate.name}: {gate.summary}" for gate in gates if not gate.passed)


def _ways(selection: Selection) -> list[str]:
    """Each cause with the suspects that are indistinguishable from it; of several causes those without any first."""
    ways = sorted(([rival.name for rival in rivals] for rivals in selection.alternatives), key=lambda own: len(own) > 1)
    return [_one_of(names, bracketed=len(ways) > 1) for names in ways]


def _closest_ways(selection: Selection) -> tuple[str, str, str]:
    """The closest causes as the subject of a sentence, the ending of its verb, and the share explained."""
    share = f"{explained(selection.explained_share)} of the excess misfit"
    return joined(_ways(selection)), "s" if len(selection.causes) == 1 else "", share


def _alternatives(selection: Selection) -> str:
    """Indistinguishable models as the subject of a sentence; of several causes not all combinations are among them."""
    if len(selection.causes) == 1:
        return "they"
    return f"the {len(selection.classes)} combinations of them in which at most one cause is exchanged"


def _subject(selection: Selection) -> tuple[str, str]:
    """Names of the causes as the subject of a sentence, and the ending of its verb."""
    return joined([c.name for c in selection.causes]), "s" if len(selection.causes) == 1 else ""


def _without_causes(selection: Selection, ready: Prepared) -> tuple[str, str]:
    """Verdict and its summary where no effect is a cause."""
    faults = [f"outliers, {ready.outliers:.1%} of the samples"] if ready.outliers else []
    faults += [f"quantisation, {ready.rounding:.0%} of the noise of a channel"] if ready.rounding else []
    if ready.rounding and selection.is_significant:
        return NAMED, f"{' and '.join(faults)}; no further effect explains the remaining misfit"
    if selection.is_significant:
        return UNEXPLAINED, f"the misfit is significant, and no candidate explains it{_closest(selection)}"
    if faults:
        return NAMED, f"{' and '.join(faults)}; apart from that the residual is noise"
    untestable = _untestable(selection, ready)
    if untestable:
        return NOT_DIAGNOSABLE, (
            f"noise: it is taken as what no candidate explains of the residual, but {joined(untestable)} could not be "
            "tested, for the simulations do not change smoothly with them; state the uncertainty of the records"
        )
    return NONE, f"the residual is noise; no missing effect is detectable{_reservation(ready)}"


def _reservation(ready: Prepared) -> str:
    """What cannot be told where the noise has a memory that only the residual shows, as the end of a sentence."""
    shares = [
        noise.sigma / float(np.sqrt(np.mean(row**2)))
        for part in ready.fitter.evidence.parts
        for noise, row, used in zip(part.noise, part.measured, part.used, strict=True)
        if used.any() and row.any() and noise.source == RESIDUAL and noise.ar.size and not noise.repeated
    ]
    if not shares:
        return ""
    return (
        f"; but the noise, up to {100.0 * max(shares):.3g} % of the rms of a channel, is taken from the residual, "
        "which is correlated, and may as well be an effect that no candidate resembles: state the uncertainty of the "
        "records, or repeat them"
    )


def _untestable(selection: Selection, ready: Prepared) -> list[str]:
    """Names of the candidates without a usable derivative, where most are, and noise is judged by what all leave."""
    sources = {noise.source for part in ready.fitter.evidence.parts for noise in part.compared_noise}
    suspects = selection.rounds[0].suspects
    tested = {suspect.name for suspect in suspects if suspect.is_testable or isinstance(suspect, Refitted)}
    names = dict.fromkeys(s.name for s in suspects if isinstance(s, Scored) and s.name not in tested)
    return list(names) if RESIDUAL in sources and len(names) > len(tested) else []


def _closest(selection: Selection) -> str:
    """Which suspect explains most where none is a cause, as the end of a sentence."""
    first = selection.rounds[0]
    if first.rejected is not None:
        return f"; {first.rejected.name} explains most, but {first.rejection}"
    return f"; {first.suspects[0].name} explains most" if first.suspects else ""


def _insufficient(selection: Selection) -> str:
    """Why the causes do not explain enough to be named."""
    names, s, share = _closest_ways(selection)
    if not selection.is_explained:
        less, it = ("less than", "it") if s else ("not each of them at least", "them")
        return (
            f"{names} explain{s} most, {share}, but {less} {CRITERIA.min_over_remainder:g} times the "
            f"remaining misfit: the missing effect may only resemble {it}"
        )
    most = f" most, {share}," if selection.is_significant else " most,"
    largest = max(selection.heterogeneous, key=lambda c: c.z)
    differ = f"the size of {largest.effect} differs among {largest.among} (z = {largest.z:.2g})"
    return f"{names} explain{s}{most} but {differ}: it is not constant, or imitates another cause"


def _refuted(selection: Selection, gain: Gain) -> str:
    """The rise of the misfit of records held out, which the causes do not predict."""
    names, s, share = _closest_ways(selection)
    most = f" most, {share}," if selection.is_significant else " most,"
    change = f"rises from {100.0 * gain.before:.3g} to {100.0 * gain.after:.3g} %"
    where = ", ".join(gain.records)
    return f"{names} explain{s}{most} but in the records held out ({where}) the misfit {change}"


def joined(names: Sequence[str]) -> str:
    """Write names as one enumeration."""
    if len(names) < 2:
        return "".join(names)
    return f"{', '.join(names[:-1])} and {names[-1]}"


def explained(share: float) -> str:
    """Write a share of the excess misfit that is explained [1]; no share is rounded to "all" or to nothing.

    Of causes that leave less than the expectation of noise it is "all".
    """
    if share >= 1.0:
        return "all"
    if share >= 0.9995:
        return "more than 99.9 %"
    if 0.0 < share < 0.0005:
        return "less than 0.1 %"
    return f"{100.0 * share:.1f} %" if share >= 0.99 or 0.0 < share < 0.01 else f"{100.0 * share:.0f} %"


def omitted(selection: Selection, gain: Gain | None) -> tuple[str, ...]:
    """What was left out for the budget, each as a clause."""
    said = []
    if selection.cut_short:
        names = list(dict.fromkeys(name for r in selection.rounds for name in r.untried))
        said += [f"fits of {joined(names)} were left out or broken off"] if names else []
        said.append("not all further causes and exchanges of causes were tried")
    if gain is not None and gain.omitted:
        said.append("the gain on blocks of the calibrated records was not computed")
    return tuple(said)


def _one_of(names: Sequence[str], bracketed: bool = False) -> str:
    """Write alternatives; in brackets where they are a member of an enumeration."""
    if len(names) == 1:
        return names[0]
    return f"({', '.join(names[:-1])} or {names[-1]})" if bracketed else f"one of {', '.join(names)}"
