"""Functions that the pool's tests send to child processes."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from marked_processes import MARK

from calib.errors import CalibError

GIGABYTE = 1_000_000_000


def square(x):
    return x * x


def slow_square(x):
    time.sleep(x)
    return x * x


def process(_):
    return os.getpid()


def misbehave(how):
    if how == "raise":
        raise ValueError("the beam is too long")
    if how == "raise in a library":
        np.linalg.solve(np.zeros((2, 2)), np.ones(2))
    if how == "raise at length":
        raise OverflowError("a beam too long, " * 100)
    if how == "interrupt":
        raise KeyboardInterrupt
    if how == "quit":
        sys.exit(3)
    if how == "refuse":
        raise CalibError("unknown parameter 'alhpa'")
    if how == "exit":
        os._exit(7)
    if how == "segfault":
        os.kill(os.getpid(), signal.SIGSEGV)
    if how == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    if how == "hang":
        time.sleep(1000)
    if how == "hang with a deaf interpreter":
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        time.sleep(1000)
    if how == "hoard":
        hoarded = b"1" * GIGABYTE
        time.sleep(1000 + len(hoarded))
    if how == "let a program hoard":
        subprocess.run([sys.executable, "-c", f"import time; a = b'1' * {GIGABYTE}; time.sleep(1000)"])
    if how == "unpicklable":
        return lambda: None
    return how


def solve(case):
    """Start a program and one that starts another, write that they run, and end as `how` says."""
    file, mark, how = case
    environment = {**os.environ, MARK: mark}
    subprocess.Popen(["sleep", "600"], env=environment)
    shell = subprocess.Popen(["sh", "-c", "sleep 600 & echo; wait"], env=environment, stdout=subprocess.PIPE)
    shell.stdout.readline()
    Path(file).write_text(str(os.getpid()))
    if how == "hang":
        shell.wait()
    return misbehave(how)


def child(_):
    try:
        return os.waitpid(-1, os.WNOHANG)
    except ChildProcessError:
        return "none"


def threads(_):
    return {name: os.environ.get(name) for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")}


def open_files(_):
    return [os.readlink(f"/proc/self/fd/{fd}") for fd in os.listdir("/proc/self/fd") if _exists(fd)]


def _exists(fd):
    return os.path.lexists(f"/proc/self/fd/{fd}")


class NotUnpicklable:
    """Pickles well, but fails when it is unpickled in the child."""

    def __reduce__(self):
        return (_fail, ())

    def __call__(self, x):
        return x


def _fail():
    raise ImportError("no module named 'somewhere_else'")


def hang_at_first(case):
    """Hang so many times, counted in a file; then answer."""
    file, times = case
    with open(file, "a") as calls:
        calls.write(".")
    if Path(file).stat().st_size <= times:
        time.sleep(1000)
    return "done"
