"""What a child process does: it calls a function that it was sent."""

import fcntl
import importlib
import os
import pickle
import signal
import sys
import time
from ctypes import c_byte
from multiprocessing import parent_process
from multiprocessing.connection import Connection
from typing import Any

from calib.errors import CodeChanged
from calib.execution.deadline import within
from calib.execution.pool import failure
from calib.execution.process_group import lead_process_group

_function: Any = None
_compiling: c_byte | None = None


def prepare(function: bytes, numbers: Connection | None, compiling: c_byte) -> None:
    """Set up a new worker of one thread, that ends with its parent or when asked to, with all that it has started.

    Its number, which is that of its process group, goes to `numbers` where it is asked for. `compiling` is 1 while
    kernels are compiled.
    """
    global _function, _compiling
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # pebble's handler would wait for the interpreter, which may hang
    lead_process_group()
    _die_with_parent()
    os.environ["NUMBA_NUM_THREADS"] = "1"
    _function, _compiling = function, compiling
    if numbers is not None:
        numbers.send(os.getpid())


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


def call(payload: bytes, limit: float | None, timeout: float | None) -> bytes:
    """Pickled result or Failure of the function at a pickled payload; see `calib.execution.deadline` for its limits.

    Raises
    ------
    CodeChanged : as the function
    """
    global _function
    start = time.perf_counter()
    try:
        if isinstance(_function, bytes):
            _function = pickle.loads(_function)
            if "numba" in sys.modules:
                importlib.import_module("calib.execution.pools.compilation").watch(_compiling)
        with within(limit, timeout):
            return pickle.dumps(_function(pickle.loads(payload)))
    except CodeChanged:  # concerns all calls, not this one
        raise
    except Exception as error:  # a failed evaluation is data
        return pickle.dumps(failure(error, time.perf_counter() - start))
