"""How child processes are started: by a fork server of one thread, without the script."""

import os
import threading
from collections.abc import Callable
from functools import partial
from multiprocessing import resource_tracker, spawn
from multiprocessing.context import ForkServerContext, ForkServerProcess
from multiprocessing.forkserver import ensure_running, set_forkserver_preload
from multiprocessing.util import get_temp_dir
from typing import Any

from calib.execution.interrupt import uninterrupted
from calib.execution.pools import server_end
from calib.execution.pools.server_end import FOLDER_VARIABLE

THREAD_VARIABLES = (  # of the environment: number of threads of a BLAS
    "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS",
)  # fmt: skip
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


class WithoutMain(ForkServerContext):
    """Starts processes that do not import the script: it needs no guard, and may be no file at all."""

    Process = _ProcessWithoutMain


def start_server(modules: list[str]) -> None:
    """Start the fork server, if there is none yet, with `modules` imported and one thread for BLAS."""
    with _starting:
        before = {name: os.environ.get(name) for name in (*THREAD_VARIABLES, FOLDER_VARIABLE)}
        os.environ.update({**dict.fromkeys(THREAD_VARIABLES, "1"), FOLDER_VARIABLE: get_temp_dir()})
        set_forkserver_preload([server_end.__name__, *modules])
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
