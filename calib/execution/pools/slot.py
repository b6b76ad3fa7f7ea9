"""One child process at a time, with limits on its calls."""

import os
import queue
import signal
import time
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from ctypes import c_byte
from multiprocessing import get_context
from multiprocessing.context import ForkServerContext
from typing import Any

from pebble import ProcessExpired, ProcessPool

from calib.errors import CalibError, CodeChanged
from calib.execution.interrupt import uninterrupted
from calib.execution.pool import CRASHED, MEMORY, TIMEOUT, Failure, failure
from calib.execution.pools.child import call, prepare
from calib.execution.pools.limits import Allowance, CallLimits
from calib.execution.pools.sent import SentFunction
from calib.execution.pools.starting import WithoutMain
from calib.execution.suspension import suspended

RETRIED = object()
GIGABYTE = 1e9  # byte
MAX_REPETITIONS = 3  # of a call that was out of time because this process was suspended


class Slot:
    """One child process at a time: a pool of pebble with one process, so that its first calls are known.

    Parameters
    ----------
    function : that is called
    limits : of each call
    allowances : which slots share, one for each stage: `CallLimits.allowances`
    """

    def __init__(self, function: SentFunction, limits: CallLimits, allowances: dict[str, Allowance]):
        self._function, self._limits, self._allowances = function, limits, allowances
        self._context: ForkServerContext = get_context("forkserver") if function.in_script else WithoutMain()
        self._numbers = None if limits.memory is None else self._context.Pipe(duplex=False)  # of processes
        self._compiling: c_byte = self._context.RawValue(c_byte, 0)
        self._pool: ProcessPool | None = None
        self._compiled: set[str] = set()  # stages of which the process has come back with a call
        self._worked = False  # whether the process has taken up a call
        self._retried = False
        self._repetitions, self._suspended = 0, 0.0  # of the call under way; time suspended before it  [s]
        self._future: Future[bytes] = Future()  # of the call under way
        self._payload, self._stage = b"", ""
        self._since, self._limit = 0.0, limits.timeout
        self._group: int | None = None
        self._exceeded = 0.0  # memory for which the call under way was killed  [byte]

    def answer(self, payload: bytes, stage: str = "") -> "bytes | Failure":
        """Make one call and wait for it; return the pickled result or Failure.

        Raises
        ------
        CalibError : the process cannot be started
        """
        done: queue.SimpleQueue[Future[bytes]] = queue.SimpleQueue()
        self.start(payload, stage, done.put)
        while True:
            done.get()
            result = self.result(done.put)
            if result is not RETRIED:
                return result

    def start(self, payload: bytes, stage: str, done: Callable[[Future[bytes]], None]) -> None:
        """Hand out one call; `done` is called, in another thread, when it has ended."""
        self._payload, self._stage = payload, stage
        self._retried, self._repetitions = False, 0
        self._schedule(done)

    def _schedule(self, done: Callable[[Future[bytes]], None]) -> None:
        if self._pool is None or not self._pool.active:  # none yet, or its idle process died
            self.close()
            given = (self._function.code, None if self._numbers is None else self._numbers[1], self._compiling)
            self._pool = ProcessPool(1, initializer=prepare, initargs=given, context=self._context)
            self._compiled.clear()
        self._limit = self._limits.timeout
        if self._limit is not None and self._stage not in self._compiled:
            self._limit += self._allowances[self._stage].seconds
        self._compiling.value = 0  # as a process that died has left it
        self._since, self._exceeded, self._suspended = time.perf_counter(), 0.0, suspended()
        try:
            with uninterrupted():  # a process whose start is interrupted would be owned by nobody
                self._future = self._pool.schedule(
                    call, args=(self._payload, self._limit, self._limits.timeout), timeout=self._limit
                )
        except BrokenProcessPool as error:  # the process could not even be started
            self._future = Future()
            self._future.set_exception(error)
        self._future.add_done_callback(done)

    def result(self, done: Callable[[Future[bytes]], None]) -> Any:
        """Pickled result, or Failure, of the call that has ended; RETRIED where it is made again.

        That is so where its process died before taking it up, and where its time has passed while this process, which
        ends calls by the wall clock, was suspended.

        Raises
        ------
        CalibError : the process ends before it takes up work
        CodeChanged : as the call
        """
        seconds = time.perf_counter() - self._since
        error = self._future.exception()
        if error is None:
            if self._stage not in self._compiled:
                self._allowances[self._stage].learn(seconds)
            self._compiled.add(self._stage)
            self._worked = True
            return self._future.result()
        if isinstance(error, BrokenProcessPool):
            return self._again(done, error, seconds)
        self._worked = True
        self._compiled.clear()  # pebble has replaced the process
        if isinstance(error, TimeoutError):
            if suspended() > self._suspended and self._repetitions < MAX_REPETITIONS:
                self._repetitions += 1
                self._schedule(done)
                return RETRIED
            return Failure(TIMEOUT, f"no result within {self._limit:g} s of wall-clock time{self._granted()}", seconds)
        if isinstance(error, CodeChanged):
            raise error
        if isinstance(error, ProcessExpired):
            if self._exceeded:
                return Failure(MEMORY, _too_much(self._exceeded, self._limits.memory), seconds)
            return Failure(CRASHED, _death(error.exitcode), seconds)
        return failure(error, seconds)

    def _granted(self) -> str:
        """Say what of the limit was granted to a first call beyond the time-out that the study states."""
        timeout = self._limits.timeout
        if timeout is None or self._limit is None or self._limit == timeout:
            return ""
        return f", of which {self._limit - timeout:g} s for what the first call of a process imports and compiles"

    def _again(self, done: Callable[[Future[bytes]], None], error: BrokenProcessPool, seconds: float) -> Any:
        """Hand the call out once more, to a new process: the old one died before it took the call up."""
        if not self._retried:
            self._retried = True
            self.close()
            self._schedule(done)
            return RETRIED
        if self._worked:
            return Failure(CRASHED, "the process ended at once, twice", seconds)
        raise CalibError(
            "the child processes end before they take up work (their messages stand above); where a script defines "
            f"what they call, it has to run the study under \"if __name__ == '__main__':\" ({error})"
        )

    @property
    def compiling(self) -> bool:
        """Whether the call under way compiles kernels."""
        return bool(self._compiling.value) and not self._future.done()

    @property
    def group(self) -> int | None:
        """Process group of the process that last started; None while no call is under way.

        It is known where memory is limited, and read by one thread.
        """
        while self._numbers is not None and self._numbers[0].poll():
            self._group = self._numbers[0].recv()
        return None if self._future.done() else self._group

    def exceed(self, memory: float) -> None:
        """Kill the call under way, which has `memory` [byte], with all programs that it has started."""
        group = self.group
        if group is not None:
            self._exceeded = memory
            with suppress(ProcessLookupError):  # it has just ended
                os.killpg(group, signal.SIGKILL)

    def stop(self) -> None:
        """Ask the process to end, without waiting."""
        if self._pool is not None:
            self._pool.stop()

    def close(self) -> None:
        """End the process and wait for it."""
        if self._pool is not None:
            self._pool.stop()
            self._pool.join()
            self._pool = None


def _death(code: int) -> str:
    if code < 0:
        number = -code
        name = signal.Signals(number).name if number in set(signal.Signals) else "?"
        hint = "; the machine may have run out of memory" if number == signal.SIGKILL else ""
        return f"the process was ended by signal {number} ({name}){hint}"
    return f"the process ended with exit code {code}"


def _too_much(memory: float, limit: float | None) -> str:
    allowed = "" if limit is None else f", and [pool] memory allows {limit / GIGABYTE:.3g} GB"
    return f"the process and its programs held {memory / GIGABYTE:.3g} GB of memory{allowed}"
