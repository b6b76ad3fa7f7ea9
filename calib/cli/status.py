"""How far a study is, from what lies in its folder; the study may be running, stopped, killed or finished."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from calib.records import OK
from calib.store import Trial, read
from calib.store.lock import is_locked
from calib.store.optuna_view import ARTIFACTS, JOURNAL
from calib.store.trial import best
from calib.study import CalibrationResult, result
from calib.study_file import StudyToml, located, read_toml, results_folder

RATE_TRIALS = 50  # trials over which the rate is taken


def folder_of(study: Path, out: Path | None) -> Path:
    """Return the folder of a study's results: `out`, else the one beside the study file.

    Raises
    ------
    CalibError : neither the study nor the folder is there
    """
    return results_folder(located(study)) if out is None else out


def study_status(study: Path, out: Path | None) -> dict[str, Any]:
    """Return what `calib status --json` prints.

    Returns
    -------
    dict: name, state ("running", "finished", "unfinished": stopped or killed), trials, budget, best (number, total,
    kind, values in SI) or None, units, failed (status -> count), seconds (mean of the last trials [s]) or None, folder
    """
    folder = folder_of(study, out)
    header, trials = read(folder)
    found = result.read(folder)
    finished = found is not None and found.trials == len(trials)
    return {
        "name": header["name"],
        "state": "running" if is_locked(folder) else "finished" if finished else "unfinished",
        "trials": len(trials),
        "budget": header["budget"],
        "best": _best(trials) if found is None or not finished else _found(found),
        "units": {name: window["unit"] for name, window in header["definition"]["windows"].items()},
        "failed": dict(Counter(trial.status for trial in trials if trial.status != OK)),
        "seconds": _mean(trials),
        "folder": str(folder),
    }


def _best(trials: Sequence[Trial]) -> dict[str, Any] | None:
    top = best(trials)
    return None if top is None else {"number": top.number, "total": top.cost, "kind": top.kind, "values": top.values}


def _found(found: CalibrationResult) -> dict[str, Any] | None:
    """Best trial of a finished study: where it was confirmed, not the search's but the one chosen, as confirmed."""
    if found.best_trial is None:
        return None
    return {
        "number": found.best_trial, "total": found.score.total, "kind": found.motion.kind, "values": found.values,
    }  # fmt: skip


def _mean(trials: Sequence[Trial]) -> float | None:
    recent = [trial.seconds for trial in trials[-RATE_TRIALS:]]
    return sum(recent) / len(recent) if recent else None


def view_of(study: Path, out: Path | None) -> tuple[str, Path]:
    """Return the Optuna view of a study (journal file or URL) and the folder of its pictures.

    Raises
    ------
    CalibError : nothing was run there, or the study has no journal yet
    """
    folder = folder_of(study, out)
    read(folder)  # says so where nothing was run
    view = read_toml(StudyToml, located(study))[0].store.view
    return str(folder / JOURNAL) if view == "journal" else view, folder / ARTIFACTS
