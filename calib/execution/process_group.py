"""The process group of a worker process, which ends with the worker."""

import fcntl
import os
import signal
from contextlib import suppress


def lead_process_group() -> None:
    """Make this process the leader of a process group whose members are all killed when it ends, however it ends.

    Programs that this process starts are members, and so is what they start. One that makes a session or group of its
    own (setsid, setpgid) is not: it asked to outlive its starter. The session is new too, so that Ctrl-C in the
    terminal reaches no member.

    The guardian that kills them is a member itself, so that the number of the group cannot pass to another one. It is
    no child of this process: functions that wait for or end all children do not meet it. It waits for a record lock,
    which the kernel releases when this process ends, and which forked processes do not inherit.
    """
    os.setsid()
    lock = os.memfd_create("alive")
    fcntl.lockf(lock, fcntl.LOCK_EX)
    child = os.fork()
    if child == 0:
        try:
            if os.fork() == 0:
                _guard(lock)
        finally:
            os._exit(0)
    os.waitpid(child, 0)


def _guard(lock: int) -> None:
    """Kill the process group of this process, itself included, when the process that holds the lock has ended."""
    signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())  # of those sent to the group
    for name in os.listdir("/proc/self/fd"):
        if int(name) != lock:
            with suppress(OSError):  # that of the listing is closed already
                os.close(int(name))
    os.chdir("/")
    fcntl.lockf(lock, fcntl.LOCK_EX)
    os.killpg(0, signal.SIGKILL)
