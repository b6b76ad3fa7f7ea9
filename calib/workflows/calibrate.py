"""The main job: search, confirm and judge what was found, try it on the records held out, and write it all down."""

import math
import time
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import xarray as xr

from calib.confidence import Confidence, around_best, describe_near_optimal
from calib.diagnosis import artifacts
from calib.errors import CalibError
from calib.execution.files import whole
from calib.execution.pool import Failure, InProcess, LocalPool, in_order, workers
from calib.modelling.model import Model
from calib.objective import Objective, Reference, Score, record_misfit
from calib.records import OK, failed
from calib.report import figures, render
from calib.store import Store, Trial, read
from calib.store.trial import best
from calib.study import (
    INTERRUPTED,
    CalibrationResult,
    CalibrationStudy,
    Confirmation,
    Evaluation,
    Result,
    confirm,
    evaluate,
    leaders,
    reach,
    result,
)
from calib.study.progress import Progress
from calib.study.result import HeldOutSummary
from calib.study.summary import held_out, not_simulated, summarised
from calib.study_file import StudyFile, load

MUCH = 0.5  # of the distance; where a free trigger takes it below, this is said
UNFINISHED = "not finished"  # why a search ended that has not
CALIBRATED = ""  # beside the names of the records held out: all calibrated records together


def calibrate(
    path: str | Path,
    out: str | Path | None = None,
    *,
    budget: int | None = None,
    jobs: int | None = None,
    fresh: bool = False,
    quiet: bool = False,
) -> CalibrationResult:
    """Run a study to its end, or go on with it, and write what it found: `calib run` from Python.

    Parameters
    ----------
    path : study file, or a folder with a study.toml
    out : folder of the results (trials.jsonl, result.json, report.html, best.nc, ...); None: out/ beside the study file
    budget, jobs : take the place of the file's
    fresh : forget the trials made so far
    quiet : no progress on stderr

    Returns
    -------
    what result.json holds: values and intervals in SI, score, kind of motion, records held out

    Raises
    ------
    KeyboardInterrupt : stopped by Ctrl-C; the trials are kept
    CalibError : a mistake in the study file; the folder belongs to another study or cannot be written
    """
    file = load(path, budget=budget, jobs=jobs)
    folder = file.folder if out is None else Path(out)
    with Progress(file.study.budget, quiet=quiet) as progress:
        return _calibrate(file, folder, progress, fresh)


def _calibrate(file: StudyFile, folder: Path, progress: Progress, fresh: bool) -> CalibrationResult:
    begin = time.monotonic()
    study = file.study
    if not fresh:
        progress.earlier(_earlier(folder))
    store = Store(folder, file.view, file.keep, partial(figures.picture, objective=study.objective))
    with workers(partial(evaluate, study.without_search()), study.jobs, study.timeout) as pool:
        progress.stage("screen")
        found = study.run(store, pool, on_trial=progress.trial, fresh=fresh)
        if found.stopped == INTERRUPTED:
            raise KeyboardInterrupt
        with store.locked():
            return _concluded(file, store, pool, found, progress, begin)


def _concluded(
    file: StudyFile, store: Store, pool: LocalPool | InProcess, found: Result, progress: Progress, begin: float
) -> CalibrationResult:
    """Confirm what was found, work out how sure it is, predict what is held out, and write result and report."""
    study = file.study
    top, model = found.best, study.model
    final, confirmation, confidence = {}, None, None
    if top is not None and model.confirming is not None:
        progress.stage("confirm")
        confirmation = _confirmation(study, model.confirming, found.trials, progress)
        top = confirmation.best
    if top is not None:
        progress.stage("confidence")
        [final[CALIBRATED]] = in_order(pool, [top.values])
        confidence = around_best(study, pool, top, final[CALIBRATED])
        if confirmation is not None and confirmation.succeeded:
            model, final[CALIBRATED] = model.confirming, confirmation.chosen.evaluation
            confidence = _by_the_search(confidence, confirmation)
        if _held(file):
            progress.stage("hold-out")
        final |= _held_out(file, model, top.values)
    said = summarised(
        study,
        found.trials,
        best=top,
        score=_scores(final).get(CALIBRATED),
        confirmation=confirmation,
        confidence=None if confidence is None else confidence.summary(),
        reach=found.reach,
        agreement=found.agreement,
        stopped=found.stopped,
        holdout=_said_of_others(file, final),
        remarks=[
            *([] if confirmation is None else confirmation.remarks),
            *_in_the_place_of_intervals(study, found.trials, confidence),
            *_remarks(study.objective, final.get(CALIBRATED)),
        ],
        simulations=_simulations(file, found.trials, confirmation, confidence, final),
        seconds=time.monotonic() - begin,
    )
    progress.stage("report")
    if confirmation is not None and confirmation.succeeded:
        store.keep_confirmed(top, confirmation.chosen.evaluation.records)
    result.write(said, store.folder)
    _report(file, store.folder, store.header, found.trials, final, said)
    return said


def _earlier(folder: Path) -> list[Trial]:
    """Trials of earlier runs, as far as they can be told: what is wrong there, the store says when it is opened."""
    with suppress(CalibError), warnings.catch_warnings(action="ignore"):
        return read(folder)[1]
    return []


def rebuild(path: str | Path, out: str | Path | None = None, jobs: int | None = None) -> Path:
    """Write report.html anew from what lies in the folder of a study, and return its path.

    `jobs` takes the place of the file's.
    """
    file = load(path, jobs=jobs)
    folder = file.folder if out is None else Path(out)
    return _report(file, folder, *_what_lies_there(file, folder))


def summary_so_far(path: str | Path, out: str | Path | None = None) -> CalibrationResult:
    """Return what result.json says or, where the search has not ended, would say of the trials that there are.

    Raises
    ------
    CalibError : there are no trials, or they are of another study
    """
    file = load(path)
    return _what_lies_there(file, file.folder if out is None else Path(out))[-1]


def _what_lies_there(
    file: StudyFile, folder: Path
) -> tuple[Mapping[str, Any], list[Trial], Mapping[str, Evaluation | Failure], CalibrationResult]:
    """Header and trials of the ledger, the records of the best trial and those held out, and the result."""
    header, trials = read(folder, file.study.header["definition"])
    trials.sort(key=lambda trial: trial.number)
    top, model = best(trials), file.study.model
    said = result.read(folder)
    numbered = {trial.number: trial for trial in trials}
    finished = said is not None and said.searched_best == (None if top is None else top.number)
    finished = finished and (top is None or said.best_trial in numbered)
    if finished and top is not None:
        top, model = numbered[said.best_trial], _simulated_with(model, said)
    final = {} if top is None else _held_out(file, model, top.values, with_calibrated=True)
    if not finished:
        said = summarised(
            file.study,
            trials,
            best=top,
            score=_scores(final).get(CALIBRATED),
            reach=reach(trials),
            holdout=_said_of_others(file, final),
            remarks=_remarks(file.study.objective, final.get(CALIBRATED)),
            stopped=UNFINISHED,
        )
    return header, trials, final, said


def _simulated_with(model: Model, said: CalibrationResult) -> Model:
    """Return the model whose records a result is about: of the confirming simulator, where one confirmed it."""
    if not said.confirmed:
        return model
    if model.confirming is None:
        raise CalibError(
            f"what was found here was confirmed with another simulator, which {model.simulator.name!r} now lacks; "
            "run the study again"
        )
    return model.confirming


# --- the leaders -----------------------------------------------------------------------------------------------------


def _confirmation(
    study: CalibrationStudy, confirming: Model, trials: Sequence[Trial], progress: Progress
) -> Confirmation:
    searched = leaders(trials)
    again = partial(evaluate, replace(study.without_search(), model=confirming))
    with workers(again, min(study.jobs, len(searched)), study.timeout) as pool:
        return confirm(pool, searched, progress.leader)


def _by_the_search(confidence: Confidence, confirmation: Confirmation) -> Confidence:
    """Say which simulator the differences are of, where there are any."""
    if confidence.status != OK:
        return confidence
    said = "the intervals are those of the simulator of the search, by finite differences about the confirmed point"
    if confirmation.changed:
        said += "; the best point of the search is another one"
    return replace(confidence, reason="; ".join(filter(None, [confidence.reason, said])))


# --- the records held out --------------------------------------------------------------------------------------------


def _held(file: StudyFile) -> dict[str, Reference]:
    return {name: reference for name, reference in file.others.items() if reference.use == "holdout"}


@dataclass(frozen=True, eq=False)
class _Case:
    """What `calib.study.evaluate` needs of a study."""

    model: Model
    objective: Objective


def _held_out(
    file: StudyFile, model: Model, values: Mapping[str, float], with_calibrated: bool = False
) -> dict[str, Evaluation | Failure]:
    """Evaluate the best values on each record held out, by its name; and, where asked for, on the calibrated ones."""
    study = file.study
    judged = {name: _Case(model, study.objective.on({name: reference})) for name, reference in _held(file).items()}
    if with_calibrated:
        judged[CALIBRATED] = _Case(model, study.objective)
    if not judged:
        return {}
    with workers(partial(_evaluate_one, judged), min(study.jobs, len(judged)), study.timeout) as pool:
        return dict(zip(judged, in_order(pool, [(name, values) for name in judged]), strict=True))


def _evaluate_one(judged: Mapping[str, _Case], payload: tuple[str, Mapping[str, float]]) -> Evaluation:
    name, values = payload
    return evaluate(judged[name], values)


def _scores(final: Mapping[str, Evaluation | Failure]) -> dict[str, Score]:
    return {name: answer.score for name, answer in final.items() if isinstance(answer, Evaluation)}


def _said_of_others(file: StudyFile, final: Mapping[str, Evaluation | Failure]) -> dict[str, HeldOutSummary]:
    return {name: _said_of(file, name, answer) for name, answer in final.items() if name != CALIBRATED}


def _said_of(file: StudyFile, name: str, answer: Evaluation | Failure) -> HeldOutSummary:
    """What result.json says of the record `name`, which was held out."""
    if isinstance(answer, Failure):
        return not_simulated(answer.status, answer.reason)
    if answer.score.status != OK:
        return held_out(answer.score, math.nan)
    reference, objective = file.others[name], file.study.objective
    simulated = answer.records[name]
    aligned = objective.on({name: reference}).aligned(name, simulated)
    return held_out(answer.score, record_misfit(reference, objective.terms, simulated, aligned))


def _in_the_place_of_intervals(
    study: CalibrationStudy, trials: Sequence[Trial], confidence: Confidence | None
) -> list[str]:
    """Say what nearly equal trials share, where there are no intervals."""
    if confidence is None or confidence.status == OK:
        return []
    units = {name: study.model.parameters[name.partition("@")[0]].unit for name in study.space.names}
    sentence = describe_near_optimal(study.space, trials, units)
    return [sentence] if sentence else []


def _remarks(objective: Objective, answer: Evaluation | Failure | None) -> list[str]:
    """Name the records that fit far better when it is left open at which instant they start."""
    if not isinstance(answer, Evaluation) or answer.score.status != OK:
        return []
    remarks, cost = [], answer.score.cost
    for name in objective.scored:
        reference = objective.references[name]
        if reference.excitation.periodic and "trigger" not in reference.nuisance:
            freed = objective.with_free_trigger(name)(answer.records).cost
            if freed < MUCH * cost:
                remarks.append(
                    f"were {name} to start at another instant of its period, the distance would be {freed:.2g} instead "
                    f'of {cost:.2g}: give it nuisance = ["trigger"] unless its start is known'
                )
    return remarks


def _simulations(
    file: StudyFile,
    trials: Sequence[Trial],
    confirmation: Confirmation | None,
    confidence: Confidence | None,
    final: Mapping[str, Evaluation | Failure],
) -> int:
    each = len(file.study.objective.references)
    searched = sum(each if trial.simulations is None else trial.simulations for trial in trials)
    again = 0 if confirmation is None else sum(_runs(leader.evaluation, each) for leader in confirmation.leaders)
    if confidence is None:
        return searched + again
    centre = _runs(final.get(CALIBRATED), each)  # its neighbours take as many
    held = sum(_runs(answer, 1) for name, answer in final.items() if name != CALIBRATED)
    return searched + again + centre * (1 + confidence.evaluations) + held


def _runs(answer: Evaluation | Failure | None, otherwise: int) -> int:
    """Runs of the simulator that an evaluation took; `otherwise` where it failed."""
    return answer.simulations if isinstance(answer, Evaluation) else otherwise


# --- the page --------------------------------------------------------------------------------------------------------


def _report(
    file: StudyFile,
    folder: Path,
    header: Mapping[str, Any],
    trials: Sequence[Trial],
    final: Mapping[str, Evaluation | Failure],
    said: CalibrationResult,
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
    diagnosis, motions = artifacts.read(folder), artifacts.read_motions(folder)
    page = render(shown, trials, records, said, f"calib run {file.path}", header, diagnosis, motions, study.jobs)
    path = folder / "report.html"
    with whole(path) as temporary:
        temporary.write_text(page, encoding="utf-8")
    return path
