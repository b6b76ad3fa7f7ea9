"""The workers of a Dask scheduler."""

import asyncio
import logging
import uuid
from contextlib import suppress
from typing import Any

from distributed import Client, Future, Worker, WorkerPlugin, get_worker

from calib.errors import CalibError, WorkersLost
from calib.execution.pools.remote import WorkerDied
from calib.execution.pools.settings import PoolSettings
from calib.execution.pools.setup import Answer, PoolSetup, Unfit, WorkerState
from calib.execution.pools.started import started
from calib.execution.pools.worker import HostGone, add_pool, evaluated, pool_of, remove_pool, stop_calls

CONNECT_SECONDS = 20.0  # s, in which a scheduler has to answer
UNREACHABLE = (OSError, asyncio.TimeoutError, asyncio.CancelledError)  # raised where a scheduler does not answer


class DaskWorkers:
    """The workers of a Dask scheduler that runs, or of a cluster that is started.

    Parameters
    ----------
    settings : of kind "dask"

    Raises
    ------
    CalibError : no scheduler answers; the cluster does not start
    """

    def __init__(self, settings: PoolSettings):
        self._settings = settings
        self.place = settings.scheduler or str(settings.cluster)
        target = settings.scheduler if settings.cluster is None else started(settings, self._start, _end)
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # a lost connection is said by this pool
        try:
            self._client = Client(target, timeout=CONNECT_SECONDS, set_as_default=False)
        except (OSError, ValueError) as error:
            raise CalibError(
                f"[pool] scheduler: no Dask scheduler answers at {self.place} ({error}); `dask scheduler` starts one"
            ) from error
        self._number = ""
        self._width = 0

    def _start(self, named: type) -> Any:
        cluster = named(**self._settings.options)
        if self._settings.jobs is not None:
            cluster.scale(self._settings.jobs)
        return cluster

    @property
    def width(self) -> int | None:
        """Threads of all workers; the last number that was known where the scheduler does not answer."""
        with suppress(*UNREACHABLE):
            self._width = sum(self._client.nthreads().values())
        return self._width

    def prepare(self, setup: PoolSetup) -> list[WorkerState | Unfit]:
        """Tell the workers, and those that join later, of a pool; return what each says of itself.

        Raises
        ------
        CalibError : this package is not installed on a worker
        """
        self._number = setup.number
        try:
            self._client.register_plugin(_PoolPlugin(setup), name=setup.number)
            states = self._client.run(_prepared, setup.number, on_error="return")
        except (ImportError, AttributeError) as error:
            raise CalibError(f"a worker of {self.place} cannot take up work: {error}; install calib there") from error
        except UNREACHABLE as error:
            raise self._lost() from error
        return [
            Unfit(worker, (f"{type(state).__name__}: {state}",)) if isinstance(state, BaseException) else state
            for worker, state in states.items()
        ]

    def submit(self, payload: bytes, stage: str, key: str | None) -> Future:
        """Hand out one evaluation.

        Raises
        ------
        WorkersLost : the scheduler is gone
        """
        self.check()
        call = f"calib-{uuid.uuid4().hex}"
        return self._client.submit(_task, self._number, payload, stage, key, call, key=call, pure=False)

    def answer(self, handle: Future) -> Answer | Unfit:
        """Return what has come of an evaluation that has ended.

        Raises
        ------
        WorkerDied : its worker ended
        WorkersLost : the scheduler is gone
        """
        try:
            return handle.result()
        except asyncio.CancelledError as error:  # those of Dask are of this class too
            raise self._lost() from error
        except Exception as error:
            self.check()
            raise WorkerDied(f"{type(error).__name__}: {error}") from error

    def check(self) -> None:
        """Look whether the scheduler is connected.

        Raises
        ------
        WorkersLost : it is not
        """
        if self._client.status != "running":
            raise self._lost()

    def _lost(self) -> WorkersLost:
        return WorkersLost(f"the connection to the Dask scheduler at {self.place} is lost")

    def send_away(self, worker: str) -> bool:
        """Retire a worker."""
        with suppress(*UNREACHABLE):
            self._client.retire_workers(workers=[worker], close_workers=True)
        return True

    def abandon(self, handles: list[Future]) -> None:
        """Kill evaluations that are under way, on every worker."""
        with suppress(*UNREACHABLE):
            if self._client.status == "running":
                self._client.cancel(handles, force=True)
                self._client.run(_stopped, self._number, on_error="ignore")

    def close(self) -> None:
        """Have the workers forget the pool, and disconnect."""
        with suppress(*UNREACHABLE):
            if self._number and self._client.status == "running":
                self._client.unregister_worker_plugin(self._number)
        with suppress(*UNREACHABLE):
            self._client.close()


def _end(cluster: Any) -> None:
    cluster.close()


# ---- on a worker


class _PoolPlugin(WorkerPlugin):
    """Tells every worker of a pool, and has it forget the pool at the end."""

    def __init__(self, setup: PoolSetup):
        self._setup = setup

    def setup(self, worker: Worker) -> None:
        """Take up the pool."""
        add_pool(self._setup)

    def teardown(self, worker: Worker) -> None:
        """Forget the pool; its evaluations are killed."""
        remove_pool(self._setup.number)


async def _prepared(number: str, dask_worker: Worker) -> WorkerState | Unfit:
    """What a worker says of itself; in a thread, as its event loop has to go on."""
    try:
        prepared = await asyncio.to_thread(pool_of(number).prepare)
    except (HostGone, OSError) as error:
        return Unfit(dask_worker.address, (f"no evaluation can be started: {error}",))
    return Unfit(dask_worker.address, prepared.differences) if prepared.differences else prepared


async def _stopped(number: str) -> None:
    await asyncio.to_thread(stop_calls, number)


def _task(number: str, payload: bytes, stage: str, key: str | None, call: str) -> Answer | Unfit:
    return evaluated(number, payload, stage, key, call, get_worker().address)
