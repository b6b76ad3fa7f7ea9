"""What a worker of another program does: it has a host evaluate, and hands back what that answers."""

import itertools
import os
import platform
import socket
import subprocess
import sys
import threading
from concurrent.futures import Future
from multiprocessing.connection import Connection

from calib.errors import CalibError
from calib.execution.pool import CRASHED, Failure
from calib.execution.pools.setup import STOPPED, Answer, PoolSetup, Unfit, WorkerState

QUIET = "ignore:resource_tracker"  # it would complain of a host that ends with its worker, at once
MAX_STARTS = 2  # of the host, for one call
_hosted: dict[str, "Hosted"] = {}  # number of a pool -> its evaluations in this process
_adding = threading.Lock()


class HostGone(Exception):
    """The program that evaluates has ended; its exit code where it is known."""


class Hosted:
    """The evaluations of one pool in this process; thread-safe.

    The program that makes them starts when it is needed.
    """

    def __init__(self, setup: PoolSetup):
        self._setup = setup
        self._starting = threading.Lock()
        self._program: _Program | None = None

    def prepare(self) -> WorkerState:
        """Start the program, if it does not run; return what it says of itself.

        Raises
        ------
        HostGone : it does not start
        """
        return self._running().prepared

    def call(self, payload: bytes, stage: str, key: str | None) -> bytes | Failure:
        """Evaluate a pickled payload; return the pickled result, or why there is none.

        Raises
        ------
        CalibError : child processes cannot be started
        """
        for _ in range(MAX_STARTS):
            program = self._running()
            try:
                return program.call(payload, stage, key)
            except HostGone as gone:  # it ended for want of work as the call came, or was killed
                reason = str(gone)
                if program.stopped:
                    return Failure(CRASHED, "the evaluations were stopped", 0.0)
        return Failure(CRASHED, f"the program that evaluates for a worker ended {MAX_STARTS} times: {reason}", 0.0)

    def close(self) -> None:
        """End the program with all that it has started; calls under way come back as failures."""
        with self._starting:
            if self._program is not None:
                self._program.close()
                self._program = None

    def _running(self) -> "_Program":
        with self._starting:
            if self._program is None or not self._program.alive:
                self._program = _Program(self._setup)
            return self._program


class _Program:
    """The program that evaluates, while it runs."""

    def __init__(self, setup: PoolSetup):
        own, other = socket.socketpair()
        with other:
            os.set_inheritable(other.fileno(), True)
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-W", QUIET, "-m", "calib.execution.pools.host", str(other.fileno())],
                pass_fds=[other.fileno()], stdin=subprocess.DEVNULL, start_new_session=True,
            )  # fmt: skip
        self._connection = Connection(own.detach())
        self._sending, self._numbers = threading.Lock(), itertools.count()
        self._calls: dict[int, Future[bytes | Failure]] = {}
        self.alive, self.stopped = True, False
        try:
            self._connection.send(setup)
            self.prepared: WorkerState = self._connection.recv()
        except (EOFError, OSError) as error:
            self.close()
            self._connection.close()
            raise HostGone(f"it did not start (exit code {self._process.returncode})") from error
        threading.Thread(target=self._receive, daemon=True, name="host").start()

    def call(self, payload: bytes, stage: str, key: str | None) -> bytes | Failure:
        answer: Future[bytes | Failure] = Future()
        with self._sending:
            number = next(self._numbers)
            self._calls[number] = answer
            try:
                if not self.alive:
                    raise OSError
                self._connection.send((number, payload, stage, key))
            except OSError as error:
                raise HostGone("it ended before the call") from error
        return answer.result()

    def _receive(self) -> None:
        try:
            while True:
                number, result = self._connection.recv()
                answer = self._calls.pop(number)
                if isinstance(result, CalibError):
                    answer.set_exception(result)
                else:
                    answer.set_result(result)
        except (EOFError, OSError):
            with self._sending:
                self.alive = False
                waiting, self._calls = self._calls, {}
            code = self._process.wait()
            self.stopped |= code == STOPPED
            self._connection.close()
            for answer in waiting.values():
                answer.set_exception(HostGone(f"exit code {code}"))

    def close(self) -> None:
        self.stopped = True
        self._process.kill()  # child processes end with it
        self._process.wait()


def add_pool(setup: PoolSetup) -> Hosted:
    """Return the evaluations of a pool in this process, made where they are new."""
    with _adding:
        if setup.number not in _hosted:
            _hosted[setup.number] = Hosted(setup)
        return _hosted[setup.number]


def pool_of(number: str) -> Hosted:
    """Return the evaluations of a pool that this process knows."""
    with _adding:
        return _hosted[number]


def remove_pool(number: str) -> None:
    """End the evaluations of a pool in this process."""
    with _adding:
        hosted = _hosted.pop(number, None)
    if hosted is not None:
        hosted.close()


def stop_calls(number: str) -> None:
    """Kill the evaluations of a pool that are under way in this process."""
    with _adding:
        hosted = _hosted.get(number)
    if hosted is not None:
        hosted.close()


def evaluated(
    setup: PoolSetup | str, payload: bytes, stage: str, key: str | None, call: str, worker: str = ""
) -> Answer | Unfit:
    """Evaluate a pickled payload for a pool: what runs on a worker.

    Parameters
    ----------
    setup : of the pool, or its number where this process knows it
    stage : see `calib.execution.pools.local.LocalPool.map`
    key : under which the result is kept
    call : name of this call: a worker that answers equal calls from a cache has none of these
    worker : name of the worker; else that of this process
    """
    worker = worker or f"{platform.node()}, process {os.getpid()}"
    hosted = pool_of(setup) if isinstance(setup, str) else add_pool(setup)
    try:
        prepared = hosted.prepare()
        if prepared.differences:
            return Unfit(worker, prepared.differences)
        return Answer(hosted.call(payload, stage, key), worker, prepared)
    except (HostGone, CalibError, OSError) as error:
        return Unfit(worker, (f"no evaluation can be started: {error}",))
