"""The files of an FMU, unpacked once a process into a temporary folder that is removed when the process ends."""

import atexit
import contextlib
import fcntl
import os
import shutil
import tempfile
import zipfile
from functools import cache
from pathlib import Path

from calib.errors import CalibError
from calib.execution.files import checksum
from calib.simulators.fmu.package import fmpy

PREFIX = "calib-fmu-"  # of the temporary folders
LOCK = "in-use"  # file in such a folder that its process holds locked, and the system releases where it is killed
MAX_UNPACKED_BYTES = 4_000_000_000  # of all files of an FMU together


@cache
def unpacked(path: Path, sha256: str) -> Path:
    """Folder with the files of an FMU, which this process removes when it ends.

    Folders of processes that were killed are removed first.

    Raises
    ------
    CalibError : the file is absent, is not the one with this check sum, or is too large
    """
    if not path.is_file():
        raise CalibError(
            f"{path}: no such file on this machine; put the FMU where the study was read, or share the folder"
        )
    if checksum(path) != sha256:
        raise CalibError(f"{path} has changed since the study was read; run the command again")
    with zipfile.ZipFile(path) as archive:
        size = sum(member.file_size for member in archive.infolist())
    if size > MAX_UNPACKED_BYTES:
        raise CalibError(f"{path} takes {size:.3g} bytes unpacked, more than the bound of {MAX_UNPACKED_BYTES:.3g}")
    sweep()
    folder = Path(tempfile.mkdtemp(prefix=PREFIX))
    _hold(folder)
    atexit.register(_remove, folder, os.getpid())
    fmpy().extract(str(path), unzipdir=str(folder))
    return folder


def sweep() -> None:
    """Remove the folders that killed processes have left."""
    for folder in Path(tempfile.gettempdir()).glob(f"{PREFIX}*"):
        with contextlib.suppress(OSError), (folder / LOCK).open("r+b") as file:  # OSError: in use, or somebody else's
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            shutil.rmtree(folder, ignore_errors=True)


def _hold(folder: Path) -> None:
    """Lock a folder for as long as this process lives; the lock is there before the file has its name."""
    descriptor = os.open(folder / f"{LOCK}.new", os.O_RDWR | os.O_CREAT, 0o600)
    fcntl.flock(descriptor, fcntl.LOCK_EX)
    os.rename(folder / f"{LOCK}.new", folder / LOCK)


def _remove(folder: Path, owner: int) -> None:
    if os.getpid() == owner:
        shutil.rmtree(folder, ignore_errors=True)
