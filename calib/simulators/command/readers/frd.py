"""Nodal results of CalculiX as they follow one another in an .frd file.

The format is described in the manual of CalculiX GraphiX, sections "Nodal Point Coordinate Block", "Element Definition
Block" and "Nodal Results Block"; ASCII and binary blocks may follow one another.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from calib.errors import CalibError
from calib.simulators.command.readers.lines import MAX_TEXT_BYTES, check_size
from calib.simulators.command.readers.number import number

MAX_RECORD_BYTES = 1024  # bytes of a line of text; the longest of results has less than 100
MAX_TITLE_CHARACTERS = 40  # characters of a line in a message
NUMBER_WIDTH = 12  # characters of a number
NUMBERS_PER_LINE = 6  # at most
COMPUTED = "1"  # existence indicator of a component that GraphiX computes: no number of it stands in the file
NODE_WIDTHS = {0: 5, 1: 10}  # characters of a node number in the short and the long text format
FLOATS = {2: np.dtype("<f4"), 3: np.dtype("<f8")}  # of the binary formats
ELEMENT_NODES = {1: 8, 2: 6, 3: 4, 4: 20, 5: 15, 6: 10, 7: 3, 8: 6, 9: 4, 10: 8, 11: 2, 12: 3}  # by type of element
INTEGER = np.dtype("<i4")
ELEMENT_HEAD = 4  # integers of a binary element before its nodes: number, type, group, material

Wanted = Callable[[str, str], bool]  # dataset and component


@dataclass(frozen=True)
class NodalResults:
    """One dataset at one time: `rows` of numbers, one for each of `nodes` and a column for each of `components`.

    Attributes
    ----------
    name : of the dataset, such as "DISP"
    line : of its header; binary blocks count as no line
    """

    name: str
    time: float
    line: int
    components: Sequence[str]
    nodes: Sequence[int]
    rows: Sequence[Sequence[float]]


@dataclass
class _Source:
    """A file read forwards, in lines of text and runs of bytes."""

    path: Path
    file: BinaryIO
    size: int
    line: int = 0

    def text(self) -> str | None:
        """Return the next line without its end; None at the end of the file."""
        content = self.file.readline(MAX_RECORD_BYTES)
        if not content:
            return None
        self.line += 1
        if not content.endswith(b"\n"):
            raise self.refusal("a line with an end", "one that is cut off or no text; did the program stop?")
        return content.decode("latin-1").rstrip("\r\n")

    def following(self, expected: str) -> str:
        text = self.text()
        if text is None:
            raise self.refusal(expected, "the end of the file; did the program stop?")
        return text

    def numbers(self, kind: np.dtype, count: int) -> np.ndarray:
        """Return the next `count` binary numbers, or records of them."""
        left = self.size - self.file.tell()
        if count * kind.itemsize > left:
            raise self.refusal(f"{count * kind.itemsize} bytes of numbers", f"{left}; did the program stop?")
        return np.frombuffer(self.file.read(count * kind.itemsize), kind)

    def whole_number(self, text: str, what: str) -> int:
        if not (text.strip().isascii() and text.strip().isdigit()):
            raise self.refusal(what, repr(text))
        return int(text)

    def refusal(self, expected: str, got: str) -> CalibError:
        return CalibError(f"{self.path}, line {self.line}: expected {expected}, got {got}")


def nodal_results(path: Path, wanted_node: Callable[[int], bool], wanted: Wanted) -> Iterator[NodalResults]:
    """Yield the nodal results in the order of the file, those of wanted components and nodes only.

    Raises
    ------
    CalibError : a file that is cut off or not of this format, too large a file
    """
    check_size(path, MAX_TEXT_BYTES)
    with open(path, "rb") as file:
        source = _Source(path, file, path.stat().st_size)
        while (text := source.text()) is not None:
            key = text[:6].strip()
            if key in ("2C", "3C"):
                _skip_mesh(source, text, elements=key == "3C")
            elif key == "100C":
                yield _results(source, text, wanted_node, wanted)


def _format(source: _Source, header: str) -> int:
    """Return the format indicator of a block: 0 and 1 are text, 2 and 3 binary."""
    indicator = source.whole_number(header[73:75], "a format indicator in columns 74 and 75 of the header")
    if indicator not in NODE_WIDTHS and indicator not in FLOATS:
        raise source.refusal("a format indicator from 0 to 3", f"{indicator}")
    return indicator


def _skip_mesh(source: _Source, header: str, elements: bool) -> None:
    """Pass over binary coordinates or elements; those in text are lines that nobody looks at."""
    indicator = _format(source, header)
    if indicator not in FLOATS:
        return
    count = source.whole_number(header[24:36], "a number of nodes or elements in columns 25 to 36 of the header")
    if not elements:
        source.numbers(np.dtype([("node", INTEGER), ("place", FLOATS[indicator], (3,))]), count)
        return
    for _ in range(count):
        kind = int(source.numbers(INTEGER, ELEMENT_HEAD)[1])
        if kind not in ELEMENT_NODES:
            raise source.refusal("a type of element from 1 to 12", f"{kind}")
        source.numbers(INTEGER, ELEMENT_NODES[kind])


def _results(source: _Source, header: str, wanted_node: Callable[[int], bool], wanted: Wanted) -> NodalResults:
    """Read a block of results whose header has been read."""
    line = source.line
    indicator = _format(source, header)
    time = number(header[12:24], source.path, line, "time")
    count = source.whole_number(header[24:36], "a number of nodes in columns 25 to 36 of the header")
    title = source.following("a dataset, key -4")
    if title[:3] != " -4":
        raise source.refusal("a dataset, key -4", repr(title[:MAX_TITLE_CHARACTERS]))
    name = title[5:13].strip()
    components = []
    for _ in range(source.whole_number(title[13:18], "a number of components in columns 14 to 18")):
        entity = source.following("a component, key -5")
        if entity[:3] != " -5":
            raise source.refusal("a component, key -5", repr(entity[:MAX_TITLE_CHARACTERS]))
        if entity[33:38].strip() != COMPUTED:
            components.append(entity[5:13].strip())
    chosen = [i for i, component in enumerate(components) if wanted(name, component)]
    if indicator in FLOATS:
        record = np.dtype([("node", INTEGER), ("values", FLOATS[indicator], (len(components),))])
        table = source.numbers(record, count)
        kept = np.array([wanted_node(node) for node in table["node"].tolist()], dtype=bool)
        nodes, rows = table["node"][kept].tolist(), table["values"][kept][:, chosen].tolist()
    else:
        nodes, rows = _text_rows(source, NODE_WIDTHS[indicator], len(components), chosen, wanted_node)
    return NodalResults(name, time, line, [components[i] for i in chosen], nodes, rows)


def _text_rows(
    source: _Source, width: int, size: int, chosen: Sequence[int], wanted_node: Callable[[int], bool]
) -> tuple[list[int], list[list[float]]]:
    """Return nodes and numbers of a block in text, `size` numbers for each node, of which some are `chosen`."""
    nodes, rows = [], []
    begin = 3 + width
    continued = (size - 1) // NUMBERS_PER_LINE
    while (text := source.following("rows of results up to the key -3"))[:3] != " -3":
        if text[:3] != " -1":
            raise source.refusal("a row of results, key -1", repr(text[:MAX_TITLE_CHARACTERS]))
        node = source.whole_number(text[3:begin], "a number of a node")
        fields = text[begin:]
        for _ in range(continued):
            more = source.following("further numbers of the node, key -2")
            if more[:3] != " -2":
                raise source.refusal("further numbers of the node, key -2", repr(more[:MAX_TITLE_CHARACTERS]))
            fields = fields.ljust(NUMBERS_PER_LINE * NUMBER_WIDTH) + more[begin:]
        if wanted_node(node):
            cells = (fields[i * NUMBER_WIDTH : (i + 1) * NUMBER_WIDTH] for i in chosen)
            rows.append([number(cell, source.path, source.line, str(node)) for cell in cells])
            nodes.append(node)
    return nodes, rows
