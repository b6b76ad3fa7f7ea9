"""A pool of child processes of this machine."""

import os
import pickle
import queue
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from contextlib import suppress
from functools import partial
from typing import Any, Self

from calib.errors import CalibError
from calib.execution.pool import Failure, OnCompiling
from calib.execution.pools.limits import STARTUP_ALLOWANCE, CallLimits
from calib.execution.pools.memory import MemoryWatch
from calib.execution.pools.sent import pickled
from calib.execution.pools.slot import RETRIED, Slot
from calib.execution.pools.starting import start_server

COMPILATION_INTERVAL = 1.0  # between two looks at whether a process compiles  [s]
MAX_JOBS = 512  # child processes: each holds numba and its kernels, some 0.3 GB


def check_jobs(jobs: int) -> None:
    """Refuse more child processes than MAX_JOBS.

    Raises
    ------
    CalibError : with the bound
    """
    if jobs > MAX_JOBS:
        raise CalibError(
            f"jobs: {jobs} child processes exceed the bound of {MAX_JOBS}; state at most the number of cores, "
            f"{os.cpu_count() or 1} on this machine"
        )


class LocalPool:
    """Calls in persistent child processes of this machine.

    The processes start with the first `map`, from a fork server that has imported the modules of the function, so that
    replacing a killed one costs a fraction of a second. BLAS and numba run on one thread in each. The processes ignore
    Ctrl-C and end when this process ends, even by SIGKILL; a process that ends, for whatever reason, takes the programs
    that its calls have started with it.

    Parameters
    ----------
    function : picklable callable of one picklable payload; a script that defines it, or what it holds, is imported by
        the processes, and needs ``if __name__ == "__main__":`` around the code that they must not run again
    jobs : number of processes, at most MAX_JOBS
    timeout : wall-clock limit of one call [s], None for none; only the process that exceeds it is killed
    startup : what is added to the limit of a stage's first call in each process, which may import and compile [s]; once
        such a call has come back, later processes are allowed twice the time it took, and at least
        MIN_STARTUP_ALLOWANCE
    memory : limit of one call, its process and the programs that it has started together [byte], None for none; only
        the process that exceeds it is killed
    on_compiling : told, within a second and by the thread that waits for results, that a process begins to compile
        kernels, and that none does any longer
    """

    def __init__(
        self,
        function: Callable[[Any], Any],
        jobs: int = 1,
        timeout: float | None = None,
        startup: float = STARTUP_ALLOWANCE,
        memory: float | None = None,
        on_compiling: OnCompiling | None = None,
    ):
        if isinstance(jobs, bool) or not isinstance(jobs, int) or jobs < 1:
            raise CalibError(f"jobs is the number of child processes, an integer of at least 1; got {jobs!r}")
        check_jobs(jobs)
        limits = CallLimits(timeout, memory, startup)
        self._function = pickled(function)
        allowances = limits.allowances()
        self._slots = [Slot(self._function, limits, allowances) for _ in range(jobs)]
        self._on_compiling, self._compiling = on_compiling, False
        self._watch = None if memory is None else MemoryWatch(memory)
        if self._watch is not None:
            for slot in self._slots:
                self._watch.add(slot)

    @property
    def width(self) -> int:
        """Calls that go on side by side."""
        return len(self._slots)

    def map(self, payloads: Iterable[Any], stage: str = "") -> Iterator[tuple[int, Any]]:
        """Yield (index, result or Failure) as the calls end; leaving the loop early kills the calls under way.

        Parameters
        ----------
        payloads : of one call each; an iterator that had no more is asked again after each result
        stage : name of what the calls compile: the first call of each stage in a process has an allowance of its own

        Raises
        ------
        CalibError : the processes cannot be started
        CodeChanged : as the function
        """
        start_server(self._function.importable)
        waiting = iter(enumerate(payloads))
        idle, busy = list(self._slots), dict[int, Slot]()
        done: queue.SimpleQueue[int] = queue.SimpleQueue()

        def hand_out() -> None:
            while idle and (call := next(waiting, None)) is not None:
                index, payload = call
                busy[index] = idle.pop()
                busy[index].start(pickle.dumps(payload), stage, partial(_tell, done, index))

        try:
            hand_out()
            while busy:
                index = self._ended(done)
                result = busy[index].result(partial(_tell, done, index))
                if result is not RETRIED:
                    idle.append(busy.pop(index))
                    hand_out()  # before the caller takes its time over the result
                    yield index, result if isinstance(result, Failure) else pickle.loads(result)
                    hand_out()  # what it added because of it
        finally:
            for slot in busy.values():
                slot.close()
            self._tell_compiling(idle)  # the others are closed

    def _ended(self, done: queue.SimpleQueue[int]) -> int:
        """Wait for the next call to end, saying meanwhile whether kernels are compiled; return its index."""
        while self._on_compiling is not None:
            with suppress(queue.Empty):
                index = done.get(timeout=COMPILATION_INTERVAL)
                self._tell_compiling(self._slots)
                return index
            self._tell_compiling(self._slots)
        return done.get()

    def _tell_compiling(self, slots: Iterable[Slot]) -> None:
        """Tell whether one of these slots compiles kernels, where that has changed."""
        compiling = any(slot.compiling for slot in slots)
        if self._on_compiling is not None and compiling != self._compiling:
            self._compiling = compiling
            self._on_compiling(compiling)

    def close(self) -> None:
        """End the processes; calls under way are killed."""
        if self._watch is not None:
            self._watch.close()
        for slot in self._slots:
            slot.stop()
        for slot in self._slots:
            slot.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def _tell(done: queue.SimpleQueue[int], index: int, _: Future[bytes]) -> None:
    done.put(index)
