"""The diagnosis of a study: its calibrated values, the search for what is missing, the files that say so."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from tomlkit.items import AbstractTable, Table

from calib import result
from calib.calibrate import rebuild
from calib.diagnosis.diagnose import Diagnosis, diagnose
from calib.diagnosis.effort import Budget
from calib.diagnosis.gain import Transfer
from calib.diagnosis.kept import write
from calib.diagnosis.refit import Fit
from calib.diagnosis.rehearse import SEEDS, STRENGTHS, Case, Rehearsed, rehearse
from calib.diagnosis.suspect import Refitted
from calib.diagnosis.verdict import NAMED, ONE_OF
from calib.errors import CalibError
from calib.files import whole
from calib.parameter import Parameter, Space, Window
from calib.store.plain import plain
from calib.study_toml import StudyFile, load

REHEARSAL, PICTURE = "rehearsal.jsonl", "rehearsal.png"
EXTENDED = "extended"
WIDTH = 4.0  # standard errors on each side of a size: the window in which the extended study searches it
HALF_WIDTHS = 2.0  # of a window, in half widths of the 95 % interval at least
LEAST_HALF_WIDTH = 0.1  # of the departure from null: the study's terms weigh the records otherwise than the diagnosis
NEAR_EDGE = 0.1  # of a window: a value nearer to its end may be at its edge


def inquire(
    path: str | Path,
    out: str | Path | None = None,
    *,
    seed: int | None = None,
    jobs: int | None = None,
    apply: bool = False,
    on_stage: Callable[[str], None] = lambda text: None,
    on_progress: Callable[[int, int], None] = lambda done, foreseen: None,
    budget: str | None = None,
) -> tuple[dict[str, Any], Path | None]:
    """Diagnose a calibrated study: `calib diagnose` from Python.

    Parameters
    ----------
    path : study file, or a folder with a study.toml; `calib run` must have found values
    out : folder of the results; None: the study's
    seed : of the noise that is drawn; None: the study's
    jobs : takes the place of the file's
    apply : write study.extended.toml beside the study, where an effect is named
    on_stage : called with what is being done
    on_progress : called with the simulations that are done, and those that are foreseen in all
    budget : a number of simulations, or a time such as "10 min", after which no further fit begins; None: any

    Returns
    -------
    what diagnosis.json says, and the path of the extended study (None where none was written)

    Raises
    ------
    CalibError : a mistake in the study file or the budget, or the study has not been calibrated
    """
    limit = Budget.of(budget)
    file = load(path, jobs=jobs)
    folder = file.folder if out is None else Path(out)
    values = _calibrated(file, folder)
    found = diagnose(
        file.study, file.others, values, file.suspects(), seed=file.study.seed if seed is None else seed,
        on_stage=on_stage, on_progress=on_progress, budget=limit, laboratory=file.laboratory,
    )  # fmt: skip
    said = write(found, folder, values, {**file.study.objective.references, **file.others})
    rebuild(path, out, jobs)
    named = found.verdict in (NAMED, ONE_OF) and found.selection.causes
    extended = _extended(file, found) if apply and named else None
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
    """Write the study with the causes in its model; it starts where the diagnosis ended."""
    document = tomlkit.parse(file.path.read_text(encoding="utf-8"))
    document["study"]["name"] = f"{document['study']['name']} {EXTENDED}"
    final = found.selection.final
    _widened(document["windows"], file.study.space, file.study.model.parameters, final)
    _with_causes(document, file.effect_references(), found)
    sizes = [name for cause in found.selection.causes for name in cause.candidate.free]
    for name in (*file.study.space.names, *sizes):
        document["windows"][name]["start"] = final.value(name)
    path = file.path.with_name(f"{file.path.stem}.{EXTENDED}.toml")
    with whole(path) as temporary:
        temporary.write_text(tomlkit.dumps(document), encoding="utf-8")
    return path


def _with_causes(document: tomlkit.TOMLDocument, references: Mapping[str, str], found: Diagnosis) -> None:
    """Add the causes to the model, and a window for each parameter that was fitted with them."""
    model = document["model"]
    effects = model.setdefault("effects", tomlkit.array())
    fixed = model.setdefault("fixed", tomlkit.inline_table())
    alone = () if found.gain is None else found.gain.transfers
    for cause in found.selection.causes:
        effects.append(_entry(cause, references[cause.name]))
        for name, value in cause.candidate.held.items():
            fixed[name] = float(value)
        for name, window in _windows(cause, found.selection.final, alone).items():
            document["windows"][name] = tomlkit.inline_table()
            document["windows"][name].update({"low": window.low, "high": window.high})
            _remark(document["windows"], name, f"{WIDTH:g} joint standard errors on each side; sizes of the records")


def _entry(cause: Refitted, reference: str):
    """Entry of [model] effects under which the effect loads that the diagnosis has found, on the same bodies."""
    bodies = cause.candidate.effect.bodies
    if bodies is None:
        return reference
    entry = tomlkit.inline_table()
    entry.update({"name": reference, "bodies": list(bodies)})
    return entry


def _windows(cause: Refitted, final: Fit, alone: Sequence[Transfer]) -> dict[str, Window]:
    """Window of each parameter of a cause, within what makes sense: `WIDTH` joint standard errors about its joint size.

    It holds twice the 95 % interval and the sizes of the records that the diagnosis had, as far as they know more of it
    than that it is there, and is never narrower than a tenth of the size on each side.
    """
    windows = {}
    for p in cause.candidate.parameters:
        size, error = final.value(p.name), float(final.error([p.name])[0])
        interval = float(final.half_width([p.name])[0])  # wide where the error has few degrees of freedom
        departure = abs(size - (p.null if p.null is not None and np.isfinite(p.null) else 0.0))
        least = LEAST_HALF_WIDTH * (departure or cause.candidate.scale[p.name])
        half = max(WIDTH * error, HALF_WIDTHS * interval, least) if np.isfinite(interval) else max(departure, least)
        own = [t.size for t in alone if t.parameter == p.name and not t.held and t.error <= departure]
        windows[p.name] = _rounded(min([size - half, *own]), max([size + half, *own]), half, p)
    return windows


def _rounded(low: float, high: float, half: float, parameter: Parameter) -> Window:
    """Window rounded outwards to a hundredth of its half width, as far as the parameter's bounds let it."""
    step = Decimal(1).scaleb(math.floor(math.log10(half)) - 2)
    low = float(Decimal(str(float(low))).quantize(step, ROUND_FLOOR))
    high = float(Decimal(str(float(high))).quantize(step, ROUND_CEILING))
    return Window(float(max(parameter.low, low)), float(min(parameter.high, high)))


def _widened(windows: AbstractTable, space: Space, parameters: Mapping[str, Parameter], final: Fit) -> None:
    """Widen the windows at whose edges the diagnosis ended, by half of their width on that side."""
    for name, window in space.windows.items():
        allowed = parameters[name.partition("@")[0]]
        ends = {"low": _widened_end(window, 0.0, allowed.low, final, name)}
        ends["high"] = _widened_end(window, 1.0, allowed.high, final, name)
        changed = {end: value for end, value in ends.items() if value != getattr(window, end)}
        if changed:
            windows[name].update(changed)
            _remark(windows, name, f"{' and '.join(changed)} widened: the diagnosis ended there")


def _remark(windows: AbstractTable, name: str, text: str) -> None:
    """Write a comment behind a window and what stands there already, where TOML has room for one."""
    if isinstance(windows, Table) and isinstance(windows[name], AbstractTable):
        known = windows[name].trivia.comment.removeprefix("#").strip()
        windows[name].comment("; ".join(filter(None, [known, text])))


def _widened_end(window: Window, end: float, bound: float, final: Fit, name: str) -> float:
    """End 0 (low) or 1 (high) of a window, where the fitted value is near it farther out, but not beyond the bound.

    Near is within `WIDTH` joint standard errors, and within a tenth of the window.
    """
    edge, value = window.value(end), final.value(name)
    near = abs(value - edge) <= WIDTH * float(final.error([name])[0]) and abs(window.position(value) - end) <= NEAR_EDGE
    if not near:
        return edge
    factor = window.high / window.low if window.scale == "log" else 1.0
    step = 0.5 * (window.high - window.low)
    if end == 0.0:
        return max(bound, edge / math.sqrt(factor) if window.scale == "log" else edge - step)
    return min(bound, edge * math.sqrt(factor) if window.scale == "log" else edge + step)
