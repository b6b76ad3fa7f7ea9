"""A study file as a document: its entries from what is given in Python."""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from calib import plugins
from calib.errors import CalibError
from calib.workflows.record import Record

MEASURED = "measured"  # folder beside a study file in which records from Python lie


def place(name: str) -> str:
    """Place of the data of a record, relative to its study file."""
    return f"{MEASURED}/{quote(name, safe='')}.nc"


def without_place(text: str, path: Path) -> str:
    """The same message without the path and the line of a file that only stands for the study."""
    lines = []
    for line in text.splitlines():
        head, _, rest = line.partition(f"{path}")
        if not rest or head:
            lines.append(line)
            continue
        number, _, told = rest.partition(" ")
        lines.append(told if number.rstrip(":").lstrip(":").isdigit() or number == ":" else f"the study{rest}")
    return "\n".join(lines)


def reference_of(thing: Any, group: str) -> Any:
    """Name by which a study file knows a simulator or an effect."""
    if isinstance(thing, str | Mapping):
        return thing
    known = [name for name in plugins.names(group) if plugins.load(group, name) is thing]
    if known:
        return known[0]
    if isinstance(thing, type):
        return f"{thing.__module__}:{thing.__qualname__}"
    for name, module in list(sys.modules.items()):
        found = [key for key, value in vars(module).items() if value is thing] if module is not None else []
        if found and not name.startswith("calib."):
            return f"{name}:{found[0]}"
    raise CalibError(
        f"expected a name, 'package.module:Thing' or a thing at module level for {group}, got {type(thing).__name__}"
    )


def window_of(parameter: str, window: Any) -> dict[str, Any]:
    """Table of a window that is given as (low, high), (low, high, scale) or a mapping."""
    if isinstance(window, Mapping):
        return dict(window)
    if not isinstance(window, Sequence) or isinstance(window, str) or len(window) not in (2, 3):
        raise CalibError(f"windows.{parameter}: expected (low, high) or (low, high, 'log'), got {window!r}")
    return dict(zip(("low", "high", "scale"), window, strict=False))


def named(thing: str | Mapping[str, Any], key: str) -> dict[str, Any]:
    """Table of a thing that is given by its name or with its options."""
    return {key: thing} if isinstance(thing, str) else dict(thing)


def usual_terms(records: Sequence[Record]) -> list[str]:
    """Features by which such records are compared where nothing else is said."""
    periodic = all("frequency" in record.dataset.attrs for record in records)
    curves = all({"displacement", "velocity"} <= set(record.dataset.data_vars) for record in records)
    return ["phase_curve"] if periodic and curves else ["time_history"]
