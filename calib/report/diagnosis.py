"""The chapter of a page that tells a diagnosis: what is wrong, who was suspected, why this one, what it brings."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from calib.diagnosis.constancy import CHANNELS
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.excess import significant
from calib.diagnosis.laboratory import AMPLITUDE_RANGE, FREQUENCY_RANGE, RELEASE_RANGE
from calib.diagnosis.measurement import DECISIVE_Z
from calib.diagnosis.verdict import explained, joined
from calib.report import causes, drawing, missing_force, residual_plots, separation
from calib.report.conclusion import (
    NAMED,
    NONE,
    ONE_OF,
    UNEXPLAINED,
    added,
    hardly_seen,
    headline,
    inconstant,
    named_extension,
    points,
    remedy,
    sizes,
    stale,
    untested,
)
from calib.report.picture import pictured
from calib.report.words import count, number, percent, quantity, raised, rounded, signed, with_error
from calib.study import CalibrationResult
from calib.units import reading

TONES = {NAMED: "good", NONE: "good", ONE_OF: "mind", UNEXPLAINED: "mind"}
QUESTIONS = {NAMED: "Why this one", ONE_OF: "Why these", NONE: "Why nothing", UNEXPLAINED: "Why none of them"}
MIN_SHOWN_Z = 3.0  # of a feature that is shown at once  [standard errors]
MOST = 12  # features shown at once
MOSTLY = 0.995  # share that is no longer written as whole per cent, which would make it all  [1]
SMALL_Z = 1.0  # of a predicted separation, below which it is written to two digits  [standard deviations]
ENOUGH = 10  # suspects shown at once

RESIDUALS = (
    "Measured less simulated: dots are samples, the blue line is the mean of the cycles{extended}, the grey band two "
    "standard deviations of the noise, the darker one that of the mean{impacts}. Bars: amplitudes of the mean's "
    "harmonics; blue ones stand clear of what noise leaves in 19 of 20 cases (grey)."
)
RESIDUALS_IN_TIME = (
    "Measured less simulated over time: grey dots by the calibrated model{extended}; the grey band is two standard "
    "deviations of the noise."
)
GREEN = ", green by the extended one"
IMPACTS = "; where the ground is orange, next to impacts, velocity is not compared"
LOOPS = (
    "Measured phase curves, coloured by the local misfit: the residuals of displacement and velocity, each averaged "
    "over a thirtieth of the {stretch}, root mean square over both, in standard deviations of such an average. About"
    " 1 is noise."
)
FORCES = (
    "Acceleration that the simulation of {body} lacks, measured less simulated at the same instant (derivative of the"
    " residual velocity, by parabolas through neighbouring samples of the {stretch}; impacts left out): over the "
    "plane of its states, and in bins of displacement and of velocity with two standard errors. It holds the missing "
    "force per unit mass together with what the springs and dampers answer to the motion that differs, so near a "
    "resonance a force is seen a quarter of a period late."
)
UNCERTAIN = "nothing stands clear of the uncertainty that differences of the velocity give to this acceleration."
SUSPECTS = (
    "How strongly each effect shows in the residuals, what calibrated parameters and nuisances absorb taken out. "
    "Above the dashed line it is more than noise would make the strongest of them in 99 of 100 cases."
)
MAGNIFIED = (
    "The extended model's phase curves (green), and how far from them the calibrated model (blue) and the measured "
    "curve (grey, averaged over a thirtieth of the cycle) lie, magnified as the titles say: the extension is right "
    "where the dots lie on the green line and not on the blue one."
)
GAIN = (
    "Misfit of what had no part in finding the cause, before and after; only nuisances of those records were solved "
    "for."
)
TRANSFERS = (
    "Size of the effect refitted to each record alone, all other parameters free, with its 95\u00a0% interval by "
    "Student's t; a record that does not tell it from these has none. What the model leaves in a record may bias its "
    "size: the pale bar counts that too. A law of nature has one size in all of them: an effect whose sizes "
    f"differ by more than {percent(CRITERIA.max_variation)} (standard deviation over mean) is a stand-in for another "
    "cause. Up to that, what is not modelled may have made them differ, where the fit shows that something is not: it "
    "leaves more than noise, or its own records disagree."
)
SHIFTS = (
    "By how many of their standard errors, as this diagnosis weighs the records, the calibrated parameters move once "
    "the cause is in the model; grey band: two standard errors. One that moves further may have made up for what was "
    "missing, or the cause takes over its part."
)
SEPARATION_MAP = (
    "Predicted separation of the two least distinguishable explanations by a steady tone, over its frequency and "
    "amplitude: by how many standard deviations of the noise their records would differ once each is refitted to that "
    "record too. Cells: a regular grid; dots: refinement about the best. The white line is where z = 3, from which "
    "models are taken as distinguishable. Noise is in proportion to the motion, as in the records."
)
SEPARATION_LINES = (
    "Predicted separation z of the two least distinguishable explanations by tests that are searched over one setting; "
    "star: the best, as confirmed by simulation at the refitted parameters; dashed: z = 3; hollow: z is "
    "below 0.1; cross: no regular motion, or a failed simulation."
)
NAMES = {"amplitude": "amplitude", "frequency": "frequency", "release": "displacement of release"}


def chapter(
    said: Mapping[str, Any],
    motions: Mapping[str, xr.Dataset],
    result: CalibrationResult,
    study: Any,
) -> dict[str, Any]:
    """Everything that the page shows of a diagnosis.

    Parameters
    ----------
    said : what diagnosis.json holds
    motions : what diagnosis.nc holds; may be empty
    result : of the calibration
    study : read are its model's parameters and the attributes of its records
    """
    outcomes = {suspect["effect"]: outcome(suspect, said) for suspect in said["suspects"]}
    forces = _forces(motions)
    return {
        "verdict": said["verdict"].replace("_", " "),
        "tone": TONES.get(said["verdict"], "bad"),
        "headline": headline(said),
        "points": points(said, pictured=any(force["telling"] for force in forces)),
        "stale": stale(said, result),
        "gates": [_gate(gate, motions) for gate in said["gates"]],
        "residuals": _residuals(motions, named_extension(said)),
        "loops": pictured(
            residual_plots.misfit_loops(motions), "misfit-loops", LOOPS.format(stretch=_stretch(motions))
        ),
        "forces": forces,
        "features": _features(said),
        "strengths": _strengths(said, outcomes),
        "suspects": _suspects(said, outcomes),
        "refused": said["refused"],
        "rounds": _rounds(said),
        "finally": _finally(said),
        "why": _why(said, outcomes),
        "magnified": pictured(
            residual_plots.magnified_loops(motions, named_extension(said)), "magnified-loops", MAGNIFIED
        ),
        "next_measurement": _next_measurement(said),
        "question": QUESTIONS.get(said["verdict"], "How it was sought"),
        "brings": _brings(said, study.model.parameters),
        "effort": f"{count(said['simulations'], 'simulation')} in {said['seconds']:.0f} s",
    }


# --- what is wrong ---------------------------------------------------------------------------------------------------


def _gate(gate, motions):
    text = gate["said"]
    if gate["name"] == "noise" and gate["passed"] and motions:
        known = [
            (motion, row)
            for motion in motions.values()
            for row, *_ in residual_plots.rows(motion)
            if np.std(motion.measured.values[row]) > 0.0
        ]
        sources = [str(motion.source.values[row]) for motion, row in known if "source" in motion.coords]
        if known:
            levels = [float(motion.sigma[row]) / float(np.std(motion.measured.values[row])) for motion, row in known]
            ends = dict.fromkeys(percent(x, 2) for x in (min(levels), max(levels)))
            text = f"{' to '.join(ends)} of the standard deviation of the channel, in {count(len(levels), 'channel')}"
            text += f" ({', '.join(dict.fromkeys(sources))})" if sources else ""
    return {
        "name": gate["name"],
        "passed": gate["passed"],
        "tried": gate.get("tried", True),  # not written by earlier versions
        "said": text,
        "remedy": "" if gate["passed"] else remedy(gate),
    }


def _residuals(motions, label):
    """Pictures of each record's residual, the worst record first; label: of the extended model."""
    found = []
    for name in sorted(motions, key=lambda name: -residual_plots.strength(motions[name])):
        motion = motions[name]
        skipped = any(not motion.weight.values[row].all() for row, *_ in residual_plots.rows(motion))
        caption = RESIDUALS if "period" in motion.attrs else RESIDUALS_IN_TIME
        caption = caption.format(impacts=IMPACTS if skipped else "", extended=GREEN if "extended" in motion else "")
        picture = pictured(residual_plots.residuals(motion, label), f"diagnosed-{name}", caption)
        if picture is not None:
            found.append({"record": name, "picture": picture})
    return found


def _forces(motions):
    """Picture of what remains of each body, of the records in which it stands clear of noise, or else of all."""
    found = []
    for body in dict.fromkeys(body for motion in motions.values() for body in residual_plots.pairs(motion)):
        known = missing_force.accelerations(motions, body)
        clear = {name: force for name, force in known.items() if missing_force.stands_clear(force)}
        caption = FORCES.format(body=body, stretch=_stretch({name: motions[name] for name in clear or known}))
        hidden = [name for name in known if name not in clear]
        if hidden:
            caption += f" {', '.join(hidden)}: {UNCERTAIN}"
        picture = pictured(missing_force.forces(clear or known), f"force-{body}", caption)
        if picture is not None:
            found.append({"body": body, "telling": bool(clear), "picture": picture})
    return found


def _stretch(motions):
    """What is drawn of the records: the mean cycle of those that have a period, the whole of the others."""
    kinds = {"mean cycle" if "period" in motion.attrs else "record" for motion in motions.values()}
    return " or, without a period, ".join(sorted(kinds))


def _features(said):
    """Rows of the table of features: those shown at once, and the rest."""
    rows = [_feature(feature) for feature in said["misfit"].get("features", ())]
    marked = [row for row in rows if row["marked"]][:MOST] or rows[:3]
    return {"marked": marked, "rest": rows[len(marked) :]}


def _feature(feature):
    factor, unit = reading(feature["unit"], max(abs(feature[key] or 0.0) for key in ("measured", "simulated")))
    values = [None if feature[key] is None else factor * feature[key] for key in ("measured", "simulated", "error")]
    measured, simulated, error = values
    predicted = simulated if None in (feature["z"], error) else measured + feature["z"] * error
    return {
        "label": feature["label"],
        "record": feature["record"],
        "body": feature["body"],
        "unit": raised(unit),
        "measured": with_error(measured, None if error is None else 2.0 * error),
        "predicted": rounded(predicted, error),
        "z": "-" if feature["z"] is None else signed(feature["z"], "+"),
        "marked": feature["z"] is not None and abs(feature["z"]) > MIN_SHOWN_Z,
    }


# --- who was suspected -----------------------------------------------------------------------------------------------


def outcome(suspect: Mapping[str, Any], said: Mapping[str, Any]) -> str:
    """What became of a suspect: one of the words of `calib.report.causes`."""
    name = suspect["effect"]
    if name in said["causes"]:
        return causes.NAMED
    if said["verdict"] == ONE_OF and any(name in names for names in said["class"]):
        return causes.CLASS
    if name in said["closest"] or name in _as_close(said):
        return causes.CLOSEST
    if hardly_seen(suspect):
        return causes.ABSORBED
    if suspect["z"] is None or said["threshold"] is None or abs(suspect["z"]) <= said["threshold"]:
        return causes.BELOW
    return causes.SENSELESS if suspect["z"] < 0.0 and _one_sided(suspect) else causes.LESS


def _as_close(said):
    """Names of suspects that are indistinguishable from those that come closest."""
    return {name for found in said["rounds"] if found["chosen"] in said["closest"] for name in found.get("rivals", ())}


def _one_sided(suspect):
    if len(suspect["null"]) != 1:
        return False
    [(name, null)] = suspect["null"].items()
    return null is not None and null in suspect["limits"][name]


def _suspects(said, outcomes):
    """Rows of the table of suspects: those shown at once, and the rest."""
    rank = {causes.NAMED: 0, causes.CLASS: 0, causes.CLOSEST: 0, causes.ABSORBED: 2}
    ordered = sorted(said["suspects"], key=lambda s: (rank.get(outcomes[s["effect"]], 1), -abs(s["z"] or 0.0)))
    rows = [_suspect(suspect, outcomes[suspect["effect"]], said) for suspect in ordered]
    shown = sum(row["fate"] not in (causes.BELOW, causes.ABSORBED) for row in rows)
    shown = len(rows) if said["verdict"] == NONE else min(max(shown, 3), ENOUGH)
    return {"shown": rows[:shown], "rest": rows[shown:]}


def _strengths(said, outcomes):
    if said["threshold"] is None:
        return None
    known = [(s, outcomes[s["effect"]]) for s in said["suspects"] if s["z"] is not None and not untested(s)]
    strengths = [(s["effect"], abs(s["z"]), fate) for s, fate in known if fate != causes.ABSORBED]
    return pictured(causes.suspects(strengths, said["threshold"]), "suspects", SUSPECTS)


def _suspect(suspect, fate, said):
    known = {name: value for name, value in suspect["held"].items() if value is not None}  # none: without limit
    held = [f"{name} = {quantity(value, suspect['units'].get(name))}" for name, value in known.items()]
    nothing_known = untested(suspect)
    misfit = said["misfit"]
    explains = significant(misfit["excess"], misfit["blur"]) and suspect["share"] is not None
    explains = explains and fate not in (causes.SENSELESS, causes.ABSORBED) and suspect["drop"] > 0.0
    return {
        "effect": suspect["effect"],
        "where": f"on {', '.join(suspect['bodies'])}" if suspect["bodies"] else "",
        "equation": suspect.get("equation", ""),
        "meaning": suspect.get("meaning", ""),
        "fate": fate,
        "colour": causes.COLOURS[fate],
        "bold": fate in (causes.NAMED, causes.CLASS, causes.CLOSEST),
        "z": "-" if nothing_known or suspect["z"] is None or fate == causes.ABSORBED else signed(suspect["z"]),
        "sizes": ["-"]
        if nothing_known or hardly_seen(suspect)
        else sizes(said.get("joint_sizes", {}).get(suspect["effect"], suspect)),
        "held": held,
        "share": explained(suspect["share"]) if explains else "-",
        "predicted": explains and not suspect["refitted"],
        "absorbed": "-" if nothing_known else _absorbed(suspect["absorbed"]),
        "detectable": []
        if hardly_seen(suspect)
        else [quantity(x, suspect["units"].get(name), 2) for name, x in suspect["detectable"].items() if x is not None],
        "reason": _reason(suspect, fate, said),
    }


def _absorbed(share):
    return explained(share) if share >= MOSTLY else percent(share)


def _reason(suspect, fate, said):
    if suspect["reason"] and fate not in (causes.NAMED, causes.CLASS):
        return suspect["reason"]
    if fate == causes.NAMED:
        rounds = [k for k, found in enumerate(said["rounds"], 1) if found["chosen"] == suspect["effect"]]
        return f"named in round {rounds[0]}" if rounds and len(said["causes"]) > 1 else "named"
    if fate == causes.CLASS:
        return (
            "not distinguishable from the others of the class" if len(said["class"]) > 1 else "one steady tone shows it"
        )
    if fate == causes.SENSELESS:
        [name] = suspect["null"]
        low, high = suspect["limits"][name]
        bound = "<" if suspect["null"][name] == low else ">"
        return f"would need {name} {bound} {number(suspect['null'][name])}"
    if fate == causes.LESS and suspect["effect"] in _left_out(said):
        return "explains too little beside what is named, or stands in for something else"
    if fate == causes.LESS:
        first = said["rounds"][0]["chosen"] if said["rounds"] else None
        alike = f"; {percent(suspect['alike'])} like {first}" if first and (suspect.get("alike") or 0.0) > 0.5 else ""
        exchanged = ", the choice of round 1" if alike and first not in added(said) else ""
        return f"explains less{alike}{exchanged}"
    if fate == causes.ABSORBED:
        later = [k for k, r in enumerate(said["rounds"], 1) if suspect["effect"] in (r["chosen"], r.get("rejected"))]
        if later:
            return f"without causes calibration absorbs it; see round {later[0]}"
        return "calibration absorbs it: these records hardly show it"
    if untested(suspect):
        return "calibration absorbs it but for what may be the error of its derivative"
    if fate == causes.CLOSEST:
        return "comes closest" if suspect["effect"] in said["closest"] else "comes as close"
    return "below the threshold"


# --- why this one ----------------------------------------------------------------------------------------------------


def _rounds(said):
    rows, known = [], []
    for found in said["rounds"]:
        rivals = [name for name in found["rivals"] if name != found["chosen"]]
        share = found.get("share")
        rows.append(
            {
                "model": " + ".join(["calibrated", *known]),
                "threshold": f"{found['threshold']:.2f}",
                "chosen": found["chosen"] or _none(found),
                "share": "-" if share is None else explained(share),
                "predicts": _predicts(found),
                "rivals": ", ".join(rivals) or "-",
            }
        )
        known += [found["chosen"]] if found["chosen"] else []
    for exchange in said.get("exchanges", ()):  # not written by earlier versions
        row = dict.fromkeys(("threshold", "share", "predicts", "rivals"), "-")
        if set(exchange["after"]) == set(added(said)):
            row |= {"share": explained(said["misfit"]["share"]), "predicts": "not tested", "rivals": _exchanged(said)}
        instead = f"{' + '.join(exchange['after'])} instead: {exchange['reason']}"
        rows.append({**row, "model": " + ".join(["calibrated", *exchange["before"]]), "chosen": instead})
    for one in said.get("left_out", ()):
        row = dict.fromkeys(("threshold", "share", "predicts", "rivals"), "-")
        known = ["calibrated", *one["beside"], one["effect"]]
        little = f"it explains {explained(one['share'])} of the excess that the others may leave: too little"
        why = one.get("reason") or little
        rows.append({**row, "model": " + ".join(known), "chosen": f"without {one['effect']}: {why}"})
    return rows


def _exchanged(said):
    """Names of what is indistinguishable from a cause of the final model beside its others."""
    own = added(said)
    names = [name for model in said["class"] for name in model if name not in own]
    return ", ".join(dict.fromkeys(names)) or "-"


def _finally(said):
    """What the causes together explain, refitted at the end: not what each did in its round."""
    if not added(said) or not said["misfit"].get("share"):
        return ""
    return f"{joined(added(said))}, refitted at the end, explain{'' if len(added(said)) > 1 else 's'} " + explained(
        said["misfit"]["share"]
    )


def _predicts(found):
    """Fall of the sum of squares on left-out data, with its standard error, over what it is without the cause."""
    test = found.get("prediction")
    if test is None or test["error"] is None or not test.get("without"):  # not written by earlier versions
        return "not tested" if found["chosen"] else "-"
    return f"{with_error(*(100.0 * test[key] / test['without'] for key in ('reduction', 'error')))} %"


def _none(found):
    """Why a search named nothing."""
    if not found.get("rejected"):
        return "none is above the threshold with a size that makes sense"
    return f"none: {found['rejected']} explains most, but {found['rejection']}"


def _left_out(said):
    return {one["effect"] for one in said.get("left_out", ())}


def _why(said, outcomes):
    """Sentences: what distinguishes the cause from the others, or why nothing does."""
    found = []
    last = next((r for r in reversed(said["rounds"]) if r["chosen"] and r["chosen"] not in _left_out(said)), None)
    if last is None:
        return found
    alike = [f"{name} {percent(x, 3)}" for name, x in (last.get("alike") or {}).items() if x is not None]
    if alike:
        found.append(
            f"How far what {last['chosen']} changes in these records, beyond what calibration absorbs, is like what "
            f"others change (cosine of the angle between signatures): {', '.join(alike)}."
        )
    if said["verdict"] == ONE_OF and len(said["class"]) == 1:
        found.append(
            "A steady tone repeats whatever the model lacks: leaving cycles out proves nothing, and no record held out "
            "shows whether the cause predicts. One at another amplitude or frequency would."
        )
    elif said["verdict"] == ONE_OF:
        found.append("With any one of them fitted, sums of squares differ too little: these records do not decide.")
    if said["verdict"] == UNEXPLAINED and said["closest"]:
        share = explained(max(0.0, said["misfit"]["share"]))
        found.append(
            f"Of the excess, {share} is explained by {joined(said['closest'])}. Named is what predicts, has one "
            "size in all records (of several causes, each in all their channels too), and leaves no more than noise, "
            f"or explains at least {CRITERIA.min_over_remainder:g} times what remains (of several, each)."
        )
    if said["misfit"].get("inconstancy") and added(said):
        found += _constancy(said)
    others = [s for s in said["suspects"] if outcomes[s["effect"]] == causes.LESS and s["share"] is not None]
    if said["verdict"] == NAMED and others:
        best = max(others, key=lambda s: s["share"])
        chosen, alike = said["rounds"][0]["chosen"], best.get("alike")
        told = alike is not None and chosen in said["causes"]
        alike = f"; its signature is {percent(alike)} like that of {chosen}" if told else ""
        beside = f" Beside {joined(added(said))} it is left out." if best["effect"] in _left_out(said) else ""
        found.append(
            f"Of the effects that are not named, {best['effect']} explains most on its own: "
            f"{explained(best['share'])} of the excess{'' if best['refitted'] else ' (estimate)'}{alike}.{beside}"
        )
    elif said["verdict"] == NAMED:
        found.append("No other effect is above the threshold with a size that makes sense.")
    return found


def _constancy(said):
    """Say whether the sizes differ among the channels; not that they do not where those of whole records disagree."""
    alone, z = _agreements(said["gain"]), said["misfit"]["inconstancy"]
    differ, of_records = inconstant(said) and z > said["threshold"], _is_a_channel_each(said)
    if not differ and (of_records and alone or not all(agreement["agree"] for agreement in alone)):
        return []
    names, how, end = added(said), "do not differ", ""
    if differ:
        how, end = "differ", " Effects may imitate another one, but hardly with one size everywhere."
    elif z > said["threshold"]:
        own = [c for c in said["misfit"].get("constancy", ()) if c.get("among", CHANNELS) == CHANNELS]
        most = max(own, key=lambda c: c["z"], default=None)
        which = f", most those of {most['effect']}," if most and len(names) > 1 else ""
        how = f"differ{which} by {percent(most['variation'])}" if most else "differ"
        if (said.get("remains") or {}).get("above_noise"):
            end = f" What is not modelled may make them differ by up to {percent(CRITERIA.max_variation)}."
    return [
        f"The sizes of {joined(names)} {how} among the {'records' if of_records else 'channels of the records'} "
        f"(Cochran's Q as a normal deviate: {number(z, 2)}, threshold {number(said['threshold'], 2)}).{end}"
    ]


def _is_a_channel_each(said):
    """Whether each record has one channel that is compared: then its channels are the records."""
    records = [channel["record"] for channel in said["misfit"].get("channels", ())]
    return bool(records) and len(set(records)) == len(records)


def _next_measurement(said):
    """Table and pictures of the search for the next measurement; None where there was none."""
    design, measurements = said.get("design"), said["measurements"]
    if design is None:
        return None
    kinds = {m["kind"]: m for m in reversed(measurements)}
    unavailable = [f"{kind}: {reason}" for kind, reason in design["unavailable"].items() if kind not in kinds]
    return {
        "rows": [_measurement(measurement) for measurement in measurements],
        "several": len(design["models"]) > 2,
        "map": pictured(separation.separation_map(design, measurements), "separation-map", SEPARATION_MAP),
        "lines": pictured(separation.separation_lines(design, measurements), "separation-lines", SEPARATION_LINES),
        "bounds": "; ".join(_bounds(variable) for variable in design["variables"]),
        "unavailable": "; ".join(unavailable),
        "effort": f"{count(len(design['points']), 'setting')} with {count(design['simulations'], 'simulation')} "
        f"(at most {design['max_simulations']})",
    }


def _measurement(measurement):
    return {
        "kind": measurement["kind"],
        "description": measurement["description"],
        **{key: "-" if measurement[key] is None else separated(measurement[key]) for key in ("z", "z_max", "z_refit")},
        "confirmed": measurement["confirmed"],
        "decisive": measurement["z"] >= DECISIVE_Z,
    }


def separated(z: float) -> str:
    """Write a predicted separation; a small one to two digits, as sentences about it do."""
    return number(z, 2) if abs(z) < SMALL_Z else signed(z)


def _bounds(variable):
    """Write the bounds of a setting, and where they come from."""
    low, high = (quantity(variable[end], variable["unit"]) for end in ("low", "high"))
    source = "stated in the study file"
    if not variable["stated"]:
        factors = {"amplitude": AMPLITUDE_RANGE, "frequency": FREQUENCY_RANGE, "release": RELEASE_RANGE}
        least, most = factors[variable["name"]]
        what = "the largest displacement" if variable["name"] == "release" else "that"
        source = f"derived: {least:g} to {most:g} times {what} of the records"
    return f"{NAMES[variable['name']]} {low} to {high} ({source})"


# --- what the extension brings ---------------------------------------------------------------------------------------


def _brings(said, parameters):
    gain = said["gain"]
    if gain is None:
        return None
    units = {name: unit for suspect in said["suspects"] for name, unit in suspect["units"].items()}
    joint = [
        (name, size, *(cause["interval"].get(name) or (None, None)))
        for cause in said.get("joint_sizes", {}).values()
        for name, size in cause["size"].items()
    ]
    common = {name: ends for name, *ends in joint if None not in ends}
    known = [transfer for transfer in gain["transfers"] if None not in (transfer["size"], transfer["error"])]
    return {
        "kind": gain["kind"],
        "failed": gain["failed"],
        "gain": pictured(causes.gain(gain), "gain", GAIN),
        "transfers": pictured(causes.transfers(known, common, units), "transfers", TRANSFERS),
        "agreement": [_agreement(one, gain, said) for one in _agreements(gain)],
        "shifts": pictured(causes.shifts(gain["shifts"]), "shifts", SHIFTS),
        "moved": [_shift(shift, parameters) for shift in gain["shifts"]],
    }


def _shift(shift, parameters):
    name = shift["parameter"]
    known = parameters.get(name.partition("@")[0])
    factor, unit = drawing.shown_unit(known.unit if known else "1", max(abs(shift["before"]), abs(shift["after"])))
    halves = [2.0 * factor * (shift.get(key) or 0.0) for key in ("before_error", "after_error")]
    return {
        "parameter": name,
        "before": with_error(factor * shift["before"], halves[0]),
        "after": with_error(factor * shift["after"], halves[1]),
        "unit": unit,
        "errors": "-" if shift["errors"] is None else signed(shift["errors"], "+"),
    }


def _agreements(gain):
    return [] if gain is None else gain.get("agreements", [])


def _agreement(found, gain, said):
    """Say whether the records agree on a size, by the deviate and the threshold that all of the diagnosis has."""
    own = [transfer for transfer in gain["transfers"] if transfer["parameter"] == found["parameter"]]
    within = " within what the model leaves in them may bias it by" if any(t.get("bias") for t in own) else ""
    text = (
        f"The records, each alone, {'agree' if found['agree'] else 'do not agree'} on {found['parameter']}{within} "
        f"(chi-square {number(found['chi2'], 3)} for {count(found['degrees'], 'degree')} of freedom, z = "
        f"{number(found['z'], 2)}, threshold {number(said['threshold'], 2)})"
    )
    if found["agree"] and inconstant(said) and said["misfit"]["inconstancy"] > said["threshold"]:
        return f"{text}; what differs are the channels within them."
    return f"{text}."
