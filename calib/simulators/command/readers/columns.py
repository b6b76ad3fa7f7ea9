"""What a reader returns: columns of numbers over time, as they stand in the file."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from calib.errors import CalibError


@dataclass(frozen=True)
class Columns:
    """Columns of an output file, in its own units; NaN and infinities are passed on.

    Attributes
    ----------
    time : (n,), n at least 1
    values : name -> (n,)

    Raises
    ------
    CalibError : anything but real numbers, or of another shape
    """

    time: np.ndarray
    values: Mapping[str, np.ndarray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Take what is given as 64-bit floats."""
        time = _numbers("time", self.time)
        if time.size == 0:
            raise CalibError("time: expected at least one sample, got none")
        if not isinstance(self.values, Mapping) or not all(isinstance(name, str) for name in self.values):
            raise CalibError(f"expected columns by name, {{text: array}}, got {type(self.values).__name__}")
        values = {name: _numbers(f"column {name!r}", column) for name, column in self.values.items()}
        for name, column in values.items():
            if column.size != time.size:
                raise CalibError(f"column {name!r}: expected {time.size} samples as of time, got {column.size}")
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "values", values)


def _numbers(what: str, given: Any) -> np.ndarray:
    """Return one column (n,) of 64-bit floats."""
    try:
        column = np.asarray(given)
    except ValueError as error:
        raise CalibError(f"{what}: expected a row of real numbers, got {type(given).__name__} ({error})") from error
    if column.ndim != 1 or column.dtype.kind not in "fiub":
        raise CalibError(f"{what}: expected real numbers of shape (n,), got {column.dtype} of shape {column.shape}")
    with np.errstate(invalid="ignore"):  # of NaN that signal
        return column.astype(float, copy=False)
