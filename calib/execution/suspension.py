"""Time in which this process did not run: stopped by a signal, or asleep with its machine."""

import threading
import time
from collections.abc import Callable

WAKE_INTERVAL = 0.25  # s, between two looks at the clock
MIN_GAP = 1.0  # s, between the look that is due and that which comes: less is a busy machine


class SuspensionClock:
    """Adds up the gaps between its looks at a clock; thread-safe.

    Parameters
    ----------
    clock : that goes on meanwhile  [s]
    interval : between two looks, at most, while the process runs  [s]
    """

    def __init__(self, clock: Callable[[], float], interval: float = WAKE_INTERVAL):
        self._clock, self._interval = clock, interval
        self._last, self._total = clock(), 0.0
        self._looking = threading.Lock()

    def look(self) -> float:
        """Return the time in which the process was suspended so far  [s]."""
        with self._looking:
            now = self._clock()
            gap = now - self._last - self._interval
            self._last = now
            self._total += gap if gap > MIN_GAP else 0.0
            return self._total

    def forget(self) -> None:
        """Count the time since the last look as one in which the process ran."""
        with self._looking:
            self._last = self._clock()


_starting = threading.Lock()
_own: SuspensionClock | None = None  # of this process, since it was first asked for


def suspended() -> float:
    """Time in which this process was suspended since the first call, which begins to watch, by the wall clock  [s].

    The clock goes on while the machine sleeps, and so does that by which calls are ended that take too long.
    """
    global _own
    with _starting:
        if _own is None:
            _own = SuspensionClock(time.time)
            threading.Thread(target=_watch, args=(_own,), daemon=True, name="suspension").start()
    return _own.look()


def _watch(clock: SuspensionClock) -> None:
    while True:
        time.sleep(WAKE_INTERVAL)
        clock.look()
