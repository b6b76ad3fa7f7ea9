"""One run before a search: a missing program or a wrong reader is found before any trial."""

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import xarray as xr

from calib.errors import CalibError, FirstRunFailed
from calib.execution.files import whole
from calib.execution.pool import REFUSED, Failure
from calib.execution.workers import workers
from calib.modelling.dry_run import DryRun
from calib.modelling.model import Model
from calib.modelling.parameter import values_for
from calib.objective import Reference
from calib.records import OK, failed
from calib.study_file import StudyFile, load
from calib.study_file.values_check import start_values
from calib.workflows.command_line import command_line

PASSED = "dry-run.json"  # in the folder of the results: of which study a dry run has ended well


@dataclass(frozen=True, eq=False)
class StudyDryRun:
    """The dry run of a study.

    Attributes
    ----------
    record : name of the record that was simulated
    values : parameter -> value at which it was simulated, in SI
    run : what it has shown
    measured : the record that it is to be compared with
    """

    record: str
    values: Mapping[str, float]
    run: DryRun
    measured: xr.Dataset

    @property
    def succeeded(self) -> bool:
        """Whether it gave a record that can be compared."""
        return bool(self.run.record.attrs["status"] == OK)


def dry_run_study(path: str | Path, out: str | Path | None = None) -> StudyDryRun:
    """Simulate the first record that a study calibrates on, once: `calib run --dry-run`.

    Raises
    ------
    CalibError : a mistake in the study file, or the simulator refuses
    """
    file = load(path, out=out)
    dry = _tried(file)
    if dry.succeeded:
        _pass(file)
    return dry


def check_simulator_runs(file: StudyFile, on_stage: Callable[[str], None] = lambda _: None) -> None:
    """Make a dry run of a simulator that offers one, unless one has ended well for the same simulator and record.

    on_stage : called with what begins

    Raises
    ------
    FirstRunFailed : it has failed; the message says how
    """
    if not hasattr(file.study.model.simulator, "dry_run") or _passed(file):
        return
    on_stage("dry run")
    dry = _tried(file)
    if not dry.succeeded:
        attrs, again = dry.run.record.attrs, command_line("run", "--dry-run", file.path)
        raise FirstRunFailed(
            f"the first run, of record {dry.record!r} at the starting or nominal values, failed ({attrs['status']}): "
            f"{attrs['reason']}; `{again}` shows it; start values of [windows] choose another "
            "point"
        )
    _pass(file)


def _tried(file: StudyFile) -> StudyDryRun:
    reference = next(iter(file.study.objective.references.values()))
    values = values_for(start_values(file.study.model, file.study.space), reference.name)
    study = file.study
    with workers(partial(_run, study.model, reference), study.evaluated_by, study.timeout, modules=study.code) as pool:
        [(_, answer)] = pool.map([values])
    if isinstance(answer, Failure):
        if answer.status == REFUSED:
            raise CalibError(answer.reason)
        answer = DryRun(failed(file.study.model.bodies, answer.status, answer.reason))
    return StudyDryRun(reference.name, {**file.study.model.nominal, **values}, answer, reference.record)


def _run(model: Model, reference: Reference, values: Mapping[str, float]) -> DryRun:
    return model.dry_run(values, reference.excitation, reference.request)


def _identity(file: StudyFile) -> str:
    """SHA-256 of what a dry run tries."""
    definition: Mapping[str, Any] = file.study.header.definition
    parts = [definition.get("model"), definition.get("records"), definition.get("request"), dict(file.study.code)]
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def _passed(file: StudyFile) -> bool:
    try:
        stated = json.loads((file.folder / PASSED).read_text(encoding="utf-8"))
        return bool(stated["identity"] == _identity(file))
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return False


def _pass(file: StudyFile) -> None:
    file.folder.mkdir(parents=True, exist_ok=True)
    with whole(file.folder / PASSED) as temporary:
        temporary.write_text(json.dumps({"identity": _identity(file)}) + "\n", encoding="utf-8")
