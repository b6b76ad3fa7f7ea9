"""The workers of an executor: anything with the shape of `concurrent.futures.Executor`."""

import uuid
from concurrent.futures import BrokenExecutor, CancelledError, Future
from typing import Any

from calib.errors import CalibError
from calib.execution.pools.remote import WorkerDied
from calib.execution.pools.settings import PoolSettings
from calib.execution.pools.setup import Answer, PoolSetup, Unfit, WorkerState
from calib.execution.pools.started import discard, started
from calib.execution.pools.worker import evaluated

WIDTH_OPTIONS = ("max_workers", "max_cores")  # that say how many calls an executor makes side by side


class ExecutorWorkers:
    """The workers of an executor that is started.

    Parameters
    ----------
    settings : of kind "executor"

    Raises
    ------
    CalibError : the class is not there, is no executor, or does not take the options
    """

    def __init__(self, settings: PoolSettings):
        self._settings = settings
        self._setup: PoolSetup | None = None
        self.place = str(settings.executor)
        self._executor = self._started()

    @property
    def width(self) -> int | None:
        """What the options say; None where they say nothing."""
        return next((self._settings.options[key] for key in WIDTH_OPTIONS if key in self._settings.options), None)

    def _started(self) -> Any:
        return started(self._settings, self._start, _end)

    def _start(self, named: type) -> Any:
        executor = named(**self._settings.options)
        missing = [name for name in ("submit", "shutdown") if not callable(getattr(executor, name, None))]
        if missing:
            raise CalibError(f"[pool] executor: {self.place!r} is no executor: it has no {' and no '.join(missing)}")
        return executor

    def prepare(self, setup: PoolSetup) -> list[WorkerState | Unfit]:
        """Take up a pool; each call brings it along, as the workers of an executor cannot be told of it together."""
        self._setup = setup
        return []

    def submit(self, payload: bytes, stage: str, key: str | None) -> "Future[Answer | Unfit]":
        """Hand out one evaluation."""
        if self._setup is None:
            raise AssertionError("the workers have not been told of a pool")
        call = uuid.uuid4().hex
        try:
            return self._executor.submit(evaluated, self._setup, payload, stage, key, call)
        except (BrokenExecutor, RuntimeError):  # a worker has died, and its executor with it
            discard(self._settings)
            self._executor = self._started()
            return self._executor.submit(evaluated, self._setup, payload, stage, key, call)

    def answer(self, handle: "Future[Answer | Unfit]") -> Answer | Unfit:
        """Return what has come of an evaluation that has ended.

        Raises
        ------
        WorkerDied : its worker ended
        """
        try:
            return handle.result()
        except (Exception, CancelledError) as error:
            raise WorkerDied(f"{type(error).__name__}: {error}") from error

    def check(self) -> None:
        """Do nothing: a broken executor is replaced."""

    def send_away(self, worker: str) -> bool:
        """Return that an executor keeps all its workers."""
        return False

    def abandon(self, handles: "list[Future[Answer | Unfit]]") -> None:
        """Cancel the evaluations that have not begun.

        Those under way end when the pool closes, where their worker shares its folder; else by their time limit.
        """
        for handle in handles:
            handle.cancel()

    def close(self) -> None:
        """Do nothing: the executor is there for the next pool."""


def _end(executor: Any) -> None:
    executor.shutdown(wait=False, cancel_futures=True)
