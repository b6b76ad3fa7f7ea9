"""Work done in pieces: the arrays of each piece in a file of its own."""

import hashlib
import json
import shutil
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from calib.errors import CalibError
from calib.execution.files import whole
from calib.execution.interrupt import uninterrupted
from calib.execution.netcdf import read_dataset, write_dataset
from calib.execution.pool import REFUSED, Failure, Pool
from calib.store.lock import Lock

DEFINITION = "definition"  # attribute of the joined file
ENVIRONMENT, OPTIONS = "environment", "options"  # keys of a definition: where it was made, options of the simulator
DIGEST_DIGITS = 12  # of the definition's digest, which is the folder's name


def read_joined(path: str | Path) -> xr.Dataset:
    """Read what `write_joined` has written.

    Raises
    ------
    CalibError : no such file, or another one
    """
    stored = read_dataset(path)
    if DEFINITION not in stored.attrs:
        raise CalibError(f"{path}: not a file of `calib sweep` or `calib basins`; choose another name")
    texts = {name: variable.astype(str) for name, variable in stored.variables.items() if variable.dtype == object}
    coords = {name: text for name, text in texts.items() if name in stored.coords}
    return stored.assign({name: text for name, text in texts.items() if name not in coords}).assign_coords(coords)


def write_joined(dataset: xr.Dataset, definition: Mapping[str, Any], path: Path) -> None:
    """Write the joined pieces, so that the file is either whole or absent."""
    write_dataset(dataset.assign_attrs({DEFINITION: json.dumps(definition)}), path)


def join(path: Path, definition: Mapping[str, Any], fresh: bool, make: Callable[["Chunks"], xr.Dataset]) -> xr.Dataset:
    """Compute the dataset for `path` from pieces, which are kept until it is written.

    Parameters
    ----------
    fresh : whether `path` and the pieces computed so far are deleted first
    make : the pieces -> the dataset that they join to

    Raises
    ------
    CalibError : another process works on the same file
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with Chunks(path, definition) as chunks:
        if fresh:
            path.unlink(missing_ok=True)
            chunks.clear()
        write_joined(make(chunks), definition, path)
        chunks.clear()
    return read_joined(path)


def joined(path: Path, definition: Mapping[str, Any], fresh: bool = False) -> xr.Dataset | None:
    """Return the dataset in `path` where it has this very definition; None where there is no file, or with `fresh`.

    Raises
    ------
    CalibError : the file has another definition, or is no joined dataset (with `fresh` too: it would be lost)
    """
    if not path.exists():
        return None
    dataset = read_joined(path)
    if fresh:
        return None
    stored = json.loads(dataset.attrs[DEFINITION])
    different = _changed(stored, definition)
    if different:
        raise CalibError(
            f"{path} holds something else (it differs in {', '.join(different)}); give another file, or --fresh "
            "to replace it"
        )
    if stored.get(ENVIRONMENT) != definition.get(ENVIRONMENT):
        warnings.warn(f"{path} was made with other library versions or on another processor; --fresh makes it anew",
                      stacklevel=2)  # fmt: skip
    return dataset


def _changed(stored: Mapping[str, Any], definition: Mapping[str, Any]) -> list[str]:
    """Keys of a definition that say something else than the stored one; the environment may differ.

    Of the options of the simulator those are compared that both state: another version may have others.
    """
    compared = {key: value for key, value in definition.items() if key not in (ENVIRONMENT, OPTIONS)}
    changed = [key for key, value in compared.items() if stored.get(key) != value]
    before, now = stored.get(OPTIONS, {}), definition.get(OPTIONS, {})
    changed += [f"{OPTIONS}.{name}" for name, value in now.items() if name in before and before[name] != value]
    return sorted(changed)


class Chunks:
    """Pieces of the work for one file, in a hidden folder beside it which one process at a time may use.

    In it the folder of the pieces is named after the definition of the work, so that no other work uses them.

    Parameters
    ----------
    beside : the file that the pieces are joined to in the end
    definition : all that determines the content of the pieces, as JSON takes it

    Raises
    ------
    CalibError : on entering, where another process works on the same file
    """

    def __init__(self, beside: Path, definition: Mapping[str, Any]):
        text = json.dumps(definition, sort_keys=True)
        self._hidden = beside.parent / f".{beside.name}-pieces"
        self.folder = self._hidden / hashlib.sha256(text.encode()).hexdigest()[:DIGEST_DIGITS]
        self._lock = Lock(self._hidden, beside)

    def __enter__(self) -> "Chunks":
        self._hidden.mkdir(parents=True, exist_ok=True)
        self._lock.acquire()
        self.folder.mkdir(parents=True, exist_ok=True)
        return self

    def __exit__(self, *_: object) -> None:
        if not any(self._hidden.rglob("*.npz")):
            shutil.rmtree(self._hidden, ignore_errors=True)
        self._lock.release()

    def read(self, key: str) -> dict[str, np.ndarray] | None:
        """Arrays of a piece by name, or None where it is not finished."""
        path = self.folder / f"{key}.npz"
        if not path.is_file():
            return None
        with np.load(path) as file:
            return {name: file[name] for name in file.files}

    def write(self, key: str, arrays: Mapping[str, np.ndarray]) -> None:
        """Write a piece; when this returns, it is on disk."""
        with uninterrupted(), whole(self.folder / f"{key}.npz") as temporary, open(temporary, "wb") as file:
            np.savez(file, **arrays)  # type: ignore[arg-type]  # no array of a piece is named as its option is

    def finished(self, keys: Iterable[str]) -> dict[str, dict[str, np.ndarray]]:
        """Return the finished pieces by key."""
        return {key: arrays for key in keys if (arrays := self.read(key)) is not None}

    def computed(
        self, pool: Pool, tasks: Mapping[str, Any], singly: Callable[[Any], dict[str, np.ndarray]]
    ) -> Iterator[tuple[str, dict[str, np.ndarray]]]:
        """Yield the key and the arrays of each task, computed by `pool`, as soon as they are written.

        Those of a task whose call failed are computed by `singly` after all others have ended.

        Raises
        ------
        CalibError : the call refuses a task
        """
        keys, failed = list(tasks), list[str]()
        for index, result in pool.map(tasks.values()):
            if isinstance(result, Failure):
                if result.status == REFUSED:
                    raise CalibError(result.reason)
                failed.append(keys[index])
                continue
            self.write(keys[index], result)
            yield keys[index], result
        for key in failed:
            arrays = singly(tasks[key])
            self.write(key, arrays)
            yield key, arrays

    def clear(self) -> None:
        """Delete all pieces for the file, whatever the work that they belong to."""
        for path in self._hidden.rglob("*.npz"):
            path.unlink()
