"""The rehearsal of a study: every candidate is hidden in data of its own model, and sought."""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from calib.diagnosis.rehearse import HIDDEN_Z, SEEDS_PER_SIZE, RehearsalCase, Rehearsed, rehearse
from calib.modelling.effect import Effect
from calib.store.lock import Lock
from calib.store.notes import PieceNotes
from calib.store.plain import plain
from calib.study_file import StudyFile, load
from calib.workflows.calibrated import calibrated_values

REHEARSAL, PICTURE = "rehearsal.jsonl", "rehearsal.png"
REHEARSAL_FORMAT_VERSION = 2  # of the cases: those of another are played anew


def rehearse_study(
    path: str | Path,
    out: str | Path | None = None,
    *,
    seeds: int = SEEDS_PER_SIZE,
    strengths: Sequence[float] = HIDDEN_Z,
    jobs: int | None = None,
    fresh: bool = False,
    on_case: Callable[[int, int], None] = lambda done, of: None,
    pool: Mapping[str, Any] | None = None,
) -> list[Rehearsed]:
    """Hide every candidate in data of a calibrated study's own model and seek it; go on with what was played before.

    Each case is written to rehearsal.jsonl as it ends. Cases belong to the study and its code, the calibrated values
    and the candidates: where one of these has changed, all are played anew. Those that failed are played again.

    Parameters
    ----------
    path, out, jobs, pool : as in `calib.workflows.diagnose.diagnose_study`
    seeds, strengths : see `calib.diagnosis.rehearse.rehearse`
    fresh : forget what was played
    on_case : called with the number of cases that are done, and of all

    Raises
    ------
    CalibError : a mistake in the study file, or it has not been calibrated, or cannot be diagnosed; or another process
        writes in the folder
    """
    file = load(path, jobs=jobs, out=out, pool=pool)
    folder = file.folder
    values, effects = calibrated_values(file, folder), file.suspects()
    ledger = folder / REHEARSAL
    lock = Lock(folder, ledger)
    lock.acquire()
    try:
        if fresh:
            ledger.unlink(missing_ok=True)
        with PieceNotes(ledger, identity_of_cases(file, values, effects), "case", _rehearsed) as notes:

            def keep(one: Rehearsed, number: int, of: int) -> None:
                notes.add(one.case.key, one)
                on_case(number, of)

            return rehearse(
                file.study, file.others, values, effects, strengths=strengths, seeds=seeds, done=dict(notes.pieces),
                on_case=keep,
            )  # fmt: skip
    finally:
        lock.release()


def identity_of_cases(file: StudyFile, values: Mapping[str, float], effects: Sequence[Effect]) -> list[Any]:
    """All that decides what cases come to: the study and its code, the calibrated values, and the candidates."""
    candidates = [[effect.name, plain(effect.parameters)] for effect in effects]
    code = {**file.candidate_code(), **file.study.code}
    return [REHEARSAL_FORMAT_VERSION, file.study.header.definition, code, dict(values), candidates]


def _rehearsed(document: Mapping[str, Any]) -> Rehearsed:
    """Read what a case came to."""
    case = document["case"]
    known = RehearsalCase(case["effect"], _number(case["strength"]), case["values"], case["seed"], case["units"])
    classes = tuple(map(tuple, document["classes"]))
    return Rehearsed(known, document["verdict"], tuple(document["causes"]), classes, document["reason"])


def _number(value: float | None) -> float:
    return math.nan if value is None else value
