"""A call in a process forked for it: a library that hangs, crashes or takes all memory takes nothing with it."""

import os
import pickle
import resource
import signal
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from calib.errors import CalibError

T = TypeVar("T")
STATM = Path("/proc/self/statm")  # memory of this process on Linux, in pages
SECONDS, BYTES_PER_SECOND = 10, 2_000_000  # s, bytes/s: processor time of reading, for any file and by its size
MEMORY, MEMORY_PER_BYTE = 2**27, 64  # bytes: of reading any file, and by its size; measured data are packed 20 times
WALL = 20  # wall-clock time that is granted, over that of the processor
PROTOCOL = 5  # of pickle, which copies arrays once


def read_apart(call: Callable[[], T], *paths: Path) -> T:
    """Return what is read of files, as in `apart`, within a time and a memory that their sizes allow.

    Raises
    ------
    OSError : it takes more than that, the library that reads it crashes, or cannot read it
    CalibError : it is refused
    """
    sizes = [path.stat().st_size for path in paths]
    return apart(call, SECONDS + sum(sizes) // BYTES_PER_SECOND, MEMORY + MEMORY_PER_BYTE * max(sizes))


def apart(call: Callable[[], T], seconds: int, memory: int) -> T:
    """Return what a call returns, from a process of its own.

    Parameters
    ----------
    call : its result and its errors can be pickled; what it changes is lost
    seconds : of processor time that it may take  [s]
    memory : that it may take beyond what this process has  [bytes]

    Raises
    ------
    OSError : it took more than that, or crashed
    Exception : what the call raises
    """
    ours, theirs = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # other threads hold no lock that a reader of files takes
        child = os.fork()
    if child == 0:
        try:
            os.close(ours)
            _limit(seconds, memory)
            _answer(call, theirs)
        finally:
            os._exit(0)
    os.close(theirs)
    try:
        with os.fdopen(ours, "rb") as file:
            error, result = pickle.load(file)
    except (EOFError, pickle.UnpicklingError, AttributeError, IndexError, ValueError):
        raise OSError(_reason(os.waitpid(child, 0)[1], seconds)) from None
    except BaseException:  # Ctrl-C
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        raise
    os.waitpid(child, 0)
    if error is not None:
        raise error
    return result


def _limit(seconds: int, memory: int) -> None:
    """Limit processor time, wall-clock time and memory of this process."""
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_REAL, WALL * seconds)
    _, hard = resource.getrlimit(resource.RLIMIT_CPU)
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, hard))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if STATM.exists():
        used = int(STATM.read_text().split()[0]) * resource.getpagesize()
        _, hard = resource.getrlimit(resource.RLIMIT_AS)
        limit = used + memory if hard == resource.RLIM_INFINITY else min(hard, used + memory)
        resource.setrlimit(resource.RLIMIT_AS, (limit, hard))


def _answer(call: Callable[[], T], pipe: int) -> None:
    """Write the error and the result of the call, one of which is None, into a pipe."""
    with os.fdopen(pipe, "wb") as file:
        error: Exception | None = None
        result = None
        try:
            result = call()
        except CalibError as mistake:
            error = mistake.with_traceback(None)
            error.__cause__ = error.__context__ = None  # what led to it may hold anything
        except MemoryError:
            error = OSError("it takes too much memory")
        except Exception as raised:  # of a library that decodes damaged content
            error = OSError(f"{type(raised).__name__}: {raised}"[:400])
        pickle.dump((error, result), file, PROTOCOL)


def _reason(status: int, seconds: int) -> str:
    if not os.WIFSIGNALED(status):
        return "it failed, for want of memory perhaps"
    name = signal.Signals(os.WTERMSIG(status)).name
    if name == "SIGXCPU":
        return f"it takes more than {seconds} s of processor time"
    return f"it takes more than {WALL * seconds} s" if name == "SIGALRM" else f"it crashed: {name}"
