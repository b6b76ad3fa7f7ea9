"""The conclusion of a diagnosis: headline, sentences of its verdict, what follows from it."""

import math
from collections.abc import Sequence

from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.design_document import MeasurementResult
from calib.diagnosis.discovery.document import DiscoveryResult
from calib.diagnosis.document import DiagnosisResult, GainResult, GateResult, MisfitResult
from calib.diagnosis.excess import significant
from calib.diagnosis.measurement import DECISIVE_Z
from calib.diagnosis.preparation import OUTLIERS, QUANTISATION
from calib.diagnosis.verdict import NAMED, NONE, ONE_OF, UNEXPLAINED, explained, joined
from calib.report.formatting import capitalised, distinguishing_digits, number, percent
from calib.report.pages.diagnosis.levels import level_trends
from calib.report.pages.diagnosis.sizes import disagreements, moved_sizes, moved_values, size_text, sizes
from calib.report.response_description import gross_errors_text
from calib.study import CalibrationResult

MIN_EXPLAINED_SHARE = CRITERIA.min_over_remainder / (1.0 + CRITERIA.min_over_remainder)  # of a remainder  [1]
MAX_RELATIVE_CHANGE = 1e-9  # of values that count as unchanged  [1]
REFITTED = "before, the calibrated model is refitted to the records as weighted by the diagnosis"
REMEDIES = {
    "simulation": "find out why the simulation ends this way at the calibrated values (a larger step budget may help), "
    "or calibrate again with narrower windows",
    "kind of motion": "calibrate until the simulated motion is of the measured kind (wider windows, a larger budget): "
    "differences between motions of different kinds identify no cause",
    "noise": "record more samples, best three cycles of the motion or more, or state the noise in the record "
    "(displacement_sigma, velocity_sigma); of a frequency response put the sweeps of all levels into one record, or "
    "state the uncertainty of each point in a column BODY sigma",
    "budget": "diagnose again with a larger --budget: the simulations are kept, and it goes on from them",
}
REFINE = (
    "make the simulator's step or tolerance finer in [model] and calibrate again: as it is, an error of the solver "
    "would be mistaken for a physical effect"
)

DISCOVER_REST = (
    "What the extended model leaves may be a force that no effect has: calibrate it (calib run); calib discover then "
    "looks for that force as a free function beside the effects that were named."
)


def headline(diagnosis: DiagnosisResult) -> str:
    """Say the verdict in a sentence, and in another one that the budget ended the search before all was tried."""
    verdict = _verdict(diagnosis)
    return f"{verdict} The budget was spent before all was tried." if _ended_early(diagnosis) else verdict


def _ended_early(diagnosis: DiagnosisResult) -> bool:
    """Whether the budget ended a search that has a result."""
    return diagnosis.cut_short and all(gate.passed for gate in diagnosis.gates if gate.name == "budget")


def _verdict(diagnosis: DiagnosisResult) -> str:
    """Say the verdict in a sentence."""
    verdict = diagnosis.verdict
    if verdict == NAMED:
        causes = "; and ".join(_cause(name, diagnosis) for name in diagnosis.causes)
        return f"{'Missing in the model' if added(diagnosis) else 'In the records'}: {causes}."
    if verdict == ONE_OF:
        several = len(diagnosis.classes) > 1
        reason = "these records do not distinguish the candidates" if several else "one record does not confirm it"
        return f"An effect is missing in the model, and {reason}: {diagnosis.summary}."
    if verdict == UNEXPLAINED:
        if diagnosis.closest:
            return f"No known effect can be named as the cause: {diagnosis.summary}."
        leader = diagnosis.rounds[0].rejected if diagnosis.rounds else None
        if leader is not None:
            why = diagnosis.rounds[0].rejection
            return (
                "The misfit is more than noise. No known effect can be named as its cause: "
                f"{leader} explains most, but {why}."
            )
        return "The misfit is more than noise, and no known effect explains it."
    if verdict == NONE:
        return "No effect is missing as far as these records show: the residual of the calibrated model is noise."
    failed = [gate.name for gate in diagnosis.gates if not gate.passed]
    rivals = [name for one in diagnosis.rounds if one.chosen in diagnosis.closest for name in one.rivals]
    names = " or ".join(dict.fromkeys([*diagnosis.closest, *rivals]))
    leader = f"; {names} would explain most" if diagnosis.closest else ""
    return f"No diagnosis: a condition fails ({', '.join(failed)}){leader}." if failed else "No diagnosis."


def _cause(name: str, diagnosis: DiagnosisResult) -> str:
    """Write a named cause with its equation and its sizes."""
    if name == OUTLIERS:
        return f"{OUTLIERS}, {percent(diagnosis.outliers)} of the samples"
    if name == QUANTISATION and diagnosis.rounding:
        return f"{QUANTISATION}, {percent(diagnosis.rounding)} of the noise of a channel"
    suspect = next((one for one in diagnosis.suspects if one.effect == name), None)
    known = diagnosis.joint_sizes.get(name) or suspect
    equation = f" ({suspect.equation})" if suspect is not None and suspect.equation else ""
    return f"{name}{equation}" if known is None else f"{name}{equation}, {', '.join(sizes(known))}"


def points(diagnosis: DiagnosisResult, with_force_plots: bool = True, takes_laws: bool = True) -> list[str]:
    """Sentences on what the verdict rests on, and what follows from it.

    with_force_plots : whether the page shows the missing acceleration
    takes_laws : whether the simulator takes force laws
    """
    failed = [gate for gate in diagnosis.gates if not gate.passed]
    sentences = [f"{capitalised(gate.name)}: {gate.summary}. What to do: {remedy(gate)}." for gate in failed]
    if diagnosis.misfit is not None and not failed:
        sentences.append(_excess(diagnosis.misfit, diagnosis))
    sentences += [*level_trends(diagnosis), *_untried(diagnosis), *_remainder(diagnosis), *left_out(diagnosis)]
    if diagnosis.verdict == NONE and diagnosis.suspects:
        sentences.append(
            "An effect of the smallest detectable size in the table below, or larger, would have been found."
        )
    if diagnosis.verdict == UNEXPLAINED:
        own = (
            "calib discover looks for the missing force, as a free function on each body; "
            "an effect that is no candidate yet is added as one file (calib new effect)."
        )
        if not takes_laws:
            own = (
                "the simulator takes no force laws: an effect that is no candidate yet is one of the sensors, or one "
                'that changes parameters of the simulator (site "structure"), such as that of a term it has itself.'
            )
        figures = "The figures of the missing acceleration show the form that a law would need"
        sentences.append(f"{figures}; {own}" if with_force_plots else capitalised(own))
    elif takes_laws and diagnosis.misfit is not None and added(diagnosis) and _leaves_misfit(diagnosis.misfit):
        sentences.append(DISCOVER_REST)
    sentences += [*_faults(diagnosis), *_extension(diagnosis)]
    if diagnosis.verdict == ONE_OF and diagnosis.design is not None:
        sentences.append(f"{proposal(diagnosis.measurements)}.")
    return sentences


def _untried(diagnosis: DiagnosisResult) -> list[str]:
    """What the budget left untried; that it was spent stands in the headline."""
    if not diagnosis.omitted:
        return []
    advice = " A larger budget (--budget) may name another cause, or a further one." if diagnosis.cut_short else ""
    return [f"Left out for the budget: {'; '.join(diagnosis.omitted)}.{advice}"]


def _faults(diagnosis: DiagnosisResult) -> list[str]:
    """Sentences on faults of the records: gross errors of responses, outliers and quantisation."""
    sentences = [
        f"{capitalised(gross_errors_text(gross.record, gross.points, gross.numbers, gross.frequencies))}."
        for gross in diagnosis.gross_errors
    ]
    if diagnosis.outliers:
        outliers = percent(diagnosis.outliers)
        sentences.append(f"{outliers} of the samples are outliers; they were removed before every fit.")
    if diagnosis.rounding:
        sentences.append(
            f"The samples of a channel lie on the steps of its converter, which make {percent(diagnosis.rounding)} of "
            "its noise: measure with a finer range; the model needs no change for it."
        )
    return sentences


def _extension(diagnosis: DiagnosisResult) -> list[str]:
    """Sentences on what the extension of the model changes."""
    gain = diagnosis.gain
    if gain is None:
        return []
    sentences = [] if gain.before is None else [_misfit_change(gain)]
    if diagnosis.verdict in (NAMED, ONE_OF) or diagnosis.stand_ins:
        sentences += [*disagreements(diagnosis), *moved_sizes(diagnosis)]
        if moved_values(gain):
            sentences.append(
                f"With {joined(added(diagnosis)) or 'the extension'}, calibrated values move by more than two standard "
                "errors of this diagnosis (±: two standard errors): "
                f"{'; '.join(moved_values(gain))}."
            )
    return sentences


def proposal(measurements: Sequence[MeasurementResult]) -> str:
    """Propose the measurement that would distinguish the alternatives, or say that none within the bounds does."""
    if not measurements:
        return "To measure next: unknown, because the models could not be simulated in any other measurement"
    best = measurements[0]
    if best.z_max >= DECISIVE_Z:
        return f"To measure next: {best.description}, {best.prediction}"
    decisive = [m.z_max for m in measurements if m.z_max >= DECISIVE_Z]
    most = max(m.z_max for m in measurements if m.z_max < DECISIVE_Z)
    text = f"To measure next: no measurement within the bounds would distinguish them (z = {most:.2g} at most)"
    if not decisive:
        return text
    return f"{text}; derivatives alone predict up to z = {max(decisive):.2g}, which simulations do not confirm"


def _excess(misfit: MisfitResult, diagnosis: DiagnosisResult) -> str:
    """Say how large a residual the models leave, in units of the noise."""
    chance = 1.0 / misfit.chi2_std  # standard deviation of the root mean square of noise
    text = "The residual of the calibrated model, whitened by the noise, has a root mean square of "
    text += f"{_rms_over_noise(misfit.excess_chi2, misfit)} (noise alone: 1 ± {number(chance, 1)})"
    if not added(diagnosis):
        return f"{text}."
    share = f"{explained(misfit.share)} of the excess chi-square is explained"
    return (
        f"{text}; with {_extension_names(diagnosis)} it is {_rms_over_noise(misfit.remaining_chi2, misfit)}: {share}."
    )


def _leaves_misfit(misfit: MisfitResult) -> bool:
    """Whether the extended model leaves more than noise."""
    return significant(misfit.remaining_chi2, misfit.chi2_std)


def _rms_over_noise(excess: float, misfit: MisfitResult) -> str:
    """Write the root mean square of a whitened residual, from its excess chi-square."""
    samples = 0.5 * misfit.chi2_std**2  # a chi-square of noise has the variance 2 N
    return number(math.sqrt(max(0.0, 1.0 + excess / samples)), 3)


def _remainder(diagnosis: DiagnosisResult) -> list[str]:
    """Say where most of the remainder is, and by how much it may bias the sizes."""
    remainder = diagnosis.remainder
    if remainder is None or not remainder.above_noise:
        return []
    whole = sum(row.beyond_noise for row in remainder.rows)
    if not whole > 0.0:
        return []
    most = max(remainder.rows, key=lambda row: row.beyond_noise)
    text = "The remaining misfit is more than noise"
    if len(remainder.rows) > 1:
        where = f"{most.channel} of {most.body} in {most.record}"
        text += f"; {percent(most.beyond_noise / whole)} of it is in the {where}"
    if not added(diagnosis):
        return [f"{text}."]
    text += ". Standard errors allow for it, but unmodelled effects can bias sizes by more"
    biases = [
        f"{name} by {size_text(joint, name, bias)}"
        for joint in diagnosis.joint_sizes.values()
        for name, bias in joint.bias.items()
        if bias
    ]
    at_most = f", in 95\u00a0% of cases by no more than this: {', '.join(biases)}" if biases else ""
    return [f"{text}{at_most}."]


def left_out(diagnosis: DiagnosisResult) -> list[str]:
    """Say which effects explain part of what the named ones leave, and why they are not named."""
    if diagnosis.verdict not in (NAMED, ONE_OF, UNEXPLAINED):
        return []
    small = (
        f"an effect that explains less than {percent(MIN_EXPLAINED_SHARE)} of the remaining misfit may only resemble "
        "its cause."
    )
    sentences = []
    for one in diagnosis.left_out:
        decide = f"{small} A record in which {one.effect} explains a larger share would decide."
        reason = f"{one.reason}, so that it imitates another cause (a stand-in)." if one.reason else decide
        share = "an unknown share" if one.share is None else percent(one.share)
        sentences.append(
            f"Of the excess chi-square that may remain beside {joined(one.beside)}, {one.effect} explains {share}. "
            f"It is not named: {reason}"
        )
    return sentences


def is_heterogeneous(diagnosis: DiagnosisResult) -> bool:
    """Whether the closest effects have sizes that differ among the records or their channels."""
    return diagnosis.verdict == UNEXPLAINED and bool(diagnosis.stand_ins)


def added(diagnosis: DiagnosisResult) -> list[str]:
    """Names of the effects in the extended model."""
    best = diagnosis.classes[0] if diagnosis.verdict == ONE_OF and diagnosis.classes else ()
    faults = {OUTLIERS, *([QUANTISATION] if diagnosis.rounding else [])}
    return [name for name in diagnosis.causes or diagnosis.closest or best if name not in faults]


def _extension_names(diagnosis: DiagnosisResult) -> str:
    names = joined(added(diagnosis))
    several = diagnosis.verdict == ONE_OF and len(diagnosis.classes) > 1
    return f"the best of them, {names}," if several else names


def named_extension(diagnosis: DiagnosisResult) -> str:
    """Name the extended model."""
    return f"with {_extension_names(diagnosis).rstrip(',')}" if added(diagnosis) else "extended"


def _misfit_change(gain: GainResult) -> str:
    """Say how the misfit changes on data that the diagnosis did not use."""
    where = f"records held out ({', '.join(gain.records)})"
    if not gain.kind.startswith("records"):
        where = f"{gain.kind} (weak evidence: no record was held out)"
    text = f"On {where} the misfit changes from {percent(gain.before, 3)} to {percent(gain.after, 3)}"
    low, high = gain.interval
    if low is not None and high is not None:
        text += f": {_interval_of_change(100.0 * low, 100.0 * high)} percentage points (95\u00a0% interval)"
        text += ", which includes zero: the gain is not significant" if low <= 0.0 <= high else ""
    return f"{text}. Misfit: {gain.metric}; {REFITTED}."


def _interval_of_change(low: float, high: float) -> str:
    """Interval of a reduction as an engineer says it: the direction in words, the numbers positive."""
    if low <= 0.0 <= high:
        return f"between {number(-low, 2)} more and {number(high, 2)} less, in"
    digits = distinguishing_digits(low, high)
    return (
        f"less by {number(low, digits)} to {number(high, digits)}"
        if low > 0.0
        else f"more by {number(-high, digits)} to {number(-low, digits)}"
    )


def stale(diagnosis: DiagnosisResult | DiscoveryResult, result: CalibrationResult) -> bool:
    """Whether the values that were diagnosed are no longer the calibrated ones."""
    then, now = diagnosis.values, result.values
    return any(n in then and not math.isclose(then[n], x, rel_tol=MAX_RELATIVE_CHANGE) for n, x in now.items())


def remedy(gate: GateResult) -> str:
    """What to do where a condition fails."""
    return REMEDIES.get(gate.name, REFINE)
