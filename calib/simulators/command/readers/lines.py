"""The lines of an output file, of bounded length and number of bytes."""

from collections.abc import Iterator
from pathlib import Path

from calib.errors import CalibError
from calib.records.delimited import text_codec

MAX_TEXT_BYTES = 2**28  # bytes, 256 MiB: half a minute of reading
MAX_LINE_CHARACTERS = 2**20  # characters: 60 000 columns of 16
REMEDY = "have the program write fewer points or fewer steps"


def text_lines(path: Path, encoding: str = "utf-8", ended: bool = False) -> Iterator[str]:
    """Yield the lines of a text file without their ends.

    ended : whether the last line must have an end too, without which it may be cut off

    Raises
    ------
    CalibError : too large a file, too long a line, another encoding, or a last line that is cut off
    """
    check_size(path, MAX_TEXT_BYTES)
    codec = text_codec(path, encoding)
    number = 0
    try:
        with open(path, encoding=codec) as file:
            while line := file.readline(MAX_LINE_CHARACTERS):
                number += 1
                if len(line) == MAX_LINE_CHARACTERS:
                    raise CalibError(
                        f"{path}, line {number}: expected at most {MAX_LINE_CHARACTERS} characters; not a text file?"
                    )
                if ended and not line.endswith("\n"):
                    raise CalibError(f"{path}, line {number}: the file is cut off in this line; did the program stop?")
                yield line.rstrip("\n")
    except UnicodeError as error:
        raise CalibError(
            f"{path}, after line {number}: not a text in {encoding} ({error}); state its encoding"
        ) from error


def check_size(path: Path, most: int) -> None:
    """Refuse a file of more than `most` bytes."""
    size = path.stat().st_size
    if size > most:
        raise CalibError(f"{path}: expected at most {most / 2**20:g} MiB, got {size / 2**20:.4g} MiB; {REMEDY}")
