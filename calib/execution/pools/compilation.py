"""Whether a process compiles kernels, written where its parent reads it.

It is imported where numba is already: a program that simulates without it need not wait for its import.
"""

from ctypes import c_byte

from numba.core.event import Event, Listener, register


class CompilationFlag(Listener):
    """Sets a flag as long as numba compiles: kernels that it finds in its cache raise no event.

    Parameters
    ----------
    flag : shared with the parent
    """

    def __init__(self, flag: c_byte):
        self._flag, self._depth = flag, 0

    def on_start(self, event: Event) -> None:
        """Take in that a kernel is compiled, perhaps for another one."""
        self._depth += 1
        self._flag.value = 1

    def on_end(self, event: Event) -> None:
        """Take in that it is compiled."""
        self._depth -= 1
        self._flag.value = self._depth > 0


def watch(flag: c_byte) -> None:
    """Keep the flag in this process from now on."""
    register("numba:compile", CompilationFlag(flag))
