"""Residuals of trials in the side file of a ledger, read whenever they are asked for."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from calib.errors import CalibError

if TYPE_CHECKING:
    from calib.store.trial import Trial

BYTES_PER_RESIDUAL = 8  # float64


class SideFile:
    """The residuals of a ledger's trials, one after the other as float64; open until nobody refers to it."""

    def __init__(self, path: Path):
        self._path, self._file = path, os.open(path, os.O_RDONLY)

    def __del__(self) -> None:
        if hasattr(self, "_file"):
            os.close(self._file)

    def read(self, offset: int, length: int) -> np.ndarray:
        """Return `length` residuals from the one numbered `offset` on, read-only.

        Raises
        ------
        CalibError : they are no longer there
        """
        data = os.pread(self._file, BYTES_PER_RESIDUAL * length, BYTES_PER_RESIDUAL * offset)
        if len(data) < BYTES_PER_RESIDUAL * length:
            raise CalibError(f"{self._path} has become shorter while it was in use; run the study again")
        return np.frombuffer(data, dtype="<f8")


class StoredResiduals:
    """Where the residuals of a trial stand; they are pickled as themselves."""

    __slots__ = ("_file", "_length", "_offset")

    def __init__(self, file: SideFile, offset: int, length: int):
        self._file, self._offset, self._length = file, offset, length

    def read(self) -> np.ndarray:
        """Return them, (n,) float64."""
        return self._file.read(self._offset, self._length)

    def __reduce__(self) -> tuple[Any, ...]:
        return np.array, (self.read(),)


class ResidualsOfTrial:
    """Attribute of a trial: its residuals, in memory or read from the side file."""

    def __get__(self, trial: "Trial | None", kind: type["Trial"]) -> np.ndarray | None:
        stored = None if trial is None else getattr(trial, "_residuals", None)
        return stored.read() if isinstance(stored, StoredResiduals) else stored

    def __set__(self, trial: "Trial", residuals: "np.ndarray | StoredResiduals | ResidualsOfTrial | None") -> None:
        # a dataclass hands over the descriptor itself where no residuals are stated
        object.__setattr__(trial, "_residuals", None if residuals is self else residuals)
