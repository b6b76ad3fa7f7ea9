"""What a diagnosis came to, in sentences."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.measurement import DECISIVE_Z
from calib.diagnosis.preparation import OUTLIERS, QUANTISATION
from calib.diagnosis.verdict import NAMED, NONE, ONE_OF, UNEXPLAINED, explained, joined
from calib.report.words import number, percent, quantity
from calib.study import CalibrationResult

LEAST_SHARE = CRITERIA.min_over_remainder / (1.0 + CRITERIA.min_over_remainder)  # of a remainder, by a cause  [1]
HALF_WIDTH = 1.96  # of a 95 % interval of a normal distribution, in standard errors
TWO_ERRORS = 2.0  # written with calibrated values, beyond which they are said to move  [standard errors]
MAX_ABSORBED = 0.995  # share of a signature that calibration takes over, above which a size by score is none  [1]
MAX_LISTED = 4  # records whose own sizes a sentence gives
SAME = 1e-9  # relative difference of values that are the same
REFITTED = "before, the calibrated model is refitted to the records as the diagnosis weighs them"
REMEDIES = {
    "simulation": "find out why the simulation ends this way at the calibrated values (a larger step budget may do), "
    "or calibrate again with narrower windows",
    "kind of motion": "calibrate until the simulated motion is of the measured kind (wider windows, a larger budget): "
    "differences between motions of different kinds name no cause",
    "noise": "record more samples, best three cycles of the motion or more, or state the noise in the record "
    "(displacement_sigma, velocity_sigma)",
}
REFINE = (
    "make the simulator's step or tolerance finer in [model] and calibrate again: as it is, an error of the solver "
    "would be taken for physics"
)


def headline(said: Mapping[str, Any]) -> str:
    """Say the verdict in a sentence."""
    verdict, known = said["verdict"], {suspect["effect"]: suspect for suspect in said["suspects"]}
    if verdict == NAMED:
        found = []
        for name in said["causes"]:
            if name == OUTLIERS:
                found.append(f"{OUTLIERS}, {percent(said['outliers'])} of the samples")
                continue
            if name == QUANTISATION and said.get("rounding"):
                found.append(f"{QUANTISATION}, {percent(said['rounding'])} of the noise of a channel")
                continue
            joint = said.get("joint_sizes", {}).get(name)
            written = sizes(joint) if joint else sizes(known[name]) if name in known else []
            equation = known[name].get("equation") if name in known else ""
            given = [f" ({equation})" if equation else "", f", {', '.join(written)}" if written else ""]
            found.append(f"{name}{''.join(given)}")
        return f"{'Missing in the model' if added(said) else 'In the records'}: {'; and '.join(found)}."
    if verdict == ONE_OF:
        apart = "these records do not tell alternatives apart" if len(said["class"]) > 1 else "one record is not enough"
        return f"Something is missing, and {apart}: {said['said']}."
    if verdict == UNEXPLAINED:
        if said["closest"]:
            return f"No known effect can be named as the cause: {said['said']}."
        return "The misfit is more than noise, and no effect that is known here explains it."
    if verdict == NONE:
        return "Nothing that could be named is missing: what the calibrated model leaves is what noise leaves."
    failed = [gate["name"] for gate in said["gates"] if not gate["passed"]]
    alike = [name for found in said["rounds"] if found["chosen"] in said["closest"] for name in found["rivals"]]
    leader = f"; {' or '.join(dict.fromkeys([*said['closest'], *alike]))} would explain most" if said["closest"] else ""
    return f"No diagnosis: a condition fails ({', '.join(failed)}){leader}." if failed else "No diagnosis."


def points(said: Mapping[str, Any], pictured: bool = True) -> list[str]:
    """Say what the verdict rests on, and what follows from it.

    pictured : whether the page shows the acceleration that the simulation lacks
    """
    found = [f"{_capital(g['name'])}: {g['said']}. What to do: {remedy(g)}." for g in said["gates"] if not g["passed"]]
    misfit, gain = said["misfit"], said["gain"]
    if misfit and not found:
        found.append(_excess(misfit, said))
    found += _remains(said)
    found += left_out(said)
    if said["verdict"] == NONE and said["suspects"]:
        found.append("An effect as large as the smallest size seen in the table below would have been found.")
    if said["verdict"] == UNEXPLAINED:
        own = "an effect of your own is one file (calib list shows those there are)."
        pictures = "The pictures of the acceleration that the simulation lacks show what a law would have to look like"
        found.append(f"{pictures}; {own}" if pictured else _capital(own))
    if said.get("outliers"):
        taken = f"{percent(said['outliers'])} of the samples lie far from all others"
        found.append(f"{_capital(taken)}: they were taken out before anything was fitted.")
    if said.get("rounding"):
        found.append(
            f"The samples of a channel lie on the steps of its converter, which make {percent(said['rounding'])} of "
            "its noise: a finer range would measure better; the model needs no change for it."
        )
    if gain and gain["before"] is not None:
        found.append(_gained(gain))
    if gain and (said["verdict"] in (NAMED, ONE_OF) or said.get("stand_ins")):
        found += disagreements(said)
        found += moved_sizes(said)
        if moved_values(gain):
            found.append(
                f"With {joined(added(said)) or 'the extension'}, calibrated values move by more than two standard "
                "errors of this diagnosis (±: two standard errors): "
                f"{'; '.join(moved_values(gain))}."
            )
    if said["verdict"] == ONE_OF and said.get("design") is not None:
        found.append(f"{proposal(said['measurements'])}.")
    return found


def disagreements(said: Mapping[str, Any]) -> list[str]:
    """Say of which causes the records, each alone, have different sizes."""
    gain = said["gain"] or {"transfers": ()}
    apart = [one["parameter"] for one in gain.get("agreements", ()) if not one["agree"]]
    names = [name for name, joint in said.get("joint_sizes", {}).items() if set(joint["size"]) & set(apart)]
    if not names:
        return []
    found = []
    for parameter in apart:
        own = [t for t in gain["transfers"] if t["parameter"] == parameter and None not in (t["size"], t["error"])]
        unit = next((j["units"].get(parameter) for j in said["joint_sizes"].values() if parameter in j["size"]), None)
        each = [f"{quantity(t['size'], unit, half=half_width(t))} in {t['record']}" for t in own]
        more = f" and {len(each) - MAX_LISTED} more" if len(each) > MAX_LISTED else ""
        found.append(f"{parameter} = {', '.join(each[:MAX_LISTED])}{more}" if each else parameter)
    return [
        f"The records, each alone, disagree on the size of {joined(names)} ({'; '.join(found)}; 95\u00a0% "
        "intervals by Student's t): something that acts alike and is not modelled changes it, or is the cause; the "
        f"interval of {_fitted_size(gain['transfers'], apart)} does not count that{_biased(said, apart)}."
    ]


def _biased(said, parameters):
    """By how much sizes may be off that the records disagree on, as the end of a sentence; earlier versions: ""."""
    found = [
        f"{name} by no more than {quantity(HALF_WIDTH * joint['bias'][name], joint['units'].get(name), 2)}"
        for joint in said["joint_sizes"].values()
        for name in parameters
        if joint.get("bias", {}).get(name)
    ]
    return f"; in 95\u00a0% of cases it biases {joined(found)}" if found else ""


def _fitted_size(transfers, parameters):
    """Name the size that the model has: that of the only record it was fitted to, or that common to several."""
    fitted = dict.fromkeys(t["record"] for t in transfers if t["parameter"] in parameters and not t["held"])
    return f"the size that {next(iter(fitted))} alone has" if len(fitted) == 1 else "the common size"


def moved_sizes(said: Mapping[str, Any]) -> list[str]:
    """Say which sizes leave their own 95 % interval where other causes are fitted beside them."""
    alone = {suspect["effect"]: suspect for suspect in said["suspects"] if suspect["refitted"]}
    fitted, found = said.get("joint_sizes", {}), []
    for name, joint in fitted.items() if len(fitted) > 1 else ():
        known = alone.get(name)
        for parameter, size in joint["size"].items():
            low, high = (known["interval"].get(parameter) if known else None) or (None, None)
            limits = joint.get("limits", {}).get(parameter) or (None, None)
            if None in (low, high, size) or low <= size <= high or _at_limit(size, limits):
                continue
            [own] = [text for text in sizes(known) if text.startswith(f"{parameter} = ")] or [parameter]
            [beside] = [text for text in sizes(joint) if text.startswith(f"{parameter} = ")] or [parameter]
            found.append(f"{own} alone and {beside.removeprefix(f'{parameter} = ')} beside the others")
    if not found:
        return []
    return [f"Causes fitted together change each other's sizes by more than their intervals: {'; '.join(found)}."]


def half_width(transfer: Mapping[str, Any]) -> float:
    """Half width of the 95 % interval of the size that a record alone has; earlier versions wrote its error only."""
    return transfer.get("half_width") or HALF_WIDTH * transfer["error"]


def biased_half_width(transfer: Mapping[str, Any]) -> float:
    """The same, wider by what the model leaves in the record, which may bias its size."""
    return math.hypot(half_width(transfer), HALF_WIDTH * (transfer.get("bias") or 0.0))


def moved_values(gain: Mapping[str, Any]) -> list[str]:
    """Write calibrated parameters that move by more than two standard errors in the extended model: both values."""
    return [
        f"{s['parameter']} from {_with_errors(s, 'before')} to {_with_errors(s, 'after')}"
        for s in gain["shifts"]
        if s["errors"] is not None and abs(s["errors"]) > TWO_ERRORS
    ]


def _with_errors(shift, which):
    """Write a calibrated parameter before or after with two standard errors; earlier versions wrote none."""
    error = shift.get(f"{which}_error")
    return quantity(shift[which], shift.get("unit"), half=None if error is None else TWO_ERRORS * error)


def proposal(measurements: Sequence[Mapping[str, Any]]) -> str:
    """What to measure next to distinguish the alternatives, or that nothing that was tried does."""
    if not measurements:
        return "To measure next: unknown, for the models could not be simulated in any other measurement"
    best = measurements[0]
    if best["z_max"] >= DECISIVE_Z:
        return f"To measure next: {best['description']}, {best['prediction']}"
    most = max(m["z_max"] for m in measurements)
    return f"To measure next: nothing within the bounds would distinguish them (z = {most:.2g} at most)"


def _excess(misfit, said):
    """Say how large a residual the models leave, in units of the noise."""
    chance = 1.0 / misfit["blur"]  # standard deviation of the root mean square of noise
    text = "Whitened by the noise, what the calibrated model leaves has a root mean square of "
    text += f"{_over_noise(misfit, 'excess')} (noise alone: 1 ± {number(chance, 1)})"
    if not added(said):
        return f"{text}."
    share = f"{explained(misfit['share'])} of the sum of squares beyond the noise is explained"
    return f"{text}; with {_which(said)} {_over_noise(misfit, 'left')}: {share}."


def _over_noise(misfit, which):
    """Write the root mean square of a whitened residual, from its excess chi-square."""
    samples = 0.5 * misfit["blur"] ** 2  # a chi-square of noise has the variance 2 N
    return number(math.sqrt(max(0.0, 1.0 + misfit[which] / samples)), 3)


def _remains(said):
    """Say where the most of what is left sits, and how far it may be trusted."""
    remains = said.get("remains") or {}
    if not remains.get("above_noise"):
        return []
    whole = sum(row["beyond_noise"] for row in remains["rows"])
    if not whole > 0.0:
        return []
    most = max(remains["rows"], key=lambda row: row["beyond_noise"])
    text = "What remains is more than noise"
    if len(remains["rows"]) > 1:
        where = f"{most['channel']} of {most['body']} in {most['record']}"
        text += f"; {percent(most['beyond_noise'] / whole)} of it is in the {where}"
    text += ". Standard errors count it, but a remainder that nobody has modelled can bias sizes beyond them"
    biases = [
        f"{name} by {quantity(HALF_WIDTH * bias, joint['units'].get(name), 2)}"
        for joint in said.get("joint_sizes", {}).values()
        for name, bias in joint.get("bias", {}).items()  # not written by earlier versions
        if bias
    ]
    at_most = f", in 95\u00a0% of cases by no more than this: {', '.join(biases)}" if biases else ""
    return [f"{text}{at_most}."]


def left_out(said: Mapping[str, Any]) -> list[str]:
    """Say which effects explain part of what the named ones leave, and why they are not named."""
    if said["verdict"] not in (NAMED, ONE_OF, UNEXPLAINED):
        return []
    return [
        f"Of the excess that {joined(one['beside'])} may leave, {one['effect']} explains {percent(one['share'])}. "
        f"It is not named: {_why_left_out(one)}"
        for one in said.get("left_out", ())  # not written by earlier versions
    ]


def _why_left_out(one: Mapping[str, Any]) -> str:
    if one.get("reason"):  # not written by earlier versions
        return f"{one['reason']}, so that it stands in for something else."
    small = f"an effect that explains less than {percent(LEAST_SHARE)} of a remainder may only resemble its cause."
    return f"{small} A record in which {one['effect']} acts more strongly would decide."


def inconstant(said: Mapping[str, Any]) -> bool:
    """Whether effects come closest whose sizes differ among the records or their channels."""
    return said["verdict"] == UNEXPLAINED and bool(said.get("stand_ins"))


def added(said: Mapping[str, Any]) -> list[str]:
    """Names of the effects in the extended model."""
    best = said["class"][0] if said["verdict"] == ONE_OF else ()
    seen = {OUTLIERS, *([QUANTISATION] if said.get("rounding") else [])}
    return [name for name in said["causes"] or said["closest"] or best if name not in seen]


def _which(said):
    names = joined(added(said))
    return f"the best of them, {names}," if said["verdict"] == ONE_OF and len(said["class"]) > 1 else names


def named_extension(said: Mapping[str, Any]) -> str:
    """Name the extended model."""
    return f"with {_which(said).rstrip(',')}" if added(said) else "extended"


def _gained(gain):
    where = f"records held out ({', '.join(gain['records'])})"
    if not gain["kind"].startswith("records"):
        where = f"{gain['kind']} (weak evidence: no record was held out)"
    text = f"On {where} the misfit goes from {percent(gain['before'], 3)} to {percent(gain['after'], 3)}"
    if None not in gain["interval"]:
        low, high = gain["interval"]
        change, ends = ("more", (-high, -low)) if high < 0.0 else ("less", (low, high))
        first, last = (number(100.0 * end, 2) for end in ends)
        text += f": {change} by {first} to {last} percentage points (95\u00a0% interval)"
        text += ", which includes zero: the gain is not proven" if low <= 0.0 <= high else ""
    return f"{text}. Misfit: {gain['metric']}; {REFITTED}."


def stale(said: Mapping[str, Any], result: CalibrationResult) -> bool:
    """Whether the values that were diagnosed are no longer the calibrated ones."""
    then, now = said.get("values") or {}, result.values
    return any(name in then and not math.isclose(then[name], value, rel_tol=SAME) for name, value in now.items())


def remedy(gate: Mapping[str, Any]) -> str:
    """What to do where a condition fails."""
    return REMEDIES.get(gate["name"], REFINE)


def untested(suspect: Mapping[str, Any]) -> bool:
    """Whether nothing is known of a suspect: it has no score test, and was not refitted."""
    return not suspect["refitted"] and all(x is None for x in suspect["detectable"].values())


def hardly_seen(suspect: Mapping[str, Any]) -> bool:
    """Whether calibration absorbs so much of an effect that its score says nothing of a size, nor does its refit."""
    explains = suspect["refitted"] and (suspect["share"] or 0.0) > CRITERIA.negligible_share
    return suspect["absorbed"] > MAX_ABSORBED and not explains


def sizes(suspect: Mapping[str, Any]) -> list[str]:
    """Write the sizes of a suspect with their 95 % intervals and units, of those that show in the records at all.

    A size at an end of its range has no interval to both sides: that is said in its place.
    """
    written = []
    for name, size in suspect["size"].items():
        ends, unit = suspect["interval"].get(name) or (None, None), suspect["units"].get(name)
        if size is None or None in ends:
            continue
        if _at_limit(size, suspect.get("limits", {}).get(name) or (None, None)):
            written.append(f"{name} = {quantity(size, unit)}, the end of its range")
        else:
            written.append(f"{name} = {quantity(size, unit, half=0.5 * (ends[1] - ends[0]))}")
    return written or _without_intervals(suspect) or ["-"]


def _without_intervals(suspect):
    """Write the sizes of a suspect that is in the model, where no derivative tells their intervals."""
    there = {n: x for n, x in suspect["size"].items() if x is not None and x != suspect.get("null", {}).get(n)}
    return [f"{name} = {quantity(size, suspect['units'].get(name))}" for name, size in there.items()]


def _at_limit(size, limits):
    """Whether a size is at the end of its range; 0, where an effect ends, is none."""
    return size != 0.0 and any(end is not None and math.isclose(size, end, rel_tol=1e-6) for end in limits)


def _capital(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}"
