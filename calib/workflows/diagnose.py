"""The diagnosis of a study: its calibrated values, the search for what is missing, the files that say so."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from calib.diagnosis.artifacts import write
from calib.diagnosis.diagnose import Diagnosis, diagnose
from calib.diagnosis.document import DiagnosisResult
from calib.diagnosis.effort import Budget
from calib.diagnosis.verdict import NAMED, ONE_OF
from calib.study_file import StudyFile, load, stated_candidates
from calib.workflows.calibrate import rebuild_file
from calib.workflows.calibrated import calibrated_values, check_calibrated, folder_of_results
from calib.workflows.extension import extended_study
from calib.workflows.kept_simulations import kept_simulations

SIMULATIONS = "diagnosis.simulations"  # file of those of a diagnosis that did not end


def diagnose_study(
    path: str | Path,
    out: str | Path | None = None,
    *,
    seed: int | None = None,
    jobs: int | None = None,
    apply: bool = False,
    on_stage: Callable[[str], None] = lambda text: None,
    on_progress: Callable[[int, int], None] = lambda done, foreseen: None,
    budget: str | None = None,
    candidates: str | Sequence[str | Mapping[str, Any]] | None = None,
    pool: Mapping[str, Any] | None = None,
) -> tuple[DiagnosisResult, Path | None]:
    """Diagnose a calibrated study: `calib diagnose` from Python.

    Simulations are kept until it ends with all tried: after one that was stopped or killed, or whose budget was spent,
    the next begins with them.

    Parameters
    ----------
    path : study file, or a folder with a study.toml; `calib run` must have found values
    out : folder of the results; None: the study's
    seed : of the noise that is drawn; None: the study's
    jobs : takes the place of the file's
    apply : write study.extended.toml beside the study, where an effect is named
    on_stage : called with what is being done
    on_progress : called with the simulations that are done, and those that are foreseen in all
    budget : a number of simulations, or a time such as "10 min", within which the search ends, be it in the middle of
        a fit, so that what concludes it still runs; None: any
    candidates : effects that may be the cause, as [diagnosis] candidates has them; None: the study's
    pool : keys of a [pool] table that takes the place of the file's

    Returns
    -------
    what diagnosis.json says, and the path of the extended study (None where none was written)

    Raises
    ------
    CalibError : a mistake in the study file, the candidates or the budget, or the study has not been calibrated
    """
    limit = Budget.of(budget)
    check_calibrated(path, folder_of_results(path, out))  # before records are read, which takes long
    file = load(path, jobs=jobs, out=out, pool=pool)
    if candidates is not None:
        file = replace(file, candidates=stated_candidates(candidates, file.path.parent))
    values = calibrated_values(file, file.folder)
    with kept_simulations(file, SIMULATIONS, on_stage) as kept:
        diagnosis = diagnose(
            file.study, file.others, values, file.suspects(), seed=file.study.seed if seed is None else seed,
            on_stage=on_stage, on_progress=on_progress, budget=limit, laboratory=file.laboratory, kept=kept,
        )  # fmt: skip
        result = write(diagnosis, file.folder, values, {**file.study.objective.references, **file.others})
        if not diagnosis.cut_short:
            kept.remove()
    _warn_of_refused(file, diagnosis.refused)
    rebuild_file(file)
    return result, _extended(file, diagnosis) if apply else None


def _extended(file: StudyFile, diagnosis: Diagnosis) -> Path | None:
    """Write the study with the causes of a diagnosis; None where it has none."""
    selection = diagnosis.selection
    if diagnosis.verdict not in (NAMED, ONE_OF) or selection is None or not selection.causes:
        return None
    causes = [cause.candidate for cause in selection.causes]
    transfers = () if diagnosis.gain is None else diagnosis.gain.transfers
    return extended_study(file, selection.final, causes, file.effect_references(), transfers)


def _warn_of_refused(file: StudyFile, refused: Mapping[str, str]) -> None:
    """Name each candidate that the study states by itself and that could not be tested.

    refused : effect -> why it is no candidate
    """
    for entry in file.candidates or ():
        effect = entry.effect(file.path.parent).name
        if entry.named and effect in refused:
            warnings.warn(f"candidate {effect!r} was not tested: {refused[effect]}", stacklevel=3)
