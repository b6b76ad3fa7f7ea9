"""Folders in which a program runs: each of its own name, locked while it lives, swept when its `calib` was killed."""

import fcntl
import os
import re
import shutil
import socket
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from calib.execution.guarded import end_marked

ACTIVE = "active"  # folder of those in which a program runs
NAME_DIGITS = 12  # hexadecimal, at random, of the name of a folder
MAX_HOST_CHARACTERS = 40  # of the machine's name in it
NAME = re.compile(r"(?P<host>.+)-(?P<pid>\d+)-(?P<start>\d+)-(?P<mark>[0-9a-f]+)")
RENAME_ATTEMPTS = 5  # of a folder to a name that others may take at the same time


@dataclass(frozen=True)
class RunFolder:
    """A folder of one run.

    Attributes
    ----------
    path : of the folder
    mark : by which processes of the run are known, in their environment
    lock : descriptor of the folder, locked
    """

    path: Path
    mark: str
    lock: int

    def emptied(self, keep: tuple[str, ...]) -> None:
        """Delete all that is in the folder, but files of the given names."""
        for entry in self.path.iterdir():
            if entry.is_dir() and not entry.is_symlink():
                shutil.rmtree(entry, ignore_errors=True)
            elif entry.name not in keep:
                entry.unlink()

    def moved(self, name: str) -> Path:
        """Move the folder out of the active ones, in the place of an older one of that name."""
        target = self.path.parent.parent / name
        for _ in range(RENAME_ATTEMPTS):
            if target.exists():
                shutil.rmtree(target, ignore_errors=True)
            with suppress(OSError):
                return self.path.rename(target)
        return self.path.rename(target.with_name(f"{name}-{self.mark}"))


@contextmanager
def run_folder(root: Path) -> Iterator[RunFolder]:
    """Make a folder below `root`; it is deleted in the end, unless it was moved.

    Its name holds machine, process and a random number, so that runs of any number of processes and machines share a
    root. Folders of runs whose process was killed are deleted first.
    """
    active = root / ACTIVE
    active.mkdir(parents=True, exist_ok=True)
    mark = uuid.uuid4().hex[:NAME_DIGITS]
    path = active / f"{_host()}-{os.getpid()}-{_started(os.getpid())}-{mark}"
    path.mkdir()
    lock = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    with suppress(OSError):  # a file system without locks: the process number tells
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    try:
        yield RunFolder(path, mark, lock)
    finally:
        os.close(lock)
        shutil.rmtree(path, ignore_errors=True)


def sweep(root: Path) -> None:
    """Delete what runs on this machine have left whose process was killed, and end what still runs of them.

    Folders of other machines, and of processes that live, are left alone.
    """
    with suppress(OSError):
        for path in (root / ACTIVE).iterdir():
            name = NAME.fullmatch(path.name)
            if name is None or name["host"] != _host() or _lives(path, int(name["pid"]), name["start"]):
                continue
            end_marked(name["mark"])
            shutil.rmtree(path, ignore_errors=True)


def drop_oldest(root: Path, beginning: str, most: int) -> None:
    """Delete the oldest kept folders whose name begins so, but for `most` of them."""
    with suppress(OSError):
        kept = sorted(root.glob(f"{beginning}*"), key=lambda path: path.stat().st_mtime_ns)
        for path in kept[:-most]:
            shutil.rmtree(path, ignore_errors=True)


def _lives(path: Path, pid: int, start: str) -> bool:
    """Whether the process that made a folder lives, or something else holds its lock."""
    if _started(pid) == start:
        return True
    try:
        handle = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    except OSError:  # another process has just deleted it
        return True
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    finally:
        os.close(handle)
    return False


def _host() -> str:
    return re.sub(r"[^\w.]", "_", socket.gethostname())[:MAX_HOST_CHARACTERS]


def _started(pid: int) -> str:
    """When a process was started, in ticks since the machine was; empty where there is none, or only its zombie."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()
    except OSError:
        return ""
    return "" if fields[0] == b"Z" else fields[19].decode()
