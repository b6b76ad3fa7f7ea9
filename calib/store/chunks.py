"""Work done in pieces: each piece's arrays in a file of its own, whole or absent."""

import hashlib
import json
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from calib.errors import CalibError
from calib.files import read_dataset, whole, write_dataset
from calib.interrupt import uninterrupted
from calib.pool import Failure
from calib.store.lock import Lock

DEFINITION = "definition"  # attribute of the joined file
DIGITS = 12  # of the definition's digest in the folder's name


def read_joined(path: str | Path) -> xr.Dataset:
    """Read what `write_joined` has written.

    Raises
    ------
    CalibError : no such file, or another one
    """
    found = read_dataset(path)
    if DEFINITION not in found.attrs:
        raise CalibError(f"{path}: not a file of `calib sweep` or `calib basins`; choose another name")
    texts = {name: variable.astype(str) for name, variable in found.variables.items() if variable.dtype == object}
    coords = {name: text for name, text in texts.items() if name in found.coords}
    return found.assign({name: text for name, text in texts.items() if name not in coords}).assign_coords(coords)


def write_joined(dataset: xr.Dataset, definition: Mapping[str, Any], path: Path) -> None:
    """Write the joined pieces, so that the file is either whole or absent."""
    write_dataset(dataset.assign_attrs({DEFINITION: json.dumps(definition)}), path)


def joined(path: Path, definition: Mapping[str, Any]) -> xr.Dataset | None:
    """Return what `path` holds where it is of this very definition; None where there is no file.

    Raises
    ------
    CalibError : it holds something else
    """
    if not path.exists():
        return None
    found = read_joined(path)
    stored = json.loads(found.attrs[DEFINITION])
    different = sorted(k for k in definition if k != "environment" and stored.get(k) != definition[k])
    if different:
        raise CalibError(
            f"{path} holds something else (it differs in {', '.join(different)}); give another file, or --fresh "
            "to replace it"
        )
    return found


class Chunks:
    """Pieces of one piece of work in a folder named after its definition, so that no other work takes them for its own.

    Parameters
    ----------
    beside : the file that the pieces are joined to in the end; the folder lies beside it
    definition : all that decides what the pieces hold, as JSON takes it
    """

    def __init__(self, beside: Path, definition: Mapping[str, Any]):
        text = json.dumps(definition, sort_keys=True)
        self.folder = beside.parent / f".{beside.stem}-{hashlib.sha256(text.encode()).hexdigest()[:DIGITS]}"
        self.folder.mkdir(parents=True, exist_ok=True)
        self._lock = Lock(self.folder)

    def __enter__(self) -> "Chunks":
        self._lock.acquire()
        return self

    def __exit__(self, *_):
        done = not any(self.folder.glob("*.npz"))
        self._lock.release()
        if done:
            shutil.rmtree(self.folder, ignore_errors=True)

    def read(self, key: str) -> dict[str, np.ndarray] | None:
        """Arrays of a piece by name, or None where it has not been done."""
        path = self.folder / f"{key}.npz"
        if not path.is_file():
            return None
        with np.load(path) as file:
            return {name: file[name] for name in file.files}

    def write(self, key: str, arrays: Mapping[str, np.ndarray]) -> None:
        """Keep a piece; when this returns, it outlives a power failure."""
        with uninterrupted(), whole(self.folder / f"{key}.npz") as temporary, open(temporary, "wb") as file:
            np.savez(file, **arrays)

    def done(self, pool, tasks: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
        """Yield the arrays of each task by its key: those that are there, then those that `pool` makes, as they end.

        A call that gave no arrays yields its Failure, and leaves nothing.
        """
        missing = {}
        for key, task in tasks.items():
            arrays = self.read(key)
            if arrays is None:
                missing[key] = task
            else:
                yield key, arrays
        keys = list(missing)
        for index, result in pool.map(missing.values()):
            if not isinstance(result, Failure):
                self.write(keys[index], result)
            yield keys[index], result

    def clear(self) -> None:
        """Forget all pieces."""
        for path in self.folder.glob("*.npz"):
            path.unlink()
