"""Files: checksums read, and every file written so that it is either whole or absent."""

import hashlib
import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from calib.errors import CalibError

PERMISSIONS = 0o666  # of a new file, less those that the umask takes away
TEMPORARY_NAME_DIGITS = 8  # hexadecimal, at random


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Yield a temporary file beside `path`; when the block ends without an exception, it is synced and renamed to it.

    So the file is either whole or absent, whenever the program or the machine stops. Its permissions follow the umask.

    Raises
    ------
    OSError : the folder is missing or cannot be written, or the disk is full; it names `path`
    """
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex[:TEMPORARY_NAME_DIGITS]}")
    try:
        os.close(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, PERMISSIONS))
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error
    try:
        yield temporary
        with open(temporary, "rb") as written:
            os.fsync(written.fileno())
        temporary.replace(path)
    except BaseException as error:
        temporary.unlink(missing_ok=True)  # Ctrl-C may come just after the file has taken its name
        if isinstance(error, OSError) and error.errno is not None and error.filename is None:
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise


def lies_within(path: Path, folder: Path) -> bool:
    """Whether a file lies in a folder or below, symbolic links followed."""
    return Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder))  # `Path.resolve` fails on a ring


def checksum(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal digits."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def verified(path: Path, expected: str | None = None, origin: str = "", hint: str = "") -> str:
    """Return the checksum of a file that a user has to provide.

    Parameters
    ----------
    expected : SHA-256 that it must have, None for any
    origin : where a user gets the file
    hint : further advice where it is missing

    Raises
    ------
    CalibError : it is missing, or another file
    """
    source = f"; get it from {origin}" if origin else ""
    if not path.is_file():
        known = f" (sha256 {expected})" if expected else ""
        raise CalibError(f"{path}: no such file{source}{known}{hint}")
    actual = checksum(path)
    if expected is not None and actual != expected.lower():
        raise CalibError(f"{path}: expected sha256 {expected}, got {actual}: another or a damaged file{source}")
    return actual
