"""A Dask scheduler and workers as processes of their own, as on a few machines; they end with the block."""

import os
import signal
import socket
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

from child_environment import environment
from marked_processes import MARK, new_mark, survivors

PATIENCE = 60.0  # s


class DaskProcesses:
    """A scheduler on a port of its own, and workers of one thread unless asked otherwise."""

    def __init__(self, folder: Path, port: int = 0):
        self.folder, self.mark, self.workers = folder, new_mark(), []
        self.folder.mkdir(exist_ok=True)
        self.file, self.port, self.count = folder / "scheduler.json", port, 0
        self.scheduler = self._started("scheduler")

    @property
    def address(self) -> str:
        self._wait_for(self.file.exists)
        return f"tcp://127.0.0.1:{self.port}"

    def _started(self, what: str, *options: str, **variables: str) -> subprocess.Popen:
        if what == "scheduler":
            if not self.port:
                self.port = _free_port()
            options = ("--host", "127.0.0.1", "--port", str(self.port), "--scheduler-file", str(self.file), *options)
        self.count += 1
        with open(self.folder / f"{what}-{self.count}.log", "wb") as log:
            return subprocess.Popen(
                [sys.executable, "-m", "distributed.cli.dask_scheduler" if what == "scheduler" else _WORKER, *options,
                 "--no-dashboard"],
                env={**environment(), MARK: self.mark, **variables}, stdout=log, stderr=log, start_new_session=True,
            )  # fmt: skip

    def add_worker(self, threads: int = 1, **variables: str) -> subprocess.Popen:
        self._wait_for(self.file.exists)
        local = self.folder / f"worker-{self.count}"
        worker = self._started(
            "worker", self.address, "--nthreads", str(threads), "--nworkers", "1", "--memory-limit", "0",
            "--local-directory", str(local), "--death-timeout", "30", **variables,
        )  # fmt: skip
        self.workers.append(worker)
        log = self.folder / f"worker-{self.count}.log"
        self._wait_for(lambda: b"Registered to" in log.read_bytes() or worker.poll() is not None)
        return worker

    def kill_worker(self, worker: subprocess.Popen) -> None:
        """Kill the worker and its nanny."""
        self.workers.remove(worker)
        _kill(worker)

    def kill_scheduler(self) -> None:
        _kill(self.scheduler)
        self.file.unlink(missing_ok=True)

    def restart(self) -> None:
        """Begin a scheduler anew on the same port; the workers of the old one go."""
        for worker in self.workers:
            _kill(worker)
        self.workers = []
        self.scheduler = self._started("scheduler")

    def _wait_for(self, condition) -> None:
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < deadline, f"see the logs in {self.folder}"
            time.sleep(0.05)

    def __enter__(self) -> "DaskProcesses":
        return self

    def __exit__(self, *exception: object) -> None:
        for process in (*self.workers, self.scheduler):
            _kill(process)
        assert not survivors(self.mark), "processes outlived the workers that started them"


_WORKER = "distributed.cli.dask_worker"


def _kill(process: subprocess.Popen) -> None:
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]
