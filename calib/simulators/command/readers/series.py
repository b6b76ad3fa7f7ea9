"""Named arrays, one axis of which is time, become columns."""

import itertools
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.errors import CalibError, nearest
from calib.simulators.command.readers.columns import Columns
from calib.simulators.command.readers.histories import Names, listed

CLOCKS = ("time", "t")  # names of the array that is time, where none is stated
MAX_COLUMNS = 100_000  # columns that are read where none are chosen
REAL = "fiub"  # kinds of numbers


@dataclass(frozen=True)
class Series:
    """An array over time.

    Attributes
    ----------
    values : (n, ...)
    labels : of the places on each further axis; of none where they are counted from 1
    """

    values: np.ndarray
    labels: Sequence[Sequence[str] | None]

    def columns(self, name: str) -> Iterator[tuple[str, np.ndarray]]:
        """Yield name and values (n,) of each column: "x", or "x[3]", "x[3,1]" of an array with further axes."""
        for place in np.ndindex(self.values.shape[1:]):
            yield (f"{name}[{self._label(place)}]" if place else name), self.values[:, *place]

    def find(self, label: str) -> np.ndarray | None:
        """Return the column (n,) of a label "3" or "3,1"; None where there is none."""
        parts = label.split(",")
        if len(parts) != len(self.labels):
            return None
        place = [self._place(axis, part.strip()) for axis, part in enumerate(parts)]
        return None if None in place else self.values[:, *place]

    @property
    def size(self) -> int:
        """Number of columns."""
        return math.prod(self.values.shape[1:])

    def example(self) -> str:
        """Label of the last column."""
        return self._label(tuple(length - 1 for length in self.values.shape[1:]))

    def _label(self, place: Sequence[int]) -> str:
        stated = zip(place, self.labels, strict=True)
        return ",".join(str(i + 1) if labels is None else labels[i] for i, labels in stated)

    def _place(self, axis: int, label: str) -> int | None:
        labels = self.labels[axis]
        if labels is not None:
            return labels.index(label) if label in labels else None
        whole = label.isascii() and label.isdigit() and len(label) < 10
        return int(label) - 1 if whole and 1 <= int(label) <= self.values.shape[axis + 1] else None


def clock(path: Path, names: Collection[str], time: str | None) -> str:
    """Return the name of the array that is time.

    Raises
    ------
    CalibError : there is none of the stated name, or no array of a usual name
    """
    if time is not None and time in names:
        return time
    if time is None:
        usual = next((name for name in CLOCKS if name in names), None)
        if usual is not None:
            return usual
    sought = f"{time!r}{nearest(time, names)}" if time else " or ".join(map(repr, CLOCKS))
    raise CalibError(f"{path}: no array {sought} that is time; state time, or step; the arrays are {listed(names)}")


def over_time(array: np.ndarray, samples: int | None) -> Series | None:
    """Return an array as a series: its first axis with as many `samples`, or its first; None where none has.

    A matrix of one row or one column is a vector.
    """
    if array.dtype.kind not in REAL or array.ndim == 0:
        return None
    if array.ndim == 2 and 1 in array.shape:
        array = array.ravel()
    axis = 0 if samples is None else next((i for i, length in enumerate(array.shape) if length == samples), None)
    return None if axis is None else Series(np.moveaxis(array, axis, 0), (None,) * (array.ndim - 1))


def columns_of(path: Path, time: np.ndarray, series: Mapping[str, Series], columns: Names | None) -> Columns:
    """Return columns of the series by name, or all.

    Raises
    ------
    CalibError : there are none, one is not among them, or they are too many
    """
    if not series:
        raise CalibError(f"{path}: expected arrays with the {time.size} samples of time, got none")
    if columns is not None:
        return Columns(time, {column: _found(path, column, series) for column in columns})
    if sum(one.size for one in series.values()) > MAX_COLUMNS:
        raise CalibError(f"{path}: expected at most {MAX_COLUMNS} columns; choose some by columns = [...]")
    return Columns(time, dict(itertools.chain.from_iterable(one.columns(name) for name, one in series.items())))


def columns_of_arrays(
    path: Path, arrays: Mapping[str, np.ndarray], time: str | None, step: float | None, columns: Names | None
) -> Columns:
    """Return columns of arrays one of which is time, or which have `step` between their samples.

    Raises
    ------
    CalibError : no array that is time, or no array with as many samples
    """
    if time is not None and step is not None:
        raise CalibError(f"{path}: a reader needs either the array that is time or the step between samples; drop one")
    own = None if step is not None else clock(path, arrays, time)
    is_chosen = chosen(path, columns, arrays)
    others = {name: array for name, array in arrays.items() if name != own}
    if own is not None and max(arrays[own].shape, default=0) != arrays[own].size:
        raise CalibError(f"{path}: {own}: expected a vector as time, got an array of shape {arrays[own].shape}")
    samples = None if own is None else arrays[own].size
    found = {name: over_time(array, samples) for name, array in others.items() if is_chosen(name)}
    series = {name: one for name, one in found.items() if one is not None}
    if own is not None:
        return columns_of(path, arrays[own].ravel(), series, columns)
    lengths = {name: len(one.values) for name, one in series.items()}
    if len(set(lengths.values())) > 1:
        raise CalibError(f"{path}: expected arrays of one number of samples, got {lengths}; choose some by columns")
    return columns_of(path, np.arange(next(iter(lengths.values()), 0)) * (step or 0.0), series, columns)


def array_name(column: str, names: Collection[str]) -> str:
    """Return the array to which a column belongs: "x" of "x[3]"."""
    return column if column in names or not column.endswith("]") else column.rpartition("[")[0]


def chosen(path: Path, columns: Names | None, names: Collection[str]) -> Callable[[str], bool]:
    """Return whether an array holds one of the columns, or any where all are read.

    Raises
    ------
    CalibError : a column of an array that is not among the names
    """
    if columns is None:
        return lambda name: True
    wanted = {array_name(column, names) for column in columns}
    for name in wanted:
        if name not in names:
            raise CalibError(f"{path}: no array {name!r}{nearest(name, names)}; there are {listed(names)}")
    return lambda name: name in wanted


def _found(path: Path, column: str, series: Mapping[str, Series]) -> np.ndarray:
    name = array_name(column, series)
    one = series.get(name)
    if one is None:
        raise CalibError(f"{path}: no array {name!r} over time{nearest(name, series)}; there are {listed(series)}")
    values = one.values if column == name and not one.labels else one.find(column[len(name) + 1 : -1])
    if values is None:
        kind = f"columns up to {name}[{one.example()}]" if one.labels else "one column"
        raise CalibError(f"{path}: no column {column!r}; the array {name!r} has {kind}")
    return values
