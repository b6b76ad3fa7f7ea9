"""A pool whose evaluations run on workers of another program."""

import pickle
import queue
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol, Self

from calib.errors import CalibError
from calib.execution.pool import CRASHED, Failure
from calib.execution.pools.identity import processor
from calib.execution.pools.results import ResultFolder, drop, kept
from calib.execution.pools.setup import Answer, PoolSetup, Unfit, WorkerState

MAX_WORKER_DEATHS = 5  # under one evaluation, after which it is given up
LOOK_INTERVAL = 5.0  # s without an answer, after which the workers are looked at
MIN_HANDED_OUT = 64  # evaluations that are handed out ahead, at least: workers take the next without asking
HANDED_OUT_PER_WORKER = 4  # and at least so many for each evaluation that goes on


class WorkerDied(Exception):
    """A worker ended while it evaluated."""


class Handle(Protocol):
    """An evaluation that was handed out."""

    def add_done_callback(self, fn: Callable[[Any], Any], /) -> Any:
        """Have `fn` called, in any thread, when it has ended."""
        ...


class Workers(Protocol):
    """The workers of another program, as a pool uses them.

    An implementation hands out `calib.execution.pools.worker.evaluated`; see that for the arguments.
    """

    @property
    def place(self) -> str:
        """Where they are, in a message."""
        ...

    @property
    def width(self) -> int | None:
        """Evaluations that they make side by side at present; None where that is not known."""
        ...

    def prepare(self, setup: PoolSetup) -> list[WorkerState | Unfit]:
        """Tell the workers, and those that join later, of a pool; return what each says of itself."""
        ...

    def submit(self, payload: bytes, stage: str, key: str | None) -> Handle:
        """Hand out one evaluation."""
        ...

    def answer(self, handle: Any) -> Answer | Unfit:
        """Return what has come of an evaluation that has ended.

        Raises
        ------
        WorkerDied : its worker ended; it may be handed out again
        CalibError : no worker can make it
        """
        ...

    def check(self) -> None:
        """Look whether the workers can be reached.

        Raises
        ------
        WorkersLost : they cannot, and will not be
        """
        ...

    def send_away(self, worker: str) -> bool:
        """Have a worker evaluate no more; return whether that can be done."""
        ...

    def abandon(self, handles: list[Any]) -> None:
        """Kill evaluations that are under way, as far as that can be done."""
        ...

    def close(self) -> None:
        """Leave the workers."""
        ...


@dataclass
class _Call:
    payload: Any
    key: str | None
    since: float
    handle: Any = None
    known: bytes | None = None  # result that lay in the folder
    deaths: int = 0


class RemotePool:
    """Calls in child processes of workers elsewhere.

    What holds of a `LocalPool` holds of each worker: limits on a call, which fails alone. A call whose worker ends is
    handed out again. A worker whose Python, libraries or code are others than those of this process is refused.

    Parameters
    ----------
    workers : that evaluate
    setup : what they are told
    jobs : calls side by side, at most; None for as many as the workers take
    results : folder in which workers that share it keep results until `map` has handed them out
    on_note : told, in one line each, what a user may want to know
    """

    def __init__(
        self,
        workers: Workers,
        setup: PoolSetup,
        jobs: int | None = None,
        results: ResultFolder | None = None,
        on_note: Callable[[str], None] = lambda text: None,
    ):
        self._workers, self._setup, self._jobs, self._results, self._on_note = workers, setup, jobs, results, on_note
        self._answered = self._waiting_told = self._storing_told = False
        self._processor = ""
        self._last_look, self._handed_out = -LOOK_INTERVAL, MIN_HANDED_OUT
        try:
            if setup.folder is not None:
                setup.folder.mkdir(parents=True, exist_ok=True)
                (setup.folder / setup.number).touch()
            for state in workers.prepare(setup):
                if isinstance(state, Unfit):
                    raise CalibError(_refused(state))
                self._heard(state)
        except BaseException:
            self.close()
            raise

    @property
    def width(self) -> int | None:
        """Calls that go on side by side at present; None where that is not known."""
        width = self._workers.width
        if width is None or self._jobs is None:
            return width or self._jobs
        return min(width, self._jobs)

    def map(self, payloads: Iterable[Any], stage: str = "") -> Iterator[tuple[int, Any]]:
        """Yield (index, result or Failure) as the calls end; leaving the loop early kills the calls under way.

        Parameters
        ----------
        payloads, stage : as in `LocalPool.map`

        Raises
        ------
        CalibError : no worker is fit to make a call
        CodeChanged : as the function
        WorkersLost : the workers can be reached no longer
        """
        waiting, calls = iter(enumerate(payloads)), dict[int, _Call]()
        done: queue.SimpleQueue[int] = queue.SimpleQueue()

        def hand_out() -> None:
            most = self._most()
            while len(calls) < most and (call := next(waiting, None)) is not None:
                index, payload = call
                calls[index] = self._begun(payload, stage, partial(_tell, done, index))

        try:
            hand_out()
            while calls:
                index = self._next(done)
                call = calls[index]
                result = self._result(call)
                if result is None:
                    self._submit(call, stage, partial(_tell, done, index))
                    continue
                del calls[index]
                hand_out()  # before the caller takes its time over the result
                yield index, result if isinstance(result, Failure) else pickle.loads(result)
                hand_out()  # what it added because of it
                if call.key is not None and self._setup.folder is not None:
                    drop(self._setup.folder, call.key)
        finally:
            if calls:
                self._workers.abandon([call.handle for call in calls.values() if call.handle is not None])

    def _begun(self, payload: Any, stage: str, tell: Callable[[Any], None]) -> _Call:
        """Hand out a call, or take its result from the folder, where an earlier run has left it."""
        key = None if self._results is None else self._results.key(payload)
        call = _Call(payload, key, time.perf_counter())
        if key is not None and self._setup.folder is not None:
            call.known = kept(self._setup.folder, key)
        if call.known is None:
            self._submit(call, stage, tell)
        else:
            tell(None)
        return call

    def _submit(self, call: _Call, stage: str, tell: Callable[[Any], None]) -> None:
        call.handle = self._workers.submit(pickle.dumps(call.payload), stage, call.key)
        call.handle.add_done_callback(tell)

    def _result(self, call: _Call) -> bytes | Failure | None:
        """Pickled result or Failure of a call that has ended; None where it is to be handed out again."""
        if call.known is not None:
            return call.known
        try:
            answer = self._workers.answer(call.handle)
        except WorkerDied as death:
            self._workers.check()
            call.deaths += 1
            if call.deaths < MAX_WORKER_DEATHS:
                return None
            if not self._answered:
                raise CalibError(f"no evaluation comes back from {self._workers.place}: {death}") from death
            seconds = time.perf_counter() - call.since
            return Failure(CRASHED, f"{call.deaths} workers ended while they evaluated it: {death}", seconds)
        if isinstance(answer, Unfit):
            if not self._answered or not self._workers.send_away(answer.worker):
                raise CalibError(_refused(answer))
            warnings.warn(f"{_refused(answer)}; it was sent away, and the run goes on without it", stacklevel=2)
            return None
        self._answered = True
        self._heard(answer.prepared)
        return answer.result

    def _next(self, done: "queue.SimpleQueue[int]") -> int:
        """Index of the next call that has ended; the workers are looked at while none does."""
        while True:
            with suppress(queue.Empty):
                return done.get(timeout=LOOK_INTERVAL)
            self._workers.check()
            if self._workers.width == 0 and not self._waiting_told:
                self._waiting_told = True
                warnings.warn(f"there is no worker at {self._workers.place} yet: waiting for one", stacklevel=3)

    def _most(self) -> int:
        """Calls that may be handed out at present."""
        if self._jobs is not None and self._setup.folder is None:
            return self._jobs
        now = time.perf_counter()
        if now - self._last_look > LOOK_INTERVAL:
            self._last_look = now
            self._handed_out = max(MIN_HANDED_OUT, HANDED_OUT_PER_WORKER * (self._workers.width or 1))
        return self._handed_out if self._jobs is None else self._jobs

    def _heard(self, prepared: WorkerState) -> None:
        """Say once where results are kept, and that kernels are compiled for another processor."""
        if not self._storing_told and self._setup.folder is not None:
            self._storing_told = True
            self._on_note(
                f"each result is kept in {self._setup.folder} by its worker before it is reported"
                if prepared.shares_folder
                else f"results are kept by this process as they arrive: the workers do not share {self._setup.folder}"
            )
        own = processor()
        if prepared.processor not in (own, self._processor):
            self._processor = prepared.processor
            warnings.warn(
                f"a worker compiles for the processor {prepared.processor!r}, this process for {own!r}: results may "
                "differ in their last digits from those of this machine",
                stacklevel=3,
            )

    def close(self) -> None:
        """Leave the workers; calls under way are killed as far as that can be done."""
        try:
            self._workers.close()
        finally:
            if self._setup.folder is not None:
                drop(self._setup.folder, self._setup.number)
                with suppress(OSError):  # results of calls that nobody waited for are left to the next run
                    self._setup.folder.rmdir()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def _tell(done: "queue.SimpleQueue[int]", index: int, _: Any) -> None:
    done.put(index)


def _refused(worker: Unfit) -> str:
    return f"worker {worker.worker} is no fit one: {'; '.join(worker.reasons)}; install the same there as here"
