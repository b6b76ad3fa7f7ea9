"""The diagnosis of a study: its calibrated values, the search for what is missing, the files that say so."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import tomlkit

from calib import result
from calib.calibrate import rebuild
from calib.diagnosis.diagnose import NAMED, ONE_OF, Diagnosis, diagnose
from calib.diagnosis.gain import Transfer
from calib.diagnosis.kept import write
from calib.diagnosis.rehearse import SEEDS, STRENGTHS, Case, Rehearsed, rehearse
from calib.diagnosis.selection import Suspect
from calib.errors import CalibError
from calib.files import whole
from calib.store.plain import plain
from calib.study_toml import StudyFile, load

REHEARSAL, PICTURE = "rehearsal.jsonl", "rehearsal.png"
EXTENDED = "extended"
WIDTH = 4.0  # standard errors on each side of a size: the window in which the extended study searches it


def inquire(
    path: str | Path,
    out: str | Path | None = None,
    *,
    seed: int | None = None,
    jobs: int | None = None,
    apply: bool = False,
    on_stage: Callable[[str], None] = lambda text: None,
) -> tuple[dict[str, Any], Path | None]:
    """Diagnose a calibrated study: `calib diagnose` from Python.

    Parameters
    ----------
    path : study file, or a folder with a study.toml; `calib run` must have found values
    out : folder of the results; None: the study's
    seed : of the noise that is drawn; None: the study's
    jobs : takes the place of the file's
    apply : write study.extended.toml beside the study
    on_stage : called with what is being done

    Returns
    -------
    what diagnosis.json says, and the path of the extended study (None where none was written)

    Raises
    ------
    CalibError : a mistake in the study file, or it has not been calibrated
    """
    file = load(path, jobs=jobs)
    folder = file.folder if out is None else Path(out)
    values = _calibrated(file, folder)
    found = diagnose(
        file.study, file.others, values, file.suspects(),
        seed=file.study.seed if seed is None else seed, on_stage=on_stage,
    )  # fmt: skip
    said = write(found, folder, values, {**file.study.objective.references, **file.others})
    rebuild(path, out)
    extended = _extended(file, found) if apply and found.verdict in (NAMED, ONE_OF) else None
    return said, extended


def _calibrated(file: StudyFile, folder: Path) -> Mapping[str, float]:
    said = result.read(folder)
    if said is None:
        raise CalibError(f"there is no {result.NAME} in {folder}: calibrate first, with `calib run {file.path}`")
    if not said["values"]:
        raise CalibError(f"no trial of the study in {folder} ended well: there are no values to diagnose")
    missing = [name for name in file.study.space.names if name not in said["values"]]
    if missing:
        raise CalibError(
            f"{folder / result.NAME} has no value of {missing[0]}, which the study searches: it was changed since; "
            f"run `calib run {file.path}` again"
        )
    return {**file.study.space.fixed, **said["values"]}


# --- the rehearsal ----------------------------------------------------------------------------------------------------


def rehearsed(
    path: str | Path,
    out: str | Path | None = None,
    *,
    seeds: int = SEEDS,
    strengths: Sequence[float] = STRENGTHS,
    jobs: int | None = None,
    fresh: bool = False,
    on_case: Callable[[int, int], None] = lambda done, of: None,
) -> list[Rehearsed]:
    """Hide every candidate in data of a calibrated study's own model and seek it; go on with what was played before.

    Each case is written to rehearsal.jsonl as it ends. Cases belong to the calibrated values and their sizes: after
    another `calib run` they are played anew.

    Parameters
    ----------
    path, out, jobs : as in `inquire`
    seeds, strengths : see `calib.diagnosis.rehearse.rehearse`
    fresh : forget what was played
    on_case : called with the number of cases that are done, and of all

    Raises
    ------
    CalibError : a mistake in the study file, or it has not been calibrated, or cannot be diagnosed
    """
    file = load(path, jobs=jobs)
    folder = file.folder if out is None else Path(out)
    ledger = folder / REHEARSAL
    if fresh:
        ledger.unlink(missing_ok=True)
    done = {one.case.key: one for one in _played(ledger)}
    with ledger.open("a", encoding="utf-8") as lines:

        def keep(one: Rehearsed, number: int, of: int) -> None:
            lines.write(json.dumps(plain(asdict(one))) + "\n")
            lines.flush()
            on_case(number, of)

        values = _calibrated(file, folder)
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
    found = []
    for line in whole_lines.splitlines():
        one = json.loads(line)
        case = one["case"]
        strength = math.nan if case["strength"] is None else case["strength"]
        values = {name: math.inf if value is None else value for name, value in case["values"].items()}
        known = Case(case["effect"], strength, values, case["seed"], case["units"])
        classes = tuple(map(tuple, one["classes"]))
        found.append(Rehearsed(known, one["verdict"], tuple(one["causes"]), classes, one["reason"]))
    return found


# --- the extended study -----------------------------------------------------------------------------------------------


def _extended(file: StudyFile, found: Diagnosis) -> Path:
    """Write the study with the causes in its model, and with windows from their intervals."""
    document = tomlkit.parse(file.path.read_text(encoding="utf-8"))
    document["study"]["name"] = f"{document['study']['name']} {EXTENDED}"
    model = document["model"]
    effects = model.setdefault("effects", tomlkit.array())
    fixed = model.setdefault("fixed", tomlkit.inline_table())
    for cause in found.selection.causes:
        effects.append(_entry(cause))
        for name, value in cause.candidate.held.items():
            fixed[name] = float(value)
        for name, low, high in _windows(cause, () if found.gain is None else found.gain.transfers):
            if low < high:
                window = tomlkit.inline_table()
                window.update({"low": low, "high": high})
                document["windows"][name] = window
            else:
                fixed[name] = low
    path = file.path.with_name(f"{file.path.stem}.{EXTENDED}.toml")
    with whole(path) as temporary:
        temporary.write_text(tomlkit.dumps(document), encoding="utf-8")
    return path


def _entry(cause: Suspect):
    bodies = cause.candidate.effect.bodies
    if bodies is None:
        return cause.name
    entry = tomlkit.inline_table()
    entry.update({"name": cause.name, "bodies": list(bodies)})
    return entry


def _windows(cause: Suspect, transfers: Sequence[Transfer]) -> list[tuple[str, float, float]]:
    """Window of each parameter: so many standard errors about its size, within what makes sense.

    Where records that the diagnosis had disagree by more than that, which noise does not explain, it holds their sizes.
    """
    found = []
    for p, size, error in zip(cause.candidate.parameters, cause.size, cause.error, strict=True):
        half = WIDTH * error if error < 1e300 else abs(size)
        own = [t for t in transfers if t.parameter == p.name and not t.held]
        sizes = [size - half, size + half, *(t.size for t in own if abs(t.size - size) > WIDTH * t.error)]
        found.append((p.name, float(max(p.low, min(sizes))), float(min(p.high, max(sizes)))))
    return found
