"""The bytes of a foreign file, within limits."""

import json
from pathlib import Path
from typing import Any

from calib.errors import CalibError

MAX_CONTENT_BYTES = 64 * 2**20  # bytes of a file or a member of an archive; a project with its image has a few millions


def content(path: Path) -> bytes:
    """Bytes of a file.

    Raises
    ------
    CalibError : no such file, or larger than `MAX_CONTENT_BYTES`
    """
    if not path.is_file():
        raise CalibError(f"{path}: no such file")
    size = path.stat().st_size
    if size > MAX_CONTENT_BYTES:
        raise CalibError(
            f"{path}: {size} bytes are more than the {MAX_CONTENT_BYTES} that are read; is it the right file?"
        )
    return path.read_bytes()


def text(path: Path, raw: bytes) -> str:
    """Text of a file in UTF-8, with or without the mark at its beginning.

    Raises
    ------
    CalibError : other bytes
    """
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise CalibError(f"{path}: not a text in UTF-8 (byte {error.start}); save it as UTF-8 text") from error


def parsed(path: Path, raw: bytes) -> Any:
    """Return what a JSON file holds.

    Raises
    ------
    CalibError : no JSON, or nested too deep
    """
    try:
        return json.loads(text(path, raw))
    except (ValueError, RecursionError) as error:
        raise CalibError(f"{path}: not a readable JSON file ({error}); save the project again") from error
