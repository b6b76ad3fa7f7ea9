"""Check sum of a ledger's line: the CRC-32 of its text, stated as the last key of its JSON object."""

import zlib
from collections.abc import Mapping
from typing import Any

KEY = "crc32"  # its value is that of the line without this key and without the line end
_MARK = f',"{KEY}":'.encode()


def sealed(text: str) -> bytes:
    """Return the line of a JSON object, its check sum added, with the line end."""
    content = text.encode()
    return content[:-1] + _seal(content)


def is_intact(line: bytes, content: Mapping[str, Any]) -> bool:
    """Whether a line that reads as `content` has the check sum that it states; it has to state one."""
    head, _, _ = line.rpartition(_MARK)
    return KEY in content and line == head + _seal(head + b"}")


def _seal(content: bytes) -> bytes:
    return _MARK + b"%d}\n" % zlib.crc32(content)
