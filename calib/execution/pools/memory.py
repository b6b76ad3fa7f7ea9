"""The memory of process groups, watched."""

import os
import threading
import weakref
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from calib.execution.pools.slot import Slot

MEMORY_INTERVAL = 0.1  # s between two looks


class MemoryWatch:
    """Kills the call of a slot whose process group holds more memory than allowed; it ends with `close`.

    Parameters
    ----------
    limit : of each group  [byte]
    """

    def __init__(self, limit: float):
        self._limit = limit
        self._slots: weakref.WeakSet[Slot] = weakref.WeakSet()
        self._closed = threading.Event()
        threading.Thread(target=self._look, daemon=True, name="memory").start()

    def add(self, slot: Slot) -> None:
        """Watch a slot too."""
        self._slots.add(slot)

    def _look(self) -> None:
        while not self._closed.wait(MEMORY_INTERVAL):
            groups = {slot: group for slot in list(self._slots) if (group := slot.group) is not None}
            if groups:
                held = resident_memory(groups.values())
                for slot, group in groups.items():
                    if held[group] > self._limit:
                        slot.exceed(held[group])

    def close(self) -> None:
        """End the watching."""
        self._closed.set()


def resident_memory(groups: Iterable[int]) -> Counter[int]:
    """Return process group -> sum of the resident memory of its members  [byte]."""
    wanted, held = set(groups), Counter[int]()
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text(errors="replace").rpartition(")")[2].split()
        except OSError:
            continue  # it has just ended
        group = int(fields[2])
        if group in wanted:
            held[group] += int(fields[21]) * os.sysconf("SC_PAGE_SIZE")
    return held
