"""Histories of single quantities that a file holds block by block become columns of one time."""

import math
from array import array
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from calib.errors import CalibError, nearest
from calib.simulators.command.readers.columns import Columns
from calib.simulators.command.readers.lines import REMEDY
from calib.simulators.command.readers.rows import MAX_VALUES

Names = Annotated[Sequence[str], Field(min_length=1)]
MAX_SHOWN_NAMES = 20  # columns that a message names


@dataclass(frozen=True)
class History:
    """Instants and values of one quantity."""

    time: array = field(default_factory=lambda: array("d"))
    value: array = field(default_factory=lambda: array("d"))


@dataclass
class Histories:
    """Histories by name, which grow as a file is read."""

    path: Path
    histories: dict[str, History] = field(default_factory=dict)
    size: int = 0

    def add(self, name: str, time: float, value: float, line: int) -> None:
        """Append one value; the same once more, as where two requests print one quantity, is no other value.

        Raises
        ------
        CalibError : another value at the same time, or too many values
        """
        history = self.histories.setdefault(name, History())
        if history.time and history.time[-1] == time:
            if history.value[-1] == value or math.isnan(value):
                return
            raise CalibError(
                f"{self.path}, line {line}: {name} has two values at the time {time:g}, {history.value[-1]:g} and "
                f"{value:g}; time is written with few digits, so write fewer instants; eigenmodes are no motion"
            )
        history.time.append(time)
        history.value.append(value)
        self.size += 1
        if self.size > MAX_VALUES // 2:
            raise CalibError(f"{self.path}, line {line}: expected at most {MAX_VALUES // 2} values; {REMEDY}")

    def as_columns(self, names: Mapping[str, str]) -> Columns:
        """Return histories over their common time, by other names.

        Parameters
        ----------
        names : of a column -> of its history; at least one

        Raises
        ------
        CalibError : they are of different instants
        """
        first = next(iter(names))
        time = self.histories[names[first]].time
        for name, own in names.items():
            other = self.histories[own].time
            if other != time:
                raise CalibError(
                    f"{self.path}: expected one time of all columns, but {first} has {len(time)} instants and {name} "
                    f'{len(other)}, or others; write both at the same increments, or choose columns = ["{first}"]'
                )
        return Columns(np.array(time), {name: np.array(self.histories[own].value) for name, own in names.items()})


def refuse_missing(path: Path, columns: Iterable[str], known: Collection[str], expected: str) -> None:
    """Check that a file has the columns.

    Raises
    ------
    CalibError : it has none at all of what was expected, or one of them is not among the known names
    """
    if not known:
        raise CalibError(f"{path}: expected {expected}, got none; did the program stop before its first step?")
    for name in columns:
        if name not in known:
            raise CalibError(f"{path}: no column {name!r}{nearest(name, known)}; there are {listed(known)}")


def listed(names: Iterable[str]) -> str:
    """Return names for a message, the first of them where there are many."""
    names = list(names)
    rest = len(names) - MAX_SHOWN_NAMES
    return ", ".join(names[:MAX_SHOWN_NAMES]) + (f" and {rest} more" if rest > 0 else "")
