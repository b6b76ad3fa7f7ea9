"""A diagnosis as one JSON document."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from calib.diagnosis.diagnose import UNEXPLAINED, Diagnosis
from calib.diagnosis.gain import METRIC, Gain
from calib.diagnosis.selection import Suspect
from calib.store.plain import plain

SURE = 1.96  # standard errors on each side of an interval


def as_dict(diagnosis: Diagnosis) -> dict[str, Any]:
    """Everything that diagnosis.json holds, in SI; what is not finite is None."""
    selection = diagnosis.selection
    first = selection.rounds[0] if selection else None
    found = {
        "verdict": diagnosis.verdict,
        "said": diagnosis.said,
        "causes": list(diagnosis.causes),
        "class": [list(names) for names in diagnosis.classes],
        "closest": [c.name for c in selection.causes] if selection and diagnosis.verdict == UNEXPLAINED else [],
        "suspects": [] if first is None else [_suspect(s, selection.excess) for s in best_of_each(first.suspects)],
        "rounds": [] if selection is None else [_round(r) for r in selection.rounds],
        "refused": dict(diagnosis.refused),
        "gates": [asdict(gate) for gate in diagnosis.gates],
        "outliers": diagnosis.outliers,
        "misfit": _misfit(diagnosis),
        "parameters": {} if selection is None else _parameters(diagnosis),
        "gain": None if diagnosis.gain is None else _gain(diagnosis.gain),
        "next_measurement": asdict(diagnosis.further[0]) if diagnosis.further else None,
        "measurements": [asdict(measurement) for measurement in diagnosis.further],
        "threshold": None if first is None else first.threshold,
        "simulations": diagnosis.simulations,
        "seconds": diagnosis.seconds,
    }
    return plain(found)


def best_of_each(suspects) -> list[Suspect]:
    """Keep of each effect the suspect that explains most: they come in that order."""
    kept: dict[str, Suspect] = {}
    for suspect in suspects:
        kept.setdefault(suspect.name, suspect)
    return list(kept.values())


def _suspect(suspect: Suspect, excess: float) -> dict[str, Any]:
    names, null = suspect.candidate.free, suspect.candidate.null
    half = SURE * suspect.error
    drop = suspect.drop if suspect.fit is not None else (suspect.test.drop if suspect.test is not None else 0.0)
    return {
        "effect": suspect.name,
        "bodies": suspect.candidate.effect.bodies,
        "z": suspect.z,
        "size": dict(zip(names, suspect.size, strict=True)),
        "interval": {n: [x - h, x + h] for n, x, h in zip(names, suspect.size, half, strict=True)},
        "held": dict(suspect.candidate.held),
        "units": {p.name: p.unit for p in suspect.candidate.effect.parameters},
        "share": drop / excess if excess > 0.0 else None,
        "absorbed": suspect.absorbed,
        "detectable": dict(zip(names, suspect.detectable, strict=True)),
        "drop": drop,
        "refitted": suspect.fit is not None,
        "null": dict(zip(names, null, strict=True)),
        "reason": suspect.reason,
    }


def _round(found) -> dict[str, Any]:
    return {
        "threshold": found.threshold,
        "chosen": None if found.chosen is None else found.chosen.name,
        "rivals": [rival.name for rival in found.rivals],
    }


def _misfit(diagnosis: Diagnosis) -> dict[str, Any]:
    selection, said = diagnosis.selection, diagnosis.misfit
    if selection is None:
        return {}
    return {
        "excess": selection.excess,
        "left": selection.left,
        "blur": selection.blur,
        "share": selection.share if selection.causes else 0.0,
        "features": [asdict(deviation) for deviation in said.features],
        "channels": [{**asdict(channel), "orders": channel.orders.tolist()} for channel in said.channels],
    }


def _parameters(diagnosis: Diagnosis) -> Mapping[str, Any]:
    """Calibrated values before and, where there are causes, after."""
    null, final = diagnosis.selection.null, diagnosis.selection.final
    return {
        name: {"before": null.value(name) if name in null.names else None, "after": final.value(name)}
        for name in final.names
    }


def _gain(gain: Gain) -> dict[str, Any]:
    return {
        "metric": METRIC,
        "kind": gain.kind,
        "before": gain.before,
        "after": gain.after,
        "interval": list(gain.interval),
        "records": list(gain.records),
        "proven": gain.proven,
        "each": {name: list(pair) for name, pair in gain.each.items()},
        "failed": dict(gain.failed),
        "transfers": [asdict(transfer) for transfer in gain.transfers],
        "shifts": [asdict(shift) for shift in gain.shifts],
    }
