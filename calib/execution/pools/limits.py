"""Limits on one call in a child process."""

from collections import defaultdict
from dataclasses import dataclass
from functools import partial

from calib.errors import CalibError

STARTUP_ALLOWANCE = 120.0  # s, for a process's first call: imports and compiling of kernels
MIN_STARTUP_ALLOWANCE = 10.0  # s, for a later process's first call: what was compiled is loaded then


@dataclass(frozen=True)
class CallLimits:
    """Limits on one call in a child process.

    Attributes
    ----------
    timeout : wall-clock limit  [s]; None for none
    memory : resident memory of the process and of all programs that it has started, together  [byte]; None for no
        limit. It is read every tenth of a second; pages that processes share count once in each
    startup : what is added to `timeout` for a stage's first call in each process, which may import and compile  [s]

    Raises
    ------
    CalibError : a limit that is not positive
    """

    timeout: float | None = None
    memory: float | None = None
    startup: float = STARTUP_ALLOWANCE

    def __post_init__(self) -> None:
        if self.timeout is not None and not self.timeout > 0.0:
            raise CalibError(f"timeout must be positive [s], got {self.timeout!r}; leave it out for no limit")
        if self.memory is not None and not self.memory > 0.0:
            raise CalibError(f"memory must be positive [byte], got {self.memory!r}; leave it out for no limit")

    def allowances(self) -> "dict[str, Allowance]":
        """Return the allowances of processes that share them, one for each stage."""
        return defaultdict(partial(Allowance, self.startup))


class Allowance:
    """Time by which the first call of a stage in a process may exceed the limit [s]."""

    def __init__(self, seconds: float):
        self.seconds = seconds

    def learn(self, seconds: float) -> None:
        """Reduce the allowance by the duration of such a call: what it compiled is on disk for the next process."""
        self.seconds = min(self.seconds, max(MIN_STARTUP_ALLOWANCE, 2.0 * seconds))
