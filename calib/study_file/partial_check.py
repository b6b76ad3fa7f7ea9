"""What remains to be checked of a study file whose tables have mistakes."""

from collections.abc import Callable, Mapping
from typing import Any

from calib.study_file.schema import (
    ConfidenceTable,
    DiagnosisTable,
    ModelTable,
    OptimiserTable,
    RecordTable,
    StoreTable,
    StudyTable,
    StudyToml,
    TermTable,
    WindowTable,
)

REQUIRED = {"name": "", "seed": 0, "budget": 1}  # keys of [study] without a default, where they are mistaken


def without_mistakes(tables: Mapping[str, Any], mistaken: Callable[..., bool]) -> StudyToml:
    """Build the tables of a study file without what is mistaken in them.

    Entries of [[record]] and [[term]] keep their places: a mistaken one is represented by an entry without content,
    whose name is "" where none can be read. Mistaken windows and keys of [study] are left out; [model], [optimiser],
    [store], [diagnosis] and [confidence] are left out as a whole.

    Parameters
    ----------
    tables : the text as TOML reads it
    mistaken : whether a mistake was noted at or below a key, such as ("record", 0)
    """

    def table(name: str) -> dict[str, Any]:
        return {} if mistaken(name) else tables.get(name, {})

    head = tables.get("study", {})
    stated = {key: value for key, value in head.items() if not mistaken("study", key)} if _is_table(head) else {}
    windows = tables.get("windows", {})
    return StudyToml.model_construct(
        study=StudyTable.model_validate(REQUIRED | stated),
        record=[
            _unread_record(entry) if mistaken("record", index) else RecordTable.model_validate(entry)
            for index, entry in enumerate(_entries(tables, "record"))
        ],
        model=ModelTable.model_validate({"simulator": ""} | table("model")),
        windows={
            name: WindowTable.model_validate(window)
            for name, window in (windows.items() if _is_table(windows) else ())
            if not mistaken("windows", name)
        },
        term=[
            TermTable(feature="") if mistaken("term", index) else TermTable.model_validate(entry)
            for index, entry in enumerate(_entries(tables, "term"))
        ],
        optimiser=OptimiserTable.model_validate(table("optimiser")),
        store=StoreTable.model_validate(table("store")),
        diagnosis=DiagnosisTable.model_validate(table("diagnosis")),
        confidence=ConfidenceTable.model_validate(table("confidence")),
    )


def _unread_record(entry: object) -> RecordTable:
    name = entry.get("name") if isinstance(entry, dict) else None
    return RecordTable.model_construct(name=name if isinstance(name, str) else "", path="")


def _entries(tables: Mapping[str, Any], name: str) -> list[Any]:
    entries = tables.get(name, [])
    return entries if isinstance(entries, list) else []


def _is_table(value: object) -> bool:
    return isinstance(value, dict)
