"""One writer at a time in a study's folder."""

import errno
import fcntl
import os
import socket
import time
import warnings
from pathlib import Path

from calib.errors import CalibError
from calib.execution.files import PERMISSIONS

LOCK_NAME = "trials.lock"
MAX_WAIT = 0.5  # s, for the lock: `is_locked` takes it for an instant to look at it


class Lock:
    """A lock on a folder that the kernel releases when the process ends, however it ends; children do not inherit it.

    Parameters
    ----------
    folder : of the lock file
    guarded : file that is written meanwhile, named in messages; None for the folder
    """

    def __init__(self, folder: Path, guarded: Path | None = None):
        self._path = folder / LOCK_NAME
        self._guarded = guarded or folder
        self._handle: int | None = None

    def acquire(self) -> None:
        """Take the lock.

        Raises
        ------
        CalibError : another process holds it; the message names it
        """
        handle = os.open(self._path, os.O_RDWR | os.O_CREAT, PERMISSIONS)
        try:
            _lock(handle)
        except OSError as error:
            holder = os.read(handle, 200).decode(errors="replace").strip()
            os.close(handle)
            if error.errno in (errno.EWOULDBLOCK, errno.EACCES):
                raise CalibError(
                    f"{self._guarded} is being written by {holder or 'another process'}; "
                    "wait for it, stop it, or choose another place"
                ) from None
            warnings.warn(f"{self._path} cannot be locked ({error.strerror}); start no second run here", stacklevel=3)
            return
        os.ftruncate(handle, 0)
        os.pwrite(handle, f"process {os.getpid()} on {socket.gethostname()}\n".encode(), 0)
        self._handle = handle

    def release(self) -> None:
        """Release the lock."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None


def _lock(handle: int) -> None:
    """Take the lock on an open file; where another process holds it, try again for `MAX_WAIT`."""
    limit = time.monotonic() + MAX_WAIT
    while True:
        try:
            return fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() > limit:
                raise
            time.sleep(0.02)


def is_locked(folder: Path) -> bool:
    """Whether a process is writing in the folder."""
    try:
        with open(folder / LOCK_NAME, "rb") as lock:
            fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)  # given back when the file closes
    except FileNotFoundError:
        return False
    except BlockingIOError:
        return True
    return False
