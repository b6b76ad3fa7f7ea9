"""The process that evaluates for a worker: it has the child processes, and ends with the worker.

A worker may be a process that may have no child processes of its own (those of Dask are daemonic), or one whose
interpreter does other work: so it starts this program and talks to it through a pair of sockets.
"""

import os
import queue
import sys
import threading
import time
from multiprocessing.connection import Connection
from pathlib import Path

from calib.errors import CalibError
from calib.execution.pool import Failure
from calib.execution.pools.identity import differences, identity, processor
from calib.execution.pools.memory import MemoryWatch
from calib.execution.pools.results import keep, kept
from calib.execution.pools.setup import STOPPED, PoolSetup, WorkerState
from calib.execution.pools.slot import Slot
from calib.execution.pools.starting import start_server

IDLE_SECONDS = 60.0  # s without a call, after which the program ends; the next call starts it anew
MARKER_INTERVAL = 1.0  # s between two looks whether the pool is still there
Request = tuple[int, bytes, str, str | None]  # number, pickled payload, stage, key of its result


class Host:
    """Evaluates for one worker, as many calls side by side as it is given."""

    def __init__(self, connection: Connection, setup: PoolSetup):
        self._connection, self._setup = connection, setup
        self._sending = threading.Lock()
        self._idle: queue.LifoQueue[Slot] = queue.LifoQueue()
        self._allowances = setup.limits.allowances()
        self._watch = None if setup.limits.memory is None else MemoryWatch(setup.limits.memory)
        self._busy: set[threading.Thread] = set()
        self.prepared = _prepared(setup)
        self._folder = setup.folder if self.prepared.shares_folder else None

    def serve(self) -> None:
        """Answer requests until the worker is gone, or has asked for nothing in a while."""
        self._connection.send(self.prepared)
        if self._folder is not None:
            marker = self._folder / self._setup.number
            threading.Thread(target=_end_without, args=(marker,), daemon=True, name="marker").start()
        start_server(self._setup.function.importable)
        while self._connection.poll(IDLE_SECONDS) or any(thread.is_alive() for thread in self._busy):
            if not self._connection.poll(0.0):
                continue
            request: Request = self._connection.recv()
            self._busy = {thread for thread in self._busy if thread.is_alive()}
            thread = threading.Thread(target=self._reply, args=request, daemon=True)
            self._busy.add(thread)
            thread.start()

    def _reply(self, number: int, payload: bytes, stage: str, key: str | None) -> None:
        result: bytes | Failure | CalibError
        try:
            result = self._result(payload, stage, key)
        except CalibError as error:  # the processes cannot be started
            result = error
        with self._sending:
            self._connection.send((number, result))

    def _result(self, payload: bytes, stage: str, key: str | None) -> bytes | Failure:
        if key is not None and self._folder is not None and (known := kept(self._folder, key)) is not None:
            return known
        try:
            slot = self._idle.get_nowait()
        except queue.Empty:
            slot = Slot(self._setup.function, self._setup.limits, self._allowances)
            if self._watch is not None:
                self._watch.add(slot)
        try:
            result = slot.answer(payload, stage)
        finally:
            self._idle.put(slot)
        if key is not None and self._folder is not None and isinstance(result, bytes):
            keep(self._folder, key, result)
        return result


def _prepared(setup: PoolSetup) -> WorkerState:
    sys.path.extend(folder for folder in setup.path if folder not in sys.path)
    differing = differences(setup.identity, identity(setup.identity))
    shared = setup.folder is not None and (setup.folder / setup.number).is_file()
    return WorkerState(tuple(differing), shared, processor())


def _end_without(marker: Path) -> None:
    """End this program, with all that it has started, when a pool has taken its file away."""
    while _there(marker):
        time.sleep(MARKER_INTERVAL)
    os._exit(STOPPED)


def _there(marker: Path) -> bool:
    try:
        marker.stat()
    except FileNotFoundError:
        return False
    except OSError:  # a disk of the network that does not answer takes nothing away
        return True
    return True


def main(descriptor: int) -> None:
    """Serve the worker at the other end of a socket; end at once, with all that was started, when it is gone."""
    os.set_inheritable(descriptor, False)
    connection = Connection(descriptor)
    try:
        Host(connection, connection.recv()).serve()
    except (EOFError, OSError):
        pass  # the worker has ended
    finally:
        os._exit(0)  # child processes end with this one; threads that wait for them do not hold it


if __name__ == "__main__":
    main(int(sys.argv[1]))
