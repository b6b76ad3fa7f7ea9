"""When the call under way has to have ended, for code in it that can give up by itself."""

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_DEADLINE: ContextVar[float] = ContextVar("deadline", default=math.inf)  # by time.monotonic()  [s]


@contextmanager
def within(seconds: float | None) -> Iterator[None]:
    """Let the block have so much time [s]; None for no limit."""
    token = _DEADLINE.set(math.inf if seconds is None else time.monotonic() + seconds)
    try:
        yield
    finally:
        _DEADLINE.reset(token)


def remaining() -> float:
    """Time that the call under way still has [s]; infinite without a limit."""
    return _DEADLINE.get() - time.monotonic()
