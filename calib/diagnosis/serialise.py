"""A diagnosis as one JSON document."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from calib.diagnosis.candidate import Candidate
from calib.diagnosis.diagnose import Diagnosis
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.gain import Gain
from calib.diagnosis.gates import Gate
from calib.diagnosis.measurement import DECISIVE_Z, Measurement
from calib.diagnosis.misfit import Misfit
from calib.diagnosis.next_measurement import Design
from calib.diagnosis.search import Round
from calib.diagnosis.selection import Selection
from calib.diagnosis.suspect import Refitted, Scored, Suspect, cosine, leading_variants
from calib.diagnosis.verdict import NOT_DIAGNOSABLE, UNEXPLAINED
from calib.objective import MISFIT
from calib.store.plain import plain

MAX_HALF_WIDTH = 10.0  # of a 95 % interval, over the natural scale of its parameter: wider ones are undetermined  [1]


def _is_open(diagnosis: Diagnosis) -> bool:
    """Whether the causes that explain most are not named."""
    return diagnosis.verdict in (UNEXPLAINED, NOT_DIAGNOSABLE)


def as_dict(diagnosis: Diagnosis) -> dict[str, Any]:
    """Everything that diagnosis.json holds, in SI; what is not finite is None."""
    selection, evidence, deviations = diagnosis.selection, diagnosis.evidence, diagnosis.misfit
    first = selection.rounds[0] if selection else None
    measurements = [] if diagnosis.design is None else [measurement_as_dict(m) for m in diagnosis.design.measurements]
    document = {
        "verdict": diagnosis.verdict,
        "said": diagnosis.summary,
        "causes": list(diagnosis.causes),
        "class": [list(names) for names in diagnosis.classes],
        "stand_ins": list(diagnosis.stand_ins),
        "remains": None if selection is None or evidence is None else _remainder(selection, evidence),
        "closest": [c.name for c in selection.causes] if selection and _is_open(diagnosis) else [],
        "suspects": []
        if first is None
        else [_suspect(s, first.excess_chi2, first.chosen) for s in leading_variants(first.suspects)],
        "rounds": [] if selection is None else [_round(r) for r in selection.rounds],
        "exchanges": [] if selection is None else [asdict(exchange) for exchange in selection.exchanges],
        "left_out": [] if selection is None else [asdict(left_out) for left_out in selection.left_out],
        "refused": dict(diagnosis.refused),
        "gates": [_gate(gate) for gate in diagnosis.gates],
        "outliers": diagnosis.outliers,
        "rounding": diagnosis.rounding,
        "misfit": {} if selection is None or deviations is None else _misfit(selection, deviations),
        "parameters": {} if selection is None else _parameters(selection),
        "joint_sizes": {} if selection is None else {c.name: _joint_size(c, selection) for c in selection.causes},
        "gain": None if diagnosis.gain is None else _gain(diagnosis.gain),
        "next_measurement": measurements[0] if measurements else None,
        "measurements": measurements,
        "design": None if diagnosis.design is None else design_as_dict(diagnosis.design),
        "threshold": None if first is None else first.threshold,
        "cut_short": selection is not None and selection.cut_short,
        "simulations": diagnosis.simulations,
        "seconds": diagnosis.seconds,
    }
    return plain(document)


def _gate(gate: Gate) -> dict[str, Any]:
    """A condition of the diagnosis, and whether it holds."""
    return {"name": gate.name, "passed": gate.passed, "said": gate.summary, "z": gate.z, "tried": gate.tried}


def measurement_as_dict(measurement: Measurement) -> dict[str, Any]:
    """Settings of a measurement, its predicted separations, and these in words."""
    rest = {key: value for key, value in asdict(measurement).items() if key != "point"}
    own = {"confirmed": measurement.confirmed, "prediction": measurement.prediction}
    return {**asdict(measurement.point), **rest, **own}


def design_as_dict(design: Design) -> dict[str, Any]:
    """The search for the next measurement without its results, as the map of the separation shows it."""
    points = [{**asdict(e.point), **{k: v for k, v in asdict(e).items() if k != "point"}} for e in design.points]
    rest = {key: value for key, value in asdict(design).items() if key not in ("points", "measurements")}
    return {**rest, "points": points, "decisive_z": DECISIVE_Z}


def _intervals(candidate: Candidate, sizes: Iterable[float], halves: Iterable[float]) -> dict[str, list[float]]:
    """Ends of the 95 % intervals of an effect's free parameters.

    None of a size that is infinite where the effect is absent, nor of one that the records do not determine.
    """
    ends = {}
    for name, size, half in zip(candidate.free, sizes, halves, strict=True):
        determined = np.isfinite(size) and half < MAX_HALF_WIDTH * candidate.scale.get(name, np.inf)
        ends[name] = [size - half, size + half] if determined else [np.nan, np.nan]
    return ends


def _suspect(suspect: Suspect, excess: float, chosen: Suspect | None) -> dict[str, Any]:
    """A suspect of the first search beside the chosen one."""
    names, null = suspect.candidate.free, suspect.candidate.null
    reduction = suspect.known_reduction
    return {
        "effect": suspect.name,
        "meaning": suspect.candidate.effect.meaning,
        "equation": suspect.candidate.effect.equation,
        "bodies": suspect.candidate.effect.bodies,
        "z": suspect.z,
        "size": dict(zip(names, suspect.size, strict=True)),
        "interval": _intervals(suspect.candidate, suspect.size, suspect.half_width),
        "held": dict(suspect.candidate.held),
        "limits": {p.name: [p.low, p.high] for p in suspect.candidate.parameters},
        "units": {p.name: p.unit for p in suspect.candidate.effect.parameters},
        "share": reduction / excess if excess > 0.0 else None,
        "absorbed": suspect.absorbed,
        "detectable": dict(zip(names, suspect.detectable, strict=True)),
        "drop": reduction,
        "refitted": isinstance(suspect, Refitted),
        "null": dict(zip(names, null, strict=True)),
        "alike": None if chosen is None else cosine(suspect, chosen),
        "reason": suspect.reason or _without_effect(suspect),
    }


def _without_effect(suspect: Suspect) -> str:
    """State that a suspect changes no simulation where it is absent; "" of one that does."""
    none = isinstance(suspect, Scored) and not suspect.derivatives.any()
    return "it changes nothing in these records: every derivative where it is absent is zero" if none else ""


def _round(outcome: Round) -> dict[str, Any]:
    """One search for a cause."""
    chosen, excess = outcome.chosen, outcome.excess_chi2_of_null
    return {
        "threshold": outcome.threshold,
        "chosen": None if chosen is None else chosen.name,
        "share": None if chosen is None or not excess > 0.0 else chosen.chi2_reduction / excess,
        "rivals": [rival.name for rival in outcome.rivals],
        "prediction": None if outcome.prediction is None else asdict(outcome.prediction),
        "rejected": None if outcome.rejected is None else outcome.rejected.name,
        "rejection": outcome.rejection,
        "untried": list(outcome.untried),
        "alike": {r.name: cosine(r, chosen) for r in outcome.rivals if chosen is not None and r is not chosen},
    }


def _misfit(selection: Selection, deviations: Misfit) -> dict[str, Any]:
    """The misfit of the calibrated model, and the part of it that the causes explain."""
    return {
        "excess": selection.excess_chi2,
        "left": selection.remaining_chi2,
        "blur": selection.chi2_std,
        "share": selection.explained_share if selection.causes else 0.0,
        "inconstancy": selection.heterogeneity_z,
        "constancy": [asdict(constancy) for constancy in selection.constancy],
        "features": [asdict(deviation) for deviation in deviations.features],
        "channels": [{**asdict(channel), "orders": channel.orders.tolist()} for channel in deviations.channels],
    }


def _remainder(selection: Selection, evidence: Evidence) -> dict[str, Any]:
    """The remaining misfit: its share, whether it is above the noise, and the part of each row in it."""
    final, rows = selection.final, []
    for part in evidence.parts:
        residual = final.residual[evidence.of(part.name)].reshape(part.measured.shape)
        for (body, channel), row, weight in zip(part.rows, residual, part.weight, strict=True):
            beyond = max(0.0, float(row @ row) - float((weight**2).sum()))
            rows.append({"record": part.name, "body": body, "channel": channel, "beyond_noise": beyond})
    return {
        "share": selection.remaining_chi2 / selection.excess_chi2 if selection.is_significant else None,
        "above_noise": selection.remainder_is_significant,
        "rows": rows,
    }


def _joint_size(cause: Suspect, selection: Selection) -> dict[str, Any]:
    """Sizes of a cause with their 95 % intervals, all causes and calibrated parameters being fitted together."""
    final, names = selection.final, cause.candidate.free
    size = [final.value(name) for name in names]
    return {
        "size": dict(zip(names, size, strict=True)),
        "interval": _intervals(cause.candidate, size, final.half_width(names)),
        "bias": {name: selection.bias_std(final, name) for name in names},
        "limits": {p.name: [p.low, p.high] for p in cause.candidate.parameters},
        "units": {p.name: p.unit for p in cause.candidate.effect.parameters},
    }


def _parameters(selection: Selection) -> Mapping[str, Any]:
    """Calibrated values before and, where there are causes, after."""
    null, final = selection.null, selection.final
    return {
        name: {"before": null.value(name) if name in null.names else None, "after": final.value(name)}
        for name in final.names
    }


def _gain(gain: Gain) -> dict[str, Any]:
    """The gain by the causes on records held out."""
    return {
        "metric": MISFIT,
        "kind": gain.kind,
        "before": gain.before,
        "after": gain.after,
        "interval": list(gain.interval),
        "records": list(gain.records),
        "proven": gain.proven,
        "each": {name: list(pair) for name, pair in gain.each.items()},
        "failed": dict(gain.failed),
        "unaffected": list(gain.unaffected),
        "transfers": [{**asdict(transfer), "half_width": transfer.half_width} for transfer in gain.transfers],
        "agreements": [asdict(agreement) for agreement in gain.agreements],
        "shifts": [{**asdict(shift), "errors": shift.errors} for shift in gain.shifts],
    }
