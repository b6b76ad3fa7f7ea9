"""The elements of a MATLAB v5 file, looked at before SciPy reads them.

SciPy takes type and class of an element as an index into memory, so that a damaged file ends the process. The format is
described in "MAT-File Format" by The MathWorks; elements are visited in the order in which SciPy reads them.
"""

import math
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass

MAX_EXPANDED_BYTES = 2**30  # bytes of all variables: 67 million samples of two channels
MAX_NESTING = 20  # cells and structures within one another
MAX_DIMENSIONS = 32  # of an array
CHUNK_BYTES = 2**20  # bytes that are expanded at once
HEADER_BYTES = 128  # bytes before the first element
ORDER_MARK = slice(126, 128)  # of the header
LITTLE_ENDIAN = b"IM"  # mark
MAJOR_VERSION_BIG, MAJOR_VERSION_LITTLE = 124, 125  # places in the header
VERSION_5 = 1  # major version of the files that are called version 5; 2 is 7.3
VERSION_4_BYTES = 4  # bytes at the beginning, of which one is 0 in a file of version 4
TAG_BYTES = 8  # type and number of bytes of an element
SMALL_BYTES = 4  # bytes at most of an element within its tag
INT8, INT32, UINT32, MATRIX, COMPRESSED = 1, 5, 6, 14, 15  # types of elements
NUMBERS = frozenset({1, 2, 3, 4, 5, 6, 7, 9, 12, 13})  # types
CHARACTERS = frozenset({1, 2, 3, 4, 5, 6, 16, 17, 18})  # types
CELL, STRUCTURE, CHARACTER = 1, 2, 4  # classes of arrays
NUMERIC = range(6, 16)  # classes
COMPLEX_FLAG = 0x800  # of an array


class DamagedElementError(ValueError):
    """An element that cannot be read."""


def readable_variables(content: bytes) -> list[str] | None:
    """Return the names of the variables that SciPy can read: of numbers or text, or cells or structures of these.

    None where the file is of another version, which has no such elements.

    Raises
    ------
    IndexError : a file that is shorter than its header
    DamagedElementError : an element whose type or size cannot be, or more than `MAX_EXPANDED_BYTES` in all
    zlib.error : a compressed element that is damaged
    """
    order = "<" if content[ORDER_MARK] == LITTLE_ENDIAN else ">"
    major = content[MAJOR_VERSION_LITTLE if content[ORDER_MARK][:1] == LITTLE_ENDIAN[:1] else MAJOR_VERSION_BIG]
    if 0 in content[:VERSION_4_BYTES] or major != VERSION_5:
        return None
    names = []
    left = MAX_EXPANDED_BYTES
    begin = HEADER_BYTES
    while begin + TAG_BYTES <= len(content):
        kind, length = struct.unpack_from(f"{order}II", content, begin)
        end = begin + TAG_BYTES + length
        if end > len(content):
            raise DamagedElementError("an element ends behind the end of the file")
        element = content[begin:end] if kind != COMPRESSED else _expanded(content[begin + TAG_BYTES : end], left)
        left -= len(element)
        name = _Walk(element, order).variable()
        if name is not None:
            names.append(name)
        begin = end
    return names


def _expanded(content: bytes, most: int) -> bytes:
    expander = zlib.decompressobj()
    parts = []
    while content:
        parts.append(expander.decompress(content, CHUNK_BYTES))
        most -= len(parts[-1])
        if most < 0:
            raise DamagedElementError(f"expected at most {MAX_EXPANDED_BYTES / 2**30:g} GiB; keep fewer samples")
        content = expander.unconsumed_tail
    return b"".join(parts)


@dataclass
class _Walk:
    """A way through one variable, from element to element."""

    content: bytes
    order: str
    at: int = 0

    def variable(self) -> str | None:
        """Return the name of the variable; None where it is of another class."""
        kind, _ = self._full_tag()
        if kind != MATRIX:
            raise DamagedElementError(f"expected a variable, an element of type {MATRIX}, got type {kind}")
        flags, dimensions, name = self._head()
        return name if self._body(flags, dimensions, 0) else None

    def _head(self) -> tuple[int, list[int], str]:
        """Pass over flags, dimensions and name of an array."""
        self._full_tag()
        flags = struct.unpack(f"{self.order}I", self._take(TAG_BYTES)[:4])[0]
        dimensions = self._element({INT32, UINT32})
        count = len(dimensions) // 4
        if len(dimensions) % 4 or count > MAX_DIMENSIONS:
            raise DamagedElementError(f"expected up to {MAX_DIMENSIONS} dimensions, got {len(dimensions)} bytes")
        name = self._element({INT8}).decode("latin-1")
        return flags, list(struct.unpack(f"{self.order}{count}i", dimensions)), name

    def _body(self, flags: int, dimensions: list[int], nesting: int) -> bool:
        """Pass over the values of an array; False where it is of a class that is not read."""
        kind = flags & 0xFF
        if kind in NUMERIC:
            for _ in range(2 if flags & COMPLEX_FLAG else 1):
                self._element(NUMBERS)
        elif kind == CHARACTER:
            self._element(CHARACTERS)
        elif kind in (CELL, STRUCTURE) and nesting < MAX_NESTING:
            fields = self._fields() if kind == STRUCTURE else 1
            if min(dimensions, default=0) < 0 or math.prod(dimensions) * fields * TAG_BYTES > self._left():
                raise DamagedElementError(f"expected cells of a cell array of {dimensions}, got the end")
            return all(list(self._cells(math.prod(dimensions) * fields, nesting)))
        else:
            return False
        return True

    def _fields(self) -> int:
        """Pass over the names of the fields of a structure; return their number."""
        length = self._element({INT32})
        names = self._element({INT8})
        size = struct.unpack(f"{self.order}i", length)[0] if len(length) == 4 else 0
        if size <= 0 or len(names) % size:
            raise DamagedElementError(f"expected names of fields of {size} characters, got {len(names)} bytes")
        return len(names) // size

    def _cells(self, count: int, nesting: int) -> Iterator[bool]:
        for _ in range(count):
            kind, length = self._full_tag()
            if kind != MATRIX:
                raise DamagedElementError(f"expected a cell, an element of type {MATRIX}, got type {kind}")
            if length:
                flags, dimensions, _ = self._head()
                if not self._body(flags, dimensions, nesting + 1):
                    yield False
                    return  # where its values end is not known
            yield True

    def _full_tag(self) -> tuple[int, int]:
        kind, length = struct.unpack(f"{self.order}II", self._take(TAG_BYTES))
        return kind, length

    def _element(self, kinds: frozenset[int] | set[int]) -> bytes:
        """Return the content of an element of numbers or characters, which may stand within its tag."""
        tag = self._take(TAG_BYTES)
        kind, length = struct.unpack(f"{self.order}II", tag)
        small = kind >> 16
        if small:
            kind, content = kind & 0xFFFF, tag[4 : 4 + small]
            if small > SMALL_BYTES:
                raise DamagedElementError(f"expected at most {SMALL_BYTES} bytes within a tag, got {small}")
        else:
            content = self._take(length)
            self.at += -length % TAG_BYTES
        if kind not in kinds:
            raise DamagedElementError(f"expected an element of one of the types {sorted(kinds)}, got type {kind}")
        return content

    def _take(self, count: int) -> bytes:
        if count > self._left():
            raise DamagedElementError("expected a further element of a variable, got its end")
        self.at += count
        return self.content[self.at - count : self.at]

    def _left(self) -> int:
        return len(self.content) - self.at
