"""The contract of a pool, which evaluates a function at many payloads."""

import os
import re
import sysconfig
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, Self

from calib.errors import CalibError, CodeChanged

MAX_EXCEPTION_CHARACTERS = 380  # of an exception with its place, less than a trial's reason holds
MIN_MESSAGE_CHARACTERS = 120  # of its message, whatever the place
INSTALLED = frozenset(("site-packages", "dist-packages"))  # folders that hold libraries
NOT_AUTHORED = (  # beginnings of the paths of the interpreter and of calib
    *(sysconfig.get_path(name) + os.sep for name in ("stdlib", "platstdlib")),
    os.path.dirname(os.path.dirname(os.path.abspath(__file__))) + os.sep,
    "<frozen ",
)
REMOTE_FRAME = re.compile(  # of the text of a traceback
    r'^  File "(?P<path>.+)", line (?P<number>\d+), in (?P<name>.+)\n    (?P<code>\S.*)$', re.MULTILINE
)
REFUSED, RAISED, TIMEOUT, CRASHED, MEMORY = "refused", "raised", "timeout", "crashed", "memory"

OnCompiling = Callable[[bool], None]  # told True when kernels begin to be compiled, False when that has ended


class Pool(Protocol):
    """Where a function is evaluated at many payloads."""

    def map(self, payloads: Iterable[Any]) -> Iterator[tuple[int, Any]]:
        """Yield (index, result or Failure) as they end."""
        ...


class OpenPool(Pool, Protocol):
    """A pool that was opened; use it in a with block."""

    @property
    def width(self) -> int | None:
        """Calls that go on side by side at present; None where that is not known."""
        ...

    def map(self, payloads: Iterable[Any], stage: str = "") -> Iterator[tuple[int, Any]]:
        """Yield (index, result or Failure) as the calls end; leaving the loop early kills the calls under way.

        Parameters
        ----------
        payloads : of one call each
        stage : name of what the calls compile: the first call of each stage in a process has an allowance of its own
        """
        ...

    def close(self) -> None:
        """End what was started for the pool; calls under way are killed."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(self, *exception: object) -> None: ...


def in_order(pool: Pool, payloads: Sequence[Any]) -> list[Any]:
    """Return the results of `pool.map` in the order of the payloads."""
    results = dict(pool.map(payloads))
    return [results[index] for index in range(len(payloads))]


@dataclass(frozen=True)
class Failure:
    """A call that gave no result, and why.

    Attributes
    ----------
    status : "timeout" (its wall-clock limit passed), "crashed" (its process died), "raised" (an exception that is a bug
        or a numerical accident), "refused" (CalibError: a mistake of the user, which other payloads will repeat),
        "memory" (it and its programs held more than they may)
    reason : one line
    seconds : wall-clock time from handing out to the end  [s]
    """

    status: str
    reason: str
    seconds: float


def failure(error: BaseException, seconds: float) -> Failure:
    """Return what an exception of a call is to whoever asked for it, `seconds` after the call was handed out."""
    if isinstance(error, CalibError):
        return Failure(REFUSED, str(error), seconds)
    message = f"{type(error).__name__}: {error}".removesuffix(": ")
    place = _place(_frames(error))
    most = max(MIN_MESSAGE_CHARACTERS, MAX_EXCEPTION_CHARACTERS - len(place))
    if len(message) > most:  # so that a reason that is cut still tells the place
        message = f"{message[:most]} ..."
    return Failure(RAISED, f"{message}{place}", seconds)


def _frames(error: BaseException) -> Sequence[traceback.FrameSummary]:
    """Frames of an exception; of one from another process, whose cause has the text of its traceback, out of that."""
    if error.__traceback__ is not None or error.__cause__ is None:
        return traceback.extract_tb(error.__traceback__)
    return [
        traceback.FrameSummary(frame["path"], int(frame["number"]), frame["name"], line=frame["code"])
        for frame in REMOTE_FRAME.finditer(str(error.__cause__))
    ]


def _place(frames: Sequence[traceback.FrameSummary]) -> str:
    """File, line and code of a study's author from which a library was called that raised, else where it was raised."""
    authored = [frame for frame in frames if _is_authored(frame.filename)] or frames
    return f" ({authored[-1].filename}, line {authored[-1].lineno}: {authored[-1].line})" if authored else ""


def _is_authored(path: str) -> bool:
    """Whether a file is neither the interpreter's nor installed nor calib's."""
    return not path.startswith(NOT_AUTHORED) and not INSTALLED & set(path.split(os.sep))


class InProcess:
    """Calls one after the other in this process: for tests and notebooks. No time-out; a crash ends this process."""

    def __init__(self, function: Callable[[Any], Any]):
        self._function = function

    @property
    def width(self) -> int:
        """One call goes on at a time."""
        return 1

    def map(self, payloads: Iterable[Any], stage: str = "") -> Iterator[tuple[int, Any]]:
        """Yield (index, result or Failure) in the order of the payloads, whatever their stage."""
        for index, payload in enumerate(payloads):
            start = time.perf_counter()
            try:
                result = self._function(payload)
            except CodeChanged:  # concerns all payloads
                raise
            except Exception as error:  # a failed evaluation is data
                result = failure(error, time.perf_counter() - start)
            yield index, result

    def close(self) -> None:
        """Do nothing: no process was started."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
