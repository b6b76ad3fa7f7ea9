"""The rehearsal of a study: every candidate is hidden in data of its own model, and sought."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from calib.diagnosis.rehearse import HIDDEN_Z, SEEDS_PER_SIZE, RehearsalCase, Rehearsed, rehearse
from calib.store.plain import plain
from calib.study_file import load
from calib.workflows.calibrated import calibrated_values

REHEARSAL, PICTURE = "rehearsal.jsonl", "rehearsal.png"


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

    Each case is written to rehearsal.jsonl as it ends. Cases belong to the calibrated values and their sizes: after
    another `calib run` they are played anew.

    Parameters
    ----------
    path, out, jobs, pool : as in `calib.workflows.diagnose.diagnose_study`
    seeds, strengths : see `calib.diagnosis.rehearse.rehearse`
    fresh : forget what was played
    on_case : called with the number of cases that are done, and of all

    Raises
    ------
    CalibError : a mistake in the study file, or it has not been calibrated, or cannot be diagnosed
    """
    file = load(path, jobs=jobs, out=out, pool=pool)
    folder = file.folder
    values = calibrated_values(file, folder)
    ledger = folder / REHEARSAL
    if fresh:
        ledger.unlink(missing_ok=True)
    done = {one.case.key: one for one in _played(ledger)}
    with ledger.open("a", encoding="utf-8") as lines:

        def keep(one: Rehearsed, number: int, of: int) -> None:
            lines.write(json.dumps(plain(one)) + "\n")
            lines.flush()
            on_case(number, of)

        effects = file.suspects()
        return rehearse(
            file.study, file.others, values, effects, strengths=strengths, seeds=seeds, done=done, on_case=keep
        )


def _played(ledger: Path) -> list[Rehearsed]:
    """Read the cases of a ledger; a torn last line is left out."""
    if not ledger.is_file():
        return []
    text = ledger.read_text(encoding="utf-8")
    whole_lines = text[: text.rfind("\n") + 1]
    if whole_lines != text:
        ledger.write_text(whole_lines, encoding="utf-8")
    cases = []
    for line in whole_lines.splitlines():
        one = json.loads(line)
        case = one["case"]
        strength = math.nan if case["strength"] is None else case["strength"]
        values = {name: math.inf if value is None else value for name, value in case["values"].items()}
        known = RehearsalCase(case["effect"], strength, values, case["seed"], case["units"])
        classes = tuple(map(tuple, one["classes"]))
        cases.append(Rehearsed(known, one["verdict"], tuple(one["causes"]), classes, one["reason"]))
    return cases
