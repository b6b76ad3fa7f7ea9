"""The document of a study file: its tables from the arguments of `calib.Study`."""

import inspect
import os
import sys
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from calib import plugins
from calib.errors import CalibError
from calib.execution.pools.local import MAX_JOBS
from calib.modelling.effect import Effect
from calib.study_file.lines import dotted
from calib.workflows.record import Record

MAIN = "__main__"  # module of a script or a notebook: no other process can import it
MEASURED = "measured"  # folder beside a study file in which records from Python lie


def local_jobs(jobs: int | None, pool: Mapping[str, Any] | None) -> int:
    """Child processes of this machine: as many as `jobs` or the table `pool` says, else one for each core."""
    stated = pool.get("jobs") if pool is not None and pool.get("kind", "local") == "local" else None
    cores = min(os.cpu_count() or 1, MAX_JOBS)
    return next((number for number in (jobs, stated) if number is not None), cores)


def record_file(name: str) -> str:
    """File of a record from Python, relative to its study file."""
    return f"{MEASURED}/{quote(name, safe='')}.nc"


def reference_of(component: Any, group: str) -> Any:
    """Name by which a study file knows a simulator or an effect.

    Raises
    ------
    CalibError : a component that is defined at the top level of no module
    """
    if isinstance(component, str | Mapping):
        return component
    module = getattr(component, "__module__", "") if isinstance(component, type) else ""
    if module.startswith("calib.") or isinstance(component, Effect):
        with warnings.catch_warnings(action="ignore"):  # one that does not load is not this one
            known = [name for name, other in plugins.load_all(group).items() if other is component]
        if known:
            return known[0]
    if callable(getattr(component, "run", None)) and not isinstance(component, type):
        thing = type(component).__name__
        raise CalibError(
            f"simulator: got an instance of {thing}; pass the class, {thing}, and its arguments as options"
        )
    if isinstance(component, type) and "<locals>" not in component.__qualname__:
        return f"{module}:{component.__qualname__}"
    if isinstance(component, Effect):
        first = [getattr(component.law, "module", "")]
        for name in [*first, *(name for name in list(sys.modules) if name != MAIN), MAIN]:
            content: dict[str, Any] = getattr(sys.modules.get(name), "__dict__", {})
            keys = [key for key, value in list(content.items()) if value is component and not key.startswith("_")]
            if keys:
                return f"{name}:{keys[0]}"
    raise CalibError(
        f"expected a name, 'package.module:Thing', or what stands at the top of a module, for {group}; "
        f"got {component!r:.60}"
    )


def window_table(parameter: str, window: Any) -> dict[str, Any]:
    """Table of a window that is given as (low, high), (low, high, scale) or a mapping."""
    if isinstance(window, Mapping):
        return dict(window)
    if isinstance(window, np.ndarray):
        window = window.tolist()
    if not isinstance(window, Sequence) or isinstance(window, str) or len(window) not in (2, 3):
        raise CalibError(f"windows.{parameter}: expected (low, high) or (low, high, 'log'), got {window!r}")
    return dict(zip(("low", "high", "scale"), window, strict=False))


def table_of(stated: str | Mapping[str, Any], key: str) -> dict[str, Any]:
    """Table of a component that is stated by its name or with its options."""
    if isinstance(stated, str):
        return {key: stated}
    if not isinstance(stated, Mapping):
        raise CalibError(f"expected the name of a {key}, or a mapping with its options, got {type(stated).__name__}")
    return dict(stated)


def default_terms(records: Sequence[Record]) -> list[str]:
    """Features by which records are compared by default: phase curves where all have them, else time histories."""
    periodic = all("frequency" in record.dataset.attrs for record in records)
    curves = all({"displacement", "velocity"} <= set(record.dataset.data_vars) for record in records)
    return ["phase_curve"] if periodic and curves else ["time_history"]


def for_toml(value: Any, *key: str | int) -> Any:
    """Return the same as TOML has it: numbers of numpy's as numbers, paths as texts; without keys whose value is None.

    Raises
    ------
    CalibError : a value that TOML cannot hold, with its key
    """
    if isinstance(value, Mapping):
        return {str(name): for_toml(one, *key, str(name)) for name, one in value.items() if one is not None}
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, np.ndarray | np.generic):
        return for_toml(value.tolist(), *key)
    if isinstance(value, list | tuple):
        return [for_toml(one, *key, index) for index, one in enumerate(value)]
    if isinstance(value, str | bool | int | float):
        return value
    raise CalibError(f"{dotted(key)}: expected a number, a text or a list of them, got {value!r:.60}")


def references_in(document: Mapping[str, Any]) -> list[str]:
    """References "package.module:Thing" of a document."""
    model = document["model"]
    entries = [model["simulator"], *model.get("effects", ()), *document.get("diagnosis", {}).get("candidates", ())]
    entries += [*(term["feature"] for term in document["term"]), document.get("optimiser", {}).get("name", "")]
    names = [entry["name"] if isinstance(entry, Mapping) else entry for entry in entries]
    return [name for name in names if ":" in name]


def with_folder(options: dict[str, Any], simulator: str | type, folder: Path) -> dict[str, Any]:
    """Return the options of a simulator whose option `folder` is absolute, if it has one.

    The study file of a study in Python lies in a temporary folder, to which no path is relative.
    """
    with suppress(CalibError):  # which the check of the study reports
        maker = plugins.load("calib.simulators", simulator) if isinstance(simulator, str) else simulator
        if hasattr(maker, "placed") and "folder" in inspect.signature(maker).parameters:
            return {**options, "folder": str((folder / str(options.get("folder", ""))).absolute())}
    return options
