"""What a study found, as one JSON document."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from calib.errors import CalibError
from calib.execution.files import whole
from calib.objective import Score
from calib.records import OK
from calib.store import Trial
from calib.store.plain import plain
from calib.study.confirmation import Confirmation
from calib.study.reachability import Reach
from calib.study.study import CalibrationStudy

NAME = "result.json"
FAILED = "failed"
NUISANCE_UNITS = {"trigger": "s", "offset": "m", "scale": "1", "shear": "s"}  # before the dot of its name


def summarised(
    study: CalibrationStudy,
    trials: Sequence[Trial],
    *,
    best: Trial | None = None,
    score: Score | None = None,
    confirmation: Confirmation | None = None,
    confidence: Mapping[str, Any] | None = None,
    reach: Sequence[Reach] = (),
    agreement: Mapping[str, Any] | None = None,
    stopped: str = "",
    holdout: Mapping[str, Mapping[str, Any]] | None = None,
    remarks: Sequence[str] = (),
    simulations: int | None = None,
    seconds: float = 0.0,
) -> dict[str, Any]:
    """Put together what is known of a study; what is not known yet stays empty.

    Parameters
    ----------
    study : that was run
    trials : every one, in the order of the ledger
    best : the best trial, with its confirmed score where it was confirmed; None where none ended ok
    score : of the best point, for kind of motion and nuisances
    confirmation : of the leaders of the search, None where the simulator has no confirming one
    confidence : at the best point, as `calib.confidence.Confidence.as_dict` says it
    reach : of each measured feature
    agreement : of the starts of a search by several starts
    stopped : why the search ended
    holdout : record -> what `held_out` returns
    remarks : what else to mind, a sentence each, without its full stop
    simulations : runs of the simulator, everything counted
    seconds : wall-clock time  [s]; it, and that of the confirmation, are all that differs between two runs of one study

    Returns
    -------
    dict in SI that `json.dumps(..., allow_nan=False)` takes; not finite numbers are None
    """
    names = () if best is None else tuple(best.values)
    found = {
        "name": study.name,
        "status": FAILED if best is None else OK,
        "stopped": stopped,
        "values": {} if best is None else dict(best.values),
        "units": {name: study.model.parameters[name.partition("@")[0]].unit for name in names},
        "windows": {name: asdict(window) for name, window in study.space.windows.items()},
        "intervals": {} if confidence is None else confidence["interval"],
        "undetermined": [] if confidence is None else confidence["undetermined"],
        "at_edge": [] if confidence is None else sorted(confidence["at_edge"]),
        "unreachable": [_reach(r) for r in reach if not r.reached],
        "score": {"total": None if best is None else best.cost, "terms": {} if best is None else dict(best.terms)},
        "motion": {
            "kind": None if best is None else best.kind,
            "evidence": None if score is None else score.evidence,
            "wrong": [] if score is None else list(score.wrong),
        },
        "nuisances": {} if score is None else dict(score.nuisances),
        "nuisance_units": _nuisance_units(study, score, holdout or {}),
        "agreement": _agreement(agreement),
        "holdout": dict(holdout or {}),
        "confirmation": None if confirmation is None else _confirmation(confirmation),
        "confidence": confidence,
        "remarks": list(remarks),
        "best_trial": None if best is None else best.number,
        "trials": len(trials),
        "failed": sum(trial.status != OK for trial in trials),
        "failures": _failures(trials),
        "simulations": simulations,
        "seconds": seconds,
    }
    return plain(found)


def _nuisance_units(
    study: CalibrationStudy, score: Score | None, holdout: Mapping[str, Mapping[str, Any]]
) -> dict[str, str]:
    """SI unit of each nuisance by name: of an initial state, that of the simulator's parameter."""
    known = {name: parameter.unit for name, parameter in study.model.parameters.items()} | NUISANCE_UNITS
    solved = [*(score.nuisances.values() if score else ()), *(said.get("nuisances", {}) for said in holdout.values())]
    names = dict.fromkeys(name for own in solved for name in own)
    return {name: known[name.partition(".")[0]] for name in names}


def _failures(trials: Sequence[Trial]) -> list[dict[str, Any]]:
    """Say how many trials ended in which way other than ok, the most frequent first, each with its first reason."""
    failed = [trial for trial in trials if trial.status != OK]
    counted = Counter(trial.status for trial in failed).most_common()
    first = {trial.status: trial.reason for trial in reversed(failed)}
    return [{"status": status, "trials": number, "reason": first[status]} for status, number in counted]


def held_out(score: Score, misfit: float) -> dict[str, Any]:
    """What a hold-out record says of the best point.

    Parameters
    ----------
    score : of the study's terms on that record alone
    misfit : as `calib.objective.MISFIT` has it  [1]
    """
    if score.status != OK:
        return failed(score.status, score.reason)
    found = {"misfit": misfit, "score": score.cost, "terms": dict(score.terms), "kind": score.kind}
    nuisances = {name: value for own in score.nuisances.values() for name, value in own.items()}
    return {**found, "status": OK, "reason": "", "nuisances": nuisances}


def failed(status: str, reason: str) -> dict[str, Any]:
    """What a hold-out record says where it could not be simulated."""
    found = {"misfit": None, "score": None, "terms": {}, "kind": None}
    return {**found, "status": status, "reason": reason, "nuisances": {}}


def write(found: Mapping[str, Any], folder: Path) -> Path:
    """Write `result.json` so that it is either whole or absent; return its path."""
    path = folder / NAME
    text = json.dumps(found, indent=2, allow_nan=False) + "\n"
    with whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path


def read(folder: Path) -> dict[str, Any] | None:
    """Return what `result.json` in `folder` says, None where there is none."""
    path = folder / NAME
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except ValueError as error:
        raise CalibError(f"{path}: not JSON ({error}); delete it and run the study again") from error


def _confirmation(confirmation: Confirmation) -> dict[str, Any]:
    return {
        "leaders": [
            {
                "trial": leader.searched.number,
                "searched": leader.searched.cost,
                "confirmed": leader.confirmed.cost,
                "status": leader.confirmed.status,
                "reason": leader.confirmed.reason,
                "kind": leader.confirmed.kind,
            }
            for leader in confirmation.leaders
        ],
        "chosen": confirmation.chosen.searched.number,
        "changed": confirmation.changed,
        "seconds": confirmation.seconds,
    }


def confirmed(found: Mapping[str, Any]) -> bool:
    """Whether values and score of a result are those of a confirming simulator."""
    confirmation = found.get("confirmation")
    return confirmation is not None and any(
        leader["trial"] == confirmation["chosen"] and leader["confirmed"] is not None
        for leader in confirmation["leaders"]
    )


def searched_best(found: Mapping[str, Any]) -> int | None:
    """Return the number of the trial that the search behind a result found best, whatever was chosen after it."""
    confirmation = found.get("confirmation")
    return found["best_trial"] if confirmation is None else confirmation["leaders"][0]["trial"]


def _agreement(summary: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Return the optimiser's summary; "starts" and "agree" say how many starts ended at the best point."""
    if summary is None:
        return None
    return {"agree": summary["agree_in_point"], **summary} if "agree_in_point" in summary else dict(summary)


def _reach(reach: Reach) -> dict[str, Any]:
    return {
        "feature": reach.label,
        "record": reach.record,
        "body": reach.body,
        "unit": reach.unit,
        "measured": reach.measured,
        "nearest": reach.nearest,
        "off": reach.off,
        "percent": reach.percent,
    }
