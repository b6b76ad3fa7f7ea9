"""The main job: search, confirm, judge, predict the records held out, summarise and report."""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import xarray as xr

from calib.confidence import Confidence, around_best, describe_near_optimal, foreseen_noise_draws
from calib.errors import CalibError
from calib.execution.files import whole
from calib.execution.pool import Failure, in_order
from calib.objective import Objective, record_misfit
from calib.records import OK, failed
from calib.store import Header, Store, Trial, read
from calib.store.trial import best
from calib.study import (
    INTERRUPTED,
    CalibrationResult,
    CalibrationStudy,
    Confirmation,
    Evaluation,
    SearchResult,
    confirm,
    leaders,
    reach,
    result,
)
from calib.study.cached import answered_from_cache
from calib.study.progress import Progress
from calib.study.repetition import repetition
from calib.study.result import HeldOutSummary
from calib.study.summary import held_out, not_simulated, summarised
from calib.study_file import StudyFile, load
from calib.workflows import stored
from calib.workflows.calibrated import calibration_command, check_free, folder_of_results
from calib.workflows.doubtful_records import doubtful_records
from calib.workflows.dry_run import check_simulator_runs
from calib.workflows.evaluations import CALIBRATED, CONFIRM, SEARCH, Case, Evaluations, IdleWorkers, held_out_references
from calib.workflows.record_remarks import record_remarks
from calib.workflows.residual import residuals_beside_noise

UNFINISHED = "not finished"  # why a search ended that has not


@dataclass(frozen=True, eq=False)
class BestPoint:
    """The best trial of a study, evaluated on the calibrated records.

    Attributes
    ----------
    trial : with its confirmed score where it was confirmed
    confirming : whether the confirming model evaluated it, or that of the search
    evaluation : of the calibrated records
    confidence : in its values; None where it was not worked out
    repetition : remark on the trial evaluated again by the simulator of the search; empty where it gave the same score
    """

    trial: Trial
    confirming: bool
    evaluation: Evaluation | Failure
    confidence: Confidence | None = None
    repetition: str = ""


@dataclass(frozen=True, eq=False)
class Calibrated:
    """A calibration with everything that its report shows.

    Attributes
    ----------
    header, trials : of the ledger
    point : None where no trial ended ok
    predictions : record held out -> its evaluation at the best point
    result : what result.json holds
    """

    header: Header
    trials: Sequence[Trial]
    point: BestPoint | None
    predictions: Mapping[str, Evaluation | Failure]
    result: CalibrationResult


def calibrate(
    path: str | Path,
    out: str | Path | None = None,
    *,
    budget: int | None = None,
    jobs: int | None = None,
    fresh: bool = False,
    quiet: bool = False,
    pool: Mapping[str, Any] | None = None,
) -> CalibrationResult:
    """Run a study to its end, or go on with it, and write what it found: `calib run` from Python.

    Parameters
    ----------
    path : study file, or a folder with a study.toml
    out : folder of the results (trials.jsonl, result.json, report.html, best.nc, ...); None: out/ beside the study file
    budget, jobs : take the place of the file's
    fresh : forget the trials made so far
    quiet : no progress on stderr
    pool : keys of a [pool] table that takes the place of the file's

    Returns
    -------
    what result.json holds: values and intervals in SI, score, kind of motion, records held out

    Raises
    ------
    KeyboardInterrupt : stopped by Ctrl-C; the trials are kept
    CalibError : a mistake in the study file; the folder belongs to another study or cannot be written
    """
    check_free(folder_of_results(path, out))
    file = load(path, budget=budget, jobs=jobs, out=out, pool=pool)
    return calibrate_file(file, file.folder, fresh=fresh, quiet=quiet)


def calibrate_file(file: StudyFile, folder: Path, *, fresh: bool = False, quiet: bool = False) -> CalibrationResult:
    """Run a study that is loaded already; its results are in `folder`. The rest as in `calibrate`."""
    with Progress(file.study.budget, quiet=quiet, draws=foreseen_noise_draws(file.study)) as progress:
        return _calibrate(file, folder, progress, fresh)


def rebuild(
    path: str | Path, out: str | Path | None = None, jobs: int | None = None, pool: Mapping[str, Any] | None = None
) -> Path:
    """Write report.html anew from what lies in the folder of a study, and return its path; see `stored.stored_study`.

    `jobs` and `pool` take the place of the file's.
    """
    shown = stored.stored_study(path, out, jobs, pool)
    report = None if shown is None else _reported_from(*shown)
    return report or rebuild_file(load(path, jobs=jobs, out=out, pool=pool))


def rebuild_file(file: StudyFile) -> Path:
    """Write report.html of a study that is loaded already anew; the rest as in `rebuild`."""
    records = stored.stored_records(file)
    report = None if records is None else _reported_from(file, records)
    return report or _reported(file, file.folder, _read_back(file, file.folder))


def _reported_from(file: StudyFile, records: Mapping[str, xr.Dataset]) -> Path | None:
    """Write report.html from the records of the best trial; None where the search has not ended."""
    calibrated = _read_back(file, file.folder, records)
    return None if calibrated.result.stopped == UNFINISHED else _reported(file, file.folder, calibrated)


def summary_so_far(path: str | Path, out: str | Path | None = None) -> CalibrationResult:
    """Return what result.json holds or, where the search has not ended, would hold of the trials that there are.

    Raises
    ------
    CalibError : there are no trials, or they are of another study
    """
    file = load(path, out=out)
    return _read_back(file, file.folder).result


def _calibrate(file: StudyFile, folder: Path, progress: Progress, fresh: bool) -> CalibrationResult:
    """Go through the stages, one after the other; each takes what those before it have found."""
    begin, study = time.monotonic(), file.study
    for doubt in doubtful_records(file):
        progress.note(f"mind: {doubt}")
    check_simulator_runs(file, progress.stage)
    store = Store(folder, file.view, file.keep, partial(_pictured, study.objective))
    with Evaluations(file, folder, progress.note, progress.compiling) as evaluations:
        search = _searched(study, store, evaluations, progress, fresh)
        with store.locked():
            confirmation = _confirmed(study, evaluations, search, progress)
            point = _judged(study, evaluations, search, confirmation, progress)
            predictions = _predicted(file, evaluations, point, progress)
            summary = _summarised(file, search, confirmation, point, predictions, begin)
            progress.stage("report")
            if point is not None and point.confirming and isinstance(point.evaluation, Evaluation):
                store.keep_confirmed(point.trial, point.evaluation.records)
            result.write(summary, store.folder)
            _reported(file, store.folder, Calibrated(store.header, search.trials, point, predictions, summary))
    return summary


# --- the stages ------------------------------------------------------------------------------------------------------


def _searched(
    study: CalibrationStudy, store: Store, evaluations: Evaluations, progress: Progress, fresh: bool
) -> SearchResult:
    """Search to the end.

    Raises
    ------
    KeyboardInterrupt : stopped by Ctrl-C
    """
    progress.stage("screen")
    search = study.run(
        store, evaluations.calibrated(SEARCH), on_trial=progress.trial, fresh=fresh, on_opened=progress.earlier,
        on_ask=IdleWorkers(evaluations, progress.note),
        on_choice=lambda choice: progress.note(choice.note),
        ended=stored.end_of_search(store.folder),
    )  # fmt: skip
    if search.stopped == INTERRUPTED:
        raise KeyboardInterrupt
    return search


def _confirmed(
    study: CalibrationStudy, evaluations: Evaluations, search: SearchResult, progress: Progress
) -> Confirmation | None:
    """Simulate the leaders of the search again; None where there are none, or no confirming simulator."""
    if search.best is None or study.model.confirming is None:
        return None
    progress.stage("confirm")
    return confirm(evaluations.calibrated(CONFIRM, confirming=True), leaders(search.trials), progress.leader)


def _judged(
    study: CalibrationStudy,
    evaluations: Evaluations,
    search: SearchResult,
    confirmation: Confirmation | None,
    progress: Progress,
) -> BestPoint | None:
    """Evaluate the best point, and work out how sure its values are; None where no trial ended ok."""
    trial = search.best if confirmation is None else confirmation.best
    if trial is None:
        return None
    progress.stage("confidence")
    pool = evaluations.calibrated(SEARCH)
    [evaluation] = in_order(evaluations.calibrated(SEARCH, afresh=True), [trial.values])
    confidence = around_best(study, pool, trial, evaluation, search.agreement, progress.draw)
    if confirmation is None or not confirmation.succeeded:
        return BestPoint(trial, False, evaluation, confidence, repetition(trial, evaluation))
    chosen = confirmation.chosen
    differs = repetition(chosen.searched, evaluation)
    return BestPoint(trial, True, chosen.evaluation, _by_the_search(confidence, confirmation), differs)


def _by_the_search(confidence: Confidence, confirmation: Confirmation) -> Confidence:
    """Say which simulator the differences are of, where there are any."""
    if confidence.status != OK:
        return confidence
    reason = "the intervals are those of the simulator of the search, by finite differences about the confirmed point"
    if confirmation.changed:
        reason += "; the best point of the search is another one"
    return replace(confidence, reason="; ".join(filter(None, [confidence.reason, reason])))


def _predicted(
    file: StudyFile, evaluations: Evaluations, point: BestPoint | None, progress: Progress
) -> dict[str, Evaluation | Failure]:
    """Evaluate the best point on each record held out, by its name."""
    names = list(held_out_references(file))
    if point is None or not names:
        return {}
    progress.stage("hold-out")
    return evaluations.at(point.trial.values, [Case(point.confirming, name, True) for name in names])


def _summarised(
    file: StudyFile,
    search: SearchResult,
    confirmation: Confirmation | None,
    point: BestPoint | None,
    predictions: Mapping[str, Evaluation | Failure],
    begin: float,
) -> CalibrationResult:
    study, confidence = file.study, None if point is None else point.confidence
    return summarised(
        study,
        search,
        best=None if point is None else point.trial,
        score=point.evaluation.score if point is not None and isinstance(point.evaluation, Evaluation) else None,
        confirmation=confirmation,
        confidence=None if confidence is None else confidence.summary(),
        holdout=_prediction_summaries(file, predictions),
        residual=residuals_beside_noise(study.objective, None if point is None else point.evaluation),
        remarks=[
            *([] if point is None or not point.repetition else [point.repetition]),
            *([] if confirmation is None else confirmation.remarks),
            *_in_the_place_of_intervals(study, search.trials, confidence),
            *record_remarks(study, None if point is None else point.evaluation),
            *answered_from_cache(search.trials),
            *([] if search.choice is None else [search.choice.remark]),
            *getattr(study.model.simulator, "remarks", ()),
        ],
        reproduced=None if point is None else not point.repetition,
        simulations=_simulations(file, search.trials, confirmation, point, predictions),
        seconds=time.monotonic() - begin,
    )


def _pictured(objective: Objective, trial: Trial, records: Mapping[str, xr.Dataset]) -> bytes:
    """Picture of a trial  [PNG]."""
    from calib.report.plots.motion import trial_picture  # 0.5 s with matplotlib, which many a start can do without

    return trial_picture(trial, records, objective)


def _reported(file: StudyFile, folder: Path, calibrated: Calibrated) -> Path:
    """Write report.html; return its path."""
    from calib.report.pages.page import render  # see _pictured

    study, point = file.study, calibrated.point
    known = {**study.objective.references, **file.others}
    records: dict[str, xr.Dataset] = {}
    if point is not None and isinstance(point.evaluation, Evaluation):
        records |= point.evaluation.records
    for name, answer in calibrated.predictions.items():
        if isinstance(answer, Evaluation):
            records |= answer.records
        else:
            records[name] = failed(study.model.bodies, answer.status, answer.reason)
    shown = replace(study, objective=Objective(known, study.objective.terms, study.objective.elsewhere))
    findings = stored.stored_findings(folder)
    page = render(
        shown, calibrated.trials, records, calibrated.result, calibration_command(file.path, folder), calibrated.header,
        findings.diagnosis, findings.motions, study.jobs, stored.base_study(file), findings.discovery,
        findings.confidence, findings.predictions, findings.window, findings.left_out,
    )  # fmt: skip
    path = folder / "report.html"
    with whole(path) as temporary:
        temporary.write_text(page, encoding="utf-8", errors="backslashreplace")  # old ledgers hold half surrogate pairs
    return path


# --- what lies in a folder -------------------------------------------------------------------------------------------


def _read_back(file: StudyFile, folder: Path, records: Mapping[str, xr.Dataset] | None = None) -> Calibrated:
    """A calibration from its ledger and its result; where the search has not ended, as far as its trials tell it.

    Nothing is simulated where there are `records` of the result's best trial.

    Raises
    ------
    CalibError : there are no trials, or they are of another study; the confirming simulator is there no longer
    """
    study = file.study
    header, trials = read(folder, study.header.definition)
    trials.sort(key=lambda trial: trial.number)
    top = best(trials)
    summary = stored.finished_result(folder, trials, top)
    if summary is not None and summary.best_trial is not None:
        top = next(trial for trial in trials if trial.number == summary.best_trial)
    confirming = summary is not None and summary.confirmed
    if confirming and records is None and study.model.confirming is None:
        raise CalibError(
            f"the best trial was confirmed by another simulator, and {study.model.simulator.name!r} no longer names "
            "one; run the study again"
        )
    point: BestPoint | None = None
    predictions: dict[str, Evaluation | Failure] = {}
    if top is not None and records is not None:
        point = BestPoint(top, confirming, stored.scored(study, records))
    elif top is not None:
        point, predictions = _evaluated_again(file, top, confirming)
    if summary is None:
        summary = summarised(
            study,
            SearchResult(best(trials), trials, reach(trials), None, UNFINISHED),
            best=top,
            score=point.evaluation.score if point is not None and isinstance(point.evaluation, Evaluation) else None,
            holdout=_prediction_summaries(file, predictions),
            residual=residuals_beside_noise(study.objective, None if point is None else point.evaluation),
            remarks=record_remarks(study, None if point is None else point.evaluation),
        )
    return Calibrated(header, trials, point, predictions, summary)


def _evaluated_again(
    file: StudyFile, top: Trial, confirming: bool
) -> tuple[BestPoint, dict[str, Evaluation | Failure]]:
    """Evaluate the best trial on the calibrated records and those held out."""
    cases = [Case(confirming, name, True) for name in (*held_out_references(file), CALIBRATED)]
    with Evaluations(file, file.folder) as evaluations:
        answers = evaluations.at(top.values, cases)
    return BestPoint(top, confirming, answers.pop(CALIBRATED)), answers


# --- what the summary says -------------------------------------------------------------------------------------------


def _prediction_summaries(
    file: StudyFile, predictions: Mapping[str, Evaluation | Failure]
) -> dict[str, HeldOutSummary]:
    return {name: _prediction_summary(file, name, answer) for name, answer in predictions.items()}


def _prediction_summary(file: StudyFile, name: str, answer: Evaluation | Failure) -> HeldOutSummary:
    if isinstance(answer, Failure):
        return not_simulated(answer.status, answer.reason)
    if answer.score.status != OK:
        return held_out(answer.score, math.nan)
    reference, objective = file.others[name], file.study.objective
    simulated = answer.records[name]
    compared = objective.on({name: reference}).compared(name, simulated)
    return held_out(answer.score, record_misfit(reference, objective.terms_of(name), simulated, compared))


def _in_the_place_of_intervals(
    study: CalibrationStudy, trials: Sequence[Trial], confidence: Confidence | None
) -> list[str]:
    """Say what nearly equal trials share, where there are no intervals for want of derivatives."""
    if confidence is None or confidence.status == OK or confidence.linearised is not None:
        return []
    units = {name: study.model.parameters[name.partition("@")[0]].unit for name in study.space.names}
    sentence = describe_near_optimal(study.space, trials, units)
    return [sentence] if sentence else []


def _simulations(
    file: StudyFile,
    trials: Sequence[Trial],
    confirmation: Confirmation | None,
    point: BestPoint | None,
    predictions: Mapping[str, Evaluation | Failure],
) -> int:
    """Runs of the simulator in all stages; one a record where an evaluation that failed does not tell them."""
    each = len(file.study.objective.references)
    searched = sum(each if trial.simulations is None else trial.simulations for trial in trials)
    again = 0 if confirmation is None else sum(_runs(leader.evaluation, each) for leader in confirmation.leaders)
    if point is None or point.confidence is None:
        return searched + again
    centre = _runs(point.evaluation, each)  # its neighbours take as many
    predicted = sum(_runs(answer, 1) for answer in predictions.values())
    return searched + again + centre * (1 + point.confidence.evaluations) + predicted


def _runs(answer: Evaluation | Failure, otherwise: int) -> int:
    """Runs of the simulator that an evaluation took; `otherwise` where it failed."""
    return answer.simulations if isinstance(answer, Evaluation) else otherwise
