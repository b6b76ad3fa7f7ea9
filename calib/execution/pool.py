"""A function evaluated at many payloads, in child processes or in this one."""

import fcntl
import os
import pickle
import queue
import signal
import threading
import time
import traceback
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context, parent_process, resource_tracker, spawn
from multiprocessing.context import ForkServerContext, ForkServerProcess
from multiprocessing.forkserver import ensure_running, set_forkserver_preload
from types import FunctionType
from typing import Any, Protocol, Self

from pebble import ProcessExpired, ProcessPool

from calib.errors import CalibError
from calib.execution.deadline import within
from calib.execution.interrupt import uninterrupted
from calib.execution.process_group import lead_process_group

MAX_JOBS = 512  # child processes: each holds numba and its kernels, some 0.3 GB
STARTUP_ALLOWANCE = 120.0  # s, for a worker's first call: imports and compiling of kernels
MIN_STARTUP_ALLOWANCE = 10.0  # s, for a later worker's first call: what was compiled is loaded then
THREAD_VARIABLES = (  # of the environment: number of threads of a BLAS
    "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS",
)  # fmt: skip
REFUSED, RAISED, TIMEOUT, CRASHED = "refused", "raised", "timeout", "crashed"


class Pool(Protocol):
    """Where a function is evaluated at many payloads."""

    def map(self, payloads: Iterable[Any]) -> Iterator[tuple[int, Any]]:
        """Yield (index, result or Failure) as they end."""
        ...


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
        or a numerical accident), "refused" (CalibError: a mistake of the user, which other payloads will repeat)
    reason : one line
    seconds : wall-clock time from handing out to the end  [s]
    """

    status: str
    reason: str
    seconds: float


def _failure(error: BaseException, seconds: float) -> Failure:
    if isinstance(error, CalibError):
        return Failure(REFUSED, str(error), seconds)
    frames = traceback.extract_tb(error.__traceback__)
    where = f" ({frames[-1].filename}, line {frames[-1].lineno}: {frames[-1].line})" if frames else ""
    return Failure(RAISED, f"{type(error).__name__}: {error}{where}", seconds)


class InProcess:
    """Calls one after the other in this process: for tests and notebooks. No time-out; a crash ends this process."""

    def __init__(self, function: Callable[[Any], Any]):
        self._function = function

    def map(self, payloads: Iterable[Any], stage: str = "") -> Iterator[tuple[int, Any]]:
        """Yield (index, result or Failure) in the order of the payloads, whatever their stage."""
        for index, payload in enumerate(payloads):
            start = time.perf_counter()
            try:
                result = self._function(payload)
            except Exception as error:  # a failed evaluation is data
                result = _failure(error, time.perf_counter() - start)
            yield index, result

    def close(self) -> None:
        """Do nothing: no process was started."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


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
    """

    def __init__(
        self,
        function: Callable[[Any], Any],
        jobs: int = 1,
        timeout: float | None = None,
        startup: float = STARTUP_ALLOWANCE,
    ):
        if isinstance(jobs, bool) or not isinstance(jobs, int) or jobs < 1:
            raise CalibError(f"jobs is the number of child processes, an integer of at least 1; got {jobs!r}")
        check_jobs(jobs)
        if timeout is not None and not timeout > 0.0:
            raise CalibError(f"timeout must be positive [s], got {timeout!r}; leave it out for no limit")
        code, modules = pickled(function)
        self._modules = sorted(modules - {"__main__"})
        context = get_context("forkserver") if "__main__" in modules else _WithoutMain()
        allowances: dict[str, _Allowance] = defaultdict(partial(_Allowance, startup))
        self._slots = [_Slot(code, context, timeout, allowances) for _ in range(jobs)]

    def map(self, payloads: Iterable[Any], stage: str = "") -> Iterator[tuple[int, Any]]:
        """Yield (index, result or Failure) as the calls end; leaving the loop early kills the calls under way.

        Parameters
        ----------
        payloads : of one call each; an iterator that had no more is asked again after each result
        stage : name of what the calls compile: the first call of each stage in a process has an allowance of its own

        Raises
        ------
        CalibError : the processes cannot be started
        """
        _start_server(self._modules)
        waiting = iter(enumerate(payloads))
        idle, busy = list(self._slots), dict[int, _Slot]()
        done: queue.SimpleQueue[int] = queue.SimpleQueue()

        def hand_out() -> None:
            while idle and (call := next(waiting, None)) is not None:
                index, payload = call
                busy[index] = idle.pop()
                busy[index].start(payload, stage, partial(_tell, done, index))

        try:
            hand_out()
            while busy:
                index = done.get()
                result = busy[index].result(partial(_tell, done, index))
                if result is not RETRIED:
                    idle.append(busy.pop(index))
                    hand_out()  # before the caller takes its time over the result
                    yield index, result
                    hand_out()  # what it added because of it
        finally:
            for slot in busy.values():
                slot.close()

    def close(self) -> None:
        """End the processes; calls under way are killed."""
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


RETRIED = object()


class _Allowance:
    """Time by which the first call of a stage in a process may exceed the limit [s]."""

    def __init__(self, seconds: float):
        self.seconds = seconds

    def learn(self, seconds: float) -> None:
        """Reduce the allowance by the duration of such a call: what it compiled is on disk for the next process."""
        self.seconds = min(self.seconds, max(MIN_STARTUP_ALLOWANCE, 2.0 * seconds))


class _Slot:
    """One worker process at a time: a pool of pebble with one process, so that its first calls are known.

    The slots of a pool share its `allowances`, one for each stage.
    """

    def __init__(
        self, function: bytes, context: ForkServerContext, timeout: float | None, allowances: "dict[str, _Allowance]"
    ):
        self._function, self._context = function, context
        self._timeout, self._allowances = timeout, allowances
        self._pool: ProcessPool | None = None
        self._compiled: set[str] = set()  # stages of which the process has come back with a call
        self._worked = False  # whether the process has taken up a call
        self._retried = False
        self._future: Future[bytes] = Future()  # of the call under way
        self._payload, self._stage = b"", ""
        self._since, self._limit = 0.0, timeout

    def start(self, payload: Any, stage: str, done: Callable[[Future[bytes]], None]) -> None:
        """Hand out one call; `done` is called, in another thread, when it has ended."""
        self._payload, self._stage = pickle.dumps(payload), stage
        self._retried = False
        self._schedule(done)

    def _schedule(self, done: Callable[[Future[bytes]], None]) -> None:
        if self._pool is None or not self._pool.active:  # none yet, or its idle process died
            self.close()
            self._pool = ProcessPool(1, initializer=_prepare, initargs=(self._function,), context=self._context)
            self._compiled.clear()
        self._limit = self._timeout
        if self._limit is not None and self._stage not in self._compiled:
            self._limit += self._allowances[self._stage].seconds
        self._since = time.perf_counter()
        try:
            with uninterrupted():  # a process whose start is interrupted would be owned by nobody
                self._future = self._pool.schedule(
                    _call, args=(self._payload, self._limit, self._timeout), timeout=self._limit
                )
        except BrokenProcessPool as error:  # the process could not even be started
            self._future = Future()
            self._future.set_exception(error)
        self._future.add_done_callback(done)

    def result(self, done: Callable[[Future[bytes]], None]) -> Any:
        """Result or Failure of the call that has ended; RETRIED where its process died before taking it up."""
        seconds = time.perf_counter() - self._since
        error = self._future.exception()
        if error is None:
            if self._stage not in self._compiled:
                self._allowances[self._stage].learn(seconds)
            self._compiled.add(self._stage)
            self._worked = True
            return pickle.loads(self._future.result())
        if isinstance(error, BrokenProcessPool):
            return self._again(done, error, seconds)
        self._worked = True
        self._compiled.clear()  # pebble has replaced the process
        if isinstance(error, TimeoutError):
            return Failure(TIMEOUT, f"no result within {self._limit:g} s of wall-clock time", seconds)
        if isinstance(error, ProcessExpired):
            return Failure(CRASHED, _death(error.exitcode), seconds)
        return _failure(error, seconds)

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


class _Modules(pickle.Pickler):
    """Pickler that notes the modules its classes and functions come from."""

    def __init__(self, file: "_Buffer"):
        super().__init__(file)
        self.names: set[str] = set()

    def reducer_override(self, obj: Any) -> Any:
        """Note the module of `obj` and leave its pickling as it is."""
        if isinstance(obj, type | FunctionType):
            self.names.add(obj.__module__)
        elif isinstance(module := getattr(obj, "module", None), str):  # pickled by reference to it, as laws are
            self.names.add(module)
        return NotImplemented


def pickled(function: Callable[[Any], Any]) -> tuple[bytes, set[str]]:
    """Pickle `function`; also the modules that a process needs to call it."""
    file = _Buffer()
    pickler = _Modules(file)
    try:
        pickler.dump(function)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise CalibError(
            f"the function cannot be sent to a child process ({error}); define it and what it holds at module level"
        ) from error
    return bytes(file), pickler.names


class _Buffer(bytearray):
    def write(self, data: bytes) -> None:
        self.extend(data)


# ---- in the child

_function: Any = None


def _prepare(function: bytes) -> None:
    """Set up a new worker of one thread, that ends with its parent or when asked to, with all that it has started."""
    global _function
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # pebble's handler would wait for the interpreter, which may hang
    lead_process_group()
    _die_with_parent()
    os.environ["NUMBA_NUM_THREADS"] = "1"
    _function = function


def _die_with_parent() -> None:
    """Let the kernel end this process (SIGIO, default action) when the pipe to its parent closes.

    A watching thread would need the interpreter, which a running kernel may hold.
    """
    parent = parent_process()
    if parent is None:  # not a child process
        return
    pipe = parent.sentinel
    fcntl.fcntl(pipe, fcntl.F_SETOWN, os.getpid())
    fcntl.fcntl(pipe, fcntl.F_SETFL, fcntl.fcntl(pipe, fcntl.F_GETFL) | os.O_ASYNC)
    if not parent.is_alive():
        os._exit(1)


def _call(payload: bytes, limit: float | None, timeout: float | None) -> bytes:
    """Pickled result or Failure of the function at a pickled payload; see `calib.execution.deadline` for its limits."""
    global _function
    start = time.perf_counter()
    try:
        if isinstance(_function, bytes):
            _function = pickle.loads(_function)
        with within(limit, timeout):
            return pickle.dumps(_function(pickle.loads(payload)))
    except Exception as error:  # a failed evaluation is data
        return pickle.dumps(_failure(error, time.perf_counter() - start))


# ---- starting children

_starting = threading.Lock()


class _ProcessWithoutMain(ForkServerProcess):
    """A process that does not import the script it was started from."""

    def start(self) -> None:
        """Start the process; what prepares it leaves the main module out."""
        with _starting:
            prepared = spawn.get_preparation_data
            spawn.get_preparation_data = partial(_without_main, prepared)
            try:
                super().start()
            finally:
                spawn.get_preparation_data = prepared


def _without_main(prepared: Callable[[str], dict[str, Any]], name: str) -> dict[str, Any]:
    return {key: value for key, value in prepared(name).items() if not key.startswith("init_main")}


class _WithoutMain(ForkServerContext):
    """Starts processes that do not import the script: it needs no guard, and may be no file at all."""

    Process = _ProcessWithoutMain


def _start_server(modules: list[str]) -> None:
    """Start the fork server, if there is none yet, with `modules` imported and one thread for BLAS."""
    with _starting:
        before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
        os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
        set_forkserver_preload(modules)
        try:
            resource_tracker.ensure_running()  # first: it unblocks SIGINT when it starts
            with uninterrupted():
                ensure_running()
        finally:
            for name, value in before.items():
                if value is None:
                    del os.environ[name]
                else:
                    os.environ[name] = value
