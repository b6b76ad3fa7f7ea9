"""Runs one program, and ends all that it has started when it ends, is given up, or its starter is gone.

This file is executed by itself, with nothing but the standard library, so that it starts in some hundredths of a
second: see `calib.execution.guarded`.
"""

import ctypes
import os
import select
import signal
import sys
import time
from contextlib import suppress

PR_SET_PDEATHSIG, PR_SET_CHILD_SUBREAPER = 1, 36  # of prctl(2)
MISSING_PROGRAM = 127  # exit code of a program that cannot be executed, as a shell has it
PATIENCE_S = 30.0  # s, for descendants to end: another user's cannot be killed
FIRST_PAUSE_S, LAST_PAUSE_S = 0.001, 0.1  # s, between two rounds of killing, doubled from one to the next


def main(life: int, report: int, log: int, group: int, folder: bytes, words: list[bytes]) -> None:
    """Run a program, and write how it ended: "exit N", "signal N" or "missing REASON".

    This process adopts all descendants of the program, those in sessions of their own too, because it is their
    "subreaper", and is in a process group of its own, so that a signal to its starter's group leaves it to end them.

    Parameters
    ----------
    life : descriptor of a pipe that its starter closes to give the program up, and the kernel when the starter ends
    report : descriptor to write to
    log : descriptor of the file for all that the program prints
    group : process group of the program
    folder, words : in which it runs; its name and arguments

    Its environment is read from the standard input, since what is meant for the program need not suit this one.
    """
    with open(0, "rb", closefd=False) as given:
        environment = dict(entry.split(b"=", 1) for entry in given.read().split(b"\0") if entry)
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT})
    os.setpgid(0, 0)
    for name in os.listdir("/proc/self/fd"):
        with suppress(OSError):  # that of the listing is closed already
            os.set_inheritable(int(name), int(name) <= 2)
    prctl = ctypes.CDLL(None).prctl
    prctl(PR_SET_CHILD_SUBREAPER, 1)
    failure, failed = os.pipe2(os.O_CLOEXEC)
    program = os.fork()
    if program == 0:
        _become(prctl, failed, log, group, folder, words, environment)
    os.close(failed)
    os.close(log)
    reason = os.read(failure, 1000)
    status = _wait(program, life)
    end_descendants()
    if reason:
        answer = b"missing " + reason
    elif status is None:
        answer = b"given up"
    else:
        code = os.waitstatus_to_exitcode(status)
        answer = f"exit {code}".encode() if code >= 0 else f"signal {-code}".encode()
    with suppress(OSError):  # the starter is gone
        os.write(report, answer)


def _become(
    prctl: "ctypes._FuncPointer",
    failed: int,
    log: int,
    group: int,
    folder: bytes,
    words: list[bytes],
    environment: dict[bytes, bytes],
) -> None:
    """Become the program; where that fails, write why."""
    try:
        prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        for number in (signal.SIGPIPE, signal.SIGXFSZ):  # which Python ignores
            signal.signal(number, signal.SIG_DFL)
        os.setpgid(0, group)
        os.chdir(folder)
        nothing = os.open(os.devnull, os.O_RDONLY)
        os.dup2(nothing, 0)
        os.dup2(log, 1)
        os.dup2(log, 2)
        signal.pthread_sigmask(signal.SIG_SETMASK, set())
        os.execvpe(words[0], words, environment)
    except OSError as error:
        os.write(failed, (error.strerror or "cannot be executed").encode())
    finally:
        os._exit(MISSING_PROGRAM)


def _wait(program: int, life: int) -> int | None:
    """Status of the program when it has ended; None where it is to be given up before."""
    handle = os.pidfd_open(program)
    poll = select.poll()
    for descriptor in (handle, life):
        poll.register(descriptor, select.POLLIN | select.POLLHUP)
    ready = [descriptor for descriptor, _ in poll.poll()]
    if handle not in ready:
        return None
    return os.waitpid(program, 0)[1]


def end_descendants() -> None:
    """End all descendants of this process, those too that they start meanwhile, and wait until there are none."""
    pause, limit = FIRST_PAUSE_S, time.monotonic() + PATIENCE_S
    while time.monotonic() < limit:
        try:
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
        except ChildProcessError:
            return
        for pid in descendants(os.getpid()):
            with suppress(OSError):
                os.kill(pid, signal.SIGKILL)
        time.sleep(pause)
        pause = min(2.0 * pause, LAST_PAUSE_S)


def descendants(root: int) -> list[int]:
    """Processes that a process has started, and those that these have."""
    children: dict[int, list[int]] = {}
    for name in os.listdir("/proc"):
        if name.isdigit():
            with suppress(OSError, ValueError, IndexError):
                with open(f"/proc/{name}/stat", "rb") as file:
                    parent = int(file.read().rpartition(b")")[2].split()[1])
                children.setdefault(parent, []).append(int(name))
    found, todo = list[int](), [root]
    while todo:
        own = children.get(todo.pop(), [])
        found += own
        todo += own
    return found


if __name__ == "__main__":
    descriptors = [int(word) for word in sys.argv[1:5]]
    texts = [os.fsencode(word) for word in sys.argv[5:]]
    main(descriptors[0], descriptors[1], descriptors[2], descriptors[3], texts[0], texts[1:])
