"""A study file saved with what it refers to: records from Python, and modules that lay beside it."""

import shutil
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomlkit

from calib.errors import CalibError
from calib.execution.files import whole
from calib.plugins import module_file
from calib.records import read, write
from calib.store.ledger import differences
from calib.workflows.document import MEASURED, record_file, references_in
from calib.workflows.record import Record

RUN_KEYS = ("budget", "jobs", "timeout")  # of [study]: a study that is gone on with may have others


def save_study(
    path: Path, document: Mapping[str, Any], records: Mapping[str, Record], modules: Path | None, overwrite: bool
) -> None:
    """Write a study file, records from Python and modules beside it.

    Parameters
    ----------
    path : of the study file
    document : what it says
    records : from Python, by name
    modules : folder from which modules are taken along; None: there are none
    overwrite : whether what is there is replaced, where it says something else

    Raises
    ------
    CalibError : there is another study, record or module of that name; the folder cannot be written
    """
    files = [] if modules is None else _modules(document, modules, path.parent)
    if not overwrite:
        _check_free(path, document, records, files)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        for name, record in records.items():
            (path.parent / MEASURED).mkdir(exist_ok=True)
            write(record.dataset, path.parent / record_file(name))
        for source, target in files:
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, target)
        with whole(path) as temporary:
            temporary.write_text(tomlkit.dumps(document), encoding="utf-8")
    except OSError as error:
        raise CalibError(f"{error.filename or path} cannot be written: {error.strerror or error}") from error


def _modules(document: Mapping[str, Any], source: Path, folder: Path) -> list[tuple[Path, Path]]:
    """Files of modules of a document that lie in `source`, and where they lie beside a study file in `folder`."""
    if source == folder.resolve():
        return []
    files = [module_file(source, reference.partition(":")[0]) for reference in references_in(document)]
    return [(file, folder / file.relative_to(source)) for file in files if file is not None]


def _check_free(
    path: Path, document: Mapping[str, Any], records: Mapping[str, Record], modules: list[tuple[Path, Path]]
) -> None:
    """Refuse to write where something else is: the budget, the processes, the pool and the time-out may differ."""
    hint = "choose another folder, or overwrite it"
    if path.is_file():
        try:
            there = tomllib.loads(path.read_text(encoding="utf-8"))
        except ValueError as error:
            raise CalibError(f"{path} is no study ({error}); {hint}") from error
        changes = differences(_without_run_keys(there), _without_run_keys(document))
        if changes:
            raise CalibError(f"{path} is another study: it differs in {changes[0]}; {hint}")
    for name, record in records.items():
        file = path.parent / record_file(name)
        if file.is_file() and not read(file).equals(record.dataset):
            raise CalibError(f"{file} is another record; {hint}")
    for source, target in modules:
        if target.is_file() and target.read_bytes() != source.read_bytes():
            raise CalibError(f"{target} is another module; {hint}")


def _without_run_keys(document: Mapping[str, Any]) -> dict[str, Any]:
    own = {table: content for table, content in document.items() if table != "pool"}
    head = {key: value for key, value in document.get("study", {}).items() if key not in RUN_KEYS}
    return {**own, "study": head} if "study" in document else own
