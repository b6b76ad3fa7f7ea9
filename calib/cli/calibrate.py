"""The main job: search, judge what was found, try it on the records held out, and write it all down."""

import time
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import xarray as xr

from calib import result
from calib.cli.progress import Progress
from calib.cli.standing import folder_of
from calib.confidence import Confidence, around_best
from calib.errors import CalibError
from calib.model import Model
from calib.objective import Objective, Score
from calib.pool import Failure, LocalPool, in_order
from calib.record import failed
from calib.report import figures
from calib.report import write as write_report
from calib.store import Store, Trial, read
from calib.store.trial import best
from calib.study import INTERRUPTED, Evaluation, evaluate, reach
from calib.study_toml import StudyFile, load

CALIBRATED = ""  # beside the names of the records held out: all calibrated records together


def calibrate(file: StudyFile, folder: Path, progress: Progress, fresh: bool = False) -> dict[str, Any]:
    """Run a study to its end, or go on with it, and write result.json and report.html into `folder`.

    Returns
    -------
    what result.json says

    Raises
    ------
    KeyboardInterrupt : stopped by Ctrl-C; the trials are kept
    CalibError : the folder belongs to another study or cannot be written
    """
    begin = time.monotonic()
    study = file.study
    if not fresh:
        progress.earlier(_earlier(folder))
    store = Store(folder, file.view, file.keep, partial(figures.picture, objective=study.objective))
    final, confidence = {}, None
    with LocalPool(partial(evaluate, study.without_search()), study.jobs, study.timeout) as pool:
        progress.stage("screen")
        found = study.run(store, pool, on_trial=progress.trial, fresh=fresh)
        if found.stopped == INTERRUPTED:
            raise KeyboardInterrupt
        if found.best is not None:
            progress.stage("confidence")
            [final[CALIBRATED]] = in_order(pool, [found.best.values])
            confidence = around_best(study, pool, found.best, final[CALIBRATED])
    if found.best is not None:
        progress.stage("hold-out")
        final |= _held_out(file, found.best.values)
    said = result.summarised(
        study,
        found.trials,
        best=found.best,
        score=_scores(final).get(CALIBRATED),
        confidence=confidence,
        reach=found.reach,
        agreement=found.agreement,
        stopped=found.stopped,
        holdout=_said_of_others(final),
        simulations=_simulations(file, found.trials, confidence),
        seconds=time.monotonic() - begin,
    )
    progress.stage("report")
    result.write(said, folder)
    _report(file, folder, found.trials, final, said)
    return said


def _earlier(folder: Path) -> list[Trial]:
    """Trials of earlier runs, as far as they can be told: what is wrong there, the store says when it is opened."""
    with suppress(CalibError), warnings.catch_warnings(action="ignore"):
        return read(folder)[1]
    return []


def rebuild(study: Path, out: Path | None) -> Path:
    """Write report.html anew from what lies in the folder of a study, and return its path."""
    file = load(study)
    folder = folder_of(study, out)
    _, trials = read(folder, file.study.header["definition"])
    trials.sort(key=lambda trial: trial.number)
    top = best(trials)
    final = {} if top is None else _held_out(file, top.values, with_calibrated=True)
    said = result.read(folder)
    if said is None or said["best_trial"] != (None if top is None else top.number):  # not finished yet
        said = result.summarised(
            file.study,
            trials,
            best=top,
            score=_scores(final).get(CALIBRATED),
            reach=reach(trials),
            holdout=_said_of_others(final),
            stopped="not finished",
        )
    return _report(file, folder, trials, final, said)


# --- the records held out --------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Judged:
    """What `calib.study.evaluate` needs of a study."""

    model: Model
    objective: Objective


def _held_out(
    file: StudyFile, values: Mapping[str, float], with_calibrated: bool = False
) -> dict[str, Evaluation | Failure]:
    """Evaluate the best values on each record held out, by its name; and, where asked for, on the calibrated ones."""
    study = file.study
    judged = {
        name: _Judged(study.model, study.objective.on({name: reference}))
        for name, reference in file.others.items()
        if reference.use == "holdout"
    }
    if with_calibrated:
        judged[CALIBRATED] = _Judged(study.model, study.objective)
    if not judged:
        return {}
    with LocalPool(partial(_evaluate_one, judged), min(study.jobs, len(judged)), study.timeout) as pool:
        return dict(zip(judged, in_order(pool, [(name, values) for name in judged]), strict=True))


def _evaluate_one(judged: Mapping[str, _Judged], payload: tuple[str, Mapping[str, float]]) -> Evaluation:
    name, values = payload
    return evaluate(judged[name], values)


def _scores(final: Mapping[str, Evaluation | Failure]) -> dict[str, Score]:
    return {name: answer.score for name, answer in final.items() if isinstance(answer, Evaluation)}


def _said_of_others(final: Mapping[str, Evaluation | Failure]) -> dict[str, dict[str, Any]]:
    return {
        name: result.held_out(answer.score)
        if isinstance(answer, Evaluation)
        else result.failed(answer.status, answer.reason)
        for name, answer in final.items()
        if name != CALIBRATED
    }


def _simulations(file: StudyFile, trials: Sequence[Trial], confidence: Confidence | None) -> int:
    each = len(file.study.objective.references)
    neighbours = 0 if confidence is None else confidence.evaluations
    held = sum(reference.use == "holdout" for reference in file.others.values())
    return each * (len(trials) + neighbours) + (each + held if confidence is not None else 0)


# --- the page --------------------------------------------------------------------------------------------------------


def _report(
    file: StudyFile,
    folder: Path,
    trials: Sequence[Trial],
    final: Mapping[str, Evaluation | Failure],
    said: Mapping[str, Any],
) -> Path:
    study = file.study
    known = {**study.objective.references, **file.others}
    records: dict[str, xr.Dataset] = {}
    for name, answer in final.items():
        if isinstance(answer, Evaluation):
            records |= answer.records
        elif name != CALIBRATED:
            records[name] = failed(study.model.bodies, answer.status, answer.reason)
    shown = replace(study, objective=Objective(known, study.objective.terms))
    return write_report(folder / "report.html", shown, trials, records, said, command=f"calib run {file.path}")
