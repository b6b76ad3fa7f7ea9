"""The time that the call under way may take, for code in it that can give up by itself."""

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import NamedTuple


class TimeLimit(NamedTuple):
    """What a call may take.

    Attributes
    ----------
    until : when it is ended from outside, by time.monotonic()  [s]
    seconds : time-out of a call that need not import or compile anything  [s]
    """

    until: float = math.inf
    seconds: float = math.inf


NO_LIMIT = TimeLimit()
_LIMIT: ContextVar[TimeLimit] = ContextVar("limit", default=NO_LIMIT)


@contextmanager
def within(limit: float | None, timeout: float | None = None) -> Iterator[None]:
    """Let the block know its limits.

    Parameters
    ----------
    limit : time after which it is ended from outside  [s], None for none
    timeout : the same of a call that need not import or compile anything, None for `limit`
    """
    if limit is None:
        token = _LIMIT.set(NO_LIMIT)
    else:
        token = _LIMIT.set(TimeLimit(time.monotonic() + limit, limit if timeout is None else timeout))
    try:
        yield
    finally:
        _LIMIT.reset(token)


def timeout() -> float:
    """Time-out of the call that need not import or compile anything; infinite without one  [s]."""
    return _LIMIT.get().seconds


def remaining(since: float, suspended: float = 0.0) -> float:
    """Time that is left of the call, to a part of it that began at `since`, by time.monotonic()  [s].

    The part may take as long as a call that need not import or compile anything. Infinite without a limit.

    suspended : time since then in which the process did not run, which does not count  [s]
    """
    limit, now = _LIMIT.get(), time.monotonic() - suspended
    return min(limit.until - now, limit.seconds - (now - since))
