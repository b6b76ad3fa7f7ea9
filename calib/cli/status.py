"""How far a study is, from what lies in its folder; the study may be running, stopped, killed or finished."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calib.records import OK
from calib.store import Trial, read
from calib.store.address import JOURNAL_VIEW
from calib.store.journal import JOURNAL
from calib.store.lock import is_locked
from calib.store.pictures import ARTIFACTS
from calib.store.plain import plain
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


@dataclass(frozen=True)
class BestTrial:
    """Number, score, kind of motion and values (SI) of the best trial."""

    number: int
    total: float | None
    kind: str | None
    values: Mapping[str, float]


@dataclass(frozen=True)
class StudyStatus:
    """How far a study is.

    Attributes
    ----------
    name, budget : of the study
    state : "running", "finished", or "unfinished": stopped or killed
    trials : number of trials there are
    best : None where none ended ok
    units : searched parameter -> SI unit
    failed : status -> number of trials that ended so
    seconds : mean of the last trials, None where there are none  [s]
    folder : of the results
    """

    name: str
    state: str
    trials: int
    budget: int
    best: BestTrial | None
    units: Mapping[str, str]
    failed: Mapping[str, int]
    seconds: float | None
    folder: str

    def as_dict(self) -> dict[str, Any]:
        """Return what `calib status --json` prints."""
        return plain(self)


def study_status(study: Path, out: Path | None) -> StudyStatus:
    """Return how far a study is.

    Raises
    ------
    CalibError : nothing was run there
    """
    folder = folder_of(study, out)
    header, trials = read(folder)
    calibration = result.read(folder)
    finished = calibration is not None and calibration.trials == len(trials)
    return StudyStatus(
        name=header.name,
        state="running" if is_locked(folder) else "finished" if finished else "unfinished",
        trials=len(trials),
        budget=header.budget,
        best=_best(trials) if calibration is None or not finished else _calibrated(calibration),
        units={name: window.get("unit", "") for name, window in header.definition.get("windows", {}).items()},
        failed=Counter(trial.status for trial in trials if trial.status != OK),
        seconds=_mean(trials),
        folder=str(folder),
    )


def _best(trials: Sequence[Trial]) -> BestTrial | None:
    top = best(trials)
    return None if top is None else BestTrial(top.number, top.cost, top.kind, top.values)


def _calibrated(result: CalibrationResult) -> BestTrial | None:
    """Best trial of a finished study: where it was confirmed, not the search's but the one chosen, as confirmed."""
    if result.best_trial is None:
        return None
    return BestTrial(result.best_trial, result.score.total, result.motion.kind, result.values)


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
    return str(folder / JOURNAL) if view == JOURNAL_VIEW else view, folder / ARTIFACTS
