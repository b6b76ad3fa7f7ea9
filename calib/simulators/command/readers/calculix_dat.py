"""The reader of the printed results of CalculiX, a .dat file."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from calib.errors import CalibError
from calib.simulators.command.readers.columns import Columns
from calib.simulators.command.readers.histories import Histories, Names, refuse_missing
from calib.simulators.command.readers.lines import text_lines
from calib.simulators.command.readers.number import number

HEADING = re.compile(r"\s*(\S.*?)\s*(?:\(([^)]*)\)\s*)?for set\s*(\S*) and time\s*(\S*)\s*")
TENSOR = ("XX", "YY", "ZZ", "XY", "XZ", "YZ")


@dataclass(frozen=True)
class Quantity:
    """What a block of a .dat file holds.

    Attributes
    ----------
    components : names of the columns of numbers; those of `vector` have as many as there are
    places : numbers before them in a row: of the node; of the element; of the element and its integration point
    """

    components: tuple[str, ...]
    places: int
    vector: bool = False


QUANTITIES = {
    "displacements": Quantity(("U",), 1, vector=True),
    "velocities": Quantity(("V",), 1, vector=True),
    "forces": Quantity(("RF",), 1, vector=True),
    "total force": Quantity(("RF",), 0, vector=True),
    "temperatures": Quantity(("NT",), 1),
    "stresses": Quantity(tuple(f"S{component}" for component in TENSOR), 2),
    "strains": Quantity(tuple(f"E{component}" for component in TENSOR), 2),
    "mechanical strains": Quantity(tuple(f"ME{component}" for component in TENSOR), 2),
    "equivalent plastic strain": Quantity(("PEEQ",), 2),
    "internal energy density": Quantity(("ENER",), 2),
    "internal energy": Quantity(("ELSE",), 1),
    "total internal energy": Quantity(("ELSE",), 0),
    "kinetic energy": Quantity(("ELKE",), 1),
    "total kinetic energy": Quantity(("ELKE",), 0),
    "volume": Quantity(("EVOL",), 1),
    "total volume": Quantity(("EVOL",), 0),
}


@dataclass
class _Block:
    """A block that is being read: heading and rows (line, place, numbers as text)."""

    quantity: Quantity
    group: str
    time: float
    line: int
    rows: list[tuple[int, tuple[str, ...], list[str]]]


@dataclass(frozen=True)
class _Printed:
    """What has been read: histories of the columns that are asked for (None: all), and the names of all columns."""

    histories: Histories
    columns: frozenset[str] | None
    names: dict[str, None] = field(default_factory=dict)


def read(path: Path, /, *, columns: Names | None = None) -> Columns:
    """Printed results of CalculiX (.dat): ``*NODE PRINT`` and ``*EL PRINT``, at the times in their headings.

    A column is called by the set, in capitals, and the component: ``"NTIP.U3"`` where the set has one node, else with
    the number of the node ``"NALL:17.U3"``, of the element ``"EALL:4.ELSE"``, or of the element and its integration
    point ``"EALL:4:1.SXX"``. Displacements are U1, U2, U3, velocities V1.., forces RF1.. (with totals ``"NFIX.RF3"``),
    temperatures NT, stresses SXX.., strains EXX.., energies ENER, ELSE, ELKE, volumes EVOL. Other results are left out.

    Parameters
    ----------
    columns : names of those that are read; without it all, which must then be printed at the same increments

    Raises
    ------
    CalibError : no results, a file that is cut off, two values at one time (it is written with 7 digits), too large a
        file
    """
    printed = _Printed(Histories(path), None if columns is None else frozenset(columns))
    block: _Block | None = None
    for line, text in enumerate(text_lines(path, ended=True), 1):
        words = text.split()
        if not words:
            continue
        if not _begins_with_number(words[0]):
            _close(path, block, printed)
            block = _opened(path, line, text)
        elif block is not None:
            block.rows.append(_row(path, line, words, block.quantity))
    _close(path, block, printed)
    refuse_missing(path, columns or (), printed.names, "results of *NODE PRINT or *EL PRINT")
    return printed.histories.as_columns({name: name for name in columns or printed.names})


def _opened(path: Path, line: int, text: str) -> _Block | None:
    """Return the block that a heading opens; None for another text."""
    match = HEADING.fullmatch(text)
    if match is None or match[1] not in QUANTITIES:
        return None
    return _Block(QUANTITIES[match[1]], match[3], number(match[4], path, line, "time"), line, [])


def _row(path: Path, line: int, words: list[str], quantity: Quantity) -> tuple[int, tuple[str, ...], list[str]]:
    place, numbers = tuple(words[: quantity.places]), words[quantity.places :]
    least = 1 if quantity.vector else len(quantity.components)
    if len(numbers) < least or not all(word.isascii() and word.isdigit() for word in place):
        raise CalibError(
            f"{path}, line {line}: expected {quantity.places} whole numbers, then {least} or more numbers, "
            f"got {' '.join(words)[:80]!r}"
        )
    return line, place, numbers


def _close(path: Path, block: _Block | None, printed: _Printed) -> None:
    """Append the rows of a block to the histories."""
    if block is None:
        return
    if not block.rows:
        raise CalibError(f"{path}, line {block.line}: expected rows below this heading, got none; is the file cut off?")
    for line, place, words in block.rows:
        components = _components(block.quantity, words)
        where = ":".join((block.group, *(place if len(block.rows) > 1 else ())))
        for component, word in zip(components, words, strict=False):  # behind them is a mark of local axes
            name = f"{where}.{component}"
            printed.names[name] = None
            if printed.columns is None or name in printed.columns:
                printed.histories.add(name, block.time, number(word, path, line, name), line)


def _components(quantity: Quantity, words: Sequence[str]) -> Sequence[str]:
    if not quantity.vector:
        return quantity.components
    size = sum(map(_begins_with_number, words))
    return [f"{quantity.components[0]}{i}" for i in range(1, size + 1)]


def _begins_with_number(word: str) -> bool:
    """Whether a word is meant as a number, be it one that overflowed."""
    return word.lstrip("+-.")[:1].isdigit() or word[0] == "*" or word.lstrip("+-").lower() in ("nan", "infinity", "inf")
