"""Processes that are recognised by a mark in the environment, which what they start inherits."""

import os
import signal
import time
import uuid
from pathlib import Path

MARK = "CALIB_TEST_MARK"


def new_mark() -> str:
    """A value of the variable MARK that no other process has."""
    return uuid.uuid4().hex


def marked(mark: str) -> list[int]:
    """Processes alive (not zombies) that were executed, or forked from one that was, with the mark."""
    entry, numbers = f"{MARK}={mark}".encode(), []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if entry in (folder / "environ").read_bytes().split(b"\0"):
                numbers.append(int(folder.name))
        except OSError:  # it has just ended, or is another user's
            continue
    return numbers


def survivors(mark: str, patience: float = 10.0) -> list[int]:
    """Marked processes that are still there after `patience` [s]; they are ended here."""
    deadline = time.monotonic() + patience
    while (left := marked(mark)) and time.monotonic() < deadline:
        time.sleep(0.05)
    for pid in left:
        os.kill(pid, signal.SIGKILL)
    return left
