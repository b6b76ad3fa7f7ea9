"""Programs that end with all that they have started, however they or their starter end."""

import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from calib.execution import guardian

FIRST_LOOK, LAST_LOOK = 0.005, 0.25  # s, between two looks at a program: at first and in the long run
LOOK_GROWTH = 1.3  # from one look to the next  [1]
ANSWER_BYTES = 2000  # of what a guardian reports, at most
RUN_MARK = "CALIB_RUN"  # variable by which the processes of a run are known should its guardian be killed
GONE = "its guardian was killed"


@dataclass(frozen=True)
class ProgramEnd:
    """How a program ended.

    Attributes
    ----------
    code : exit code; None where it was ended by a signal, given up, or could not be executed
    reason : one sentence; empty for the exit code 0
    seconds : wall-clock time  [s]
    """

    code: int | None
    reason: str
    seconds: float


def run_guarded(
    words: Sequence[str],
    folder: Path,
    log: IO[bytes],
    environment: Mapping[str, str],
    mark: str,
    watch: Callable[[], str] = lambda: "",
    held: Sequence[int] = (),
) -> ProgramEnd:
    """Run a program to its end, in the process group of this process.

    A guardian process ends it, and all processes that it has started, where it ends, where `watch` says so, and where
    this process ends, even by SIGKILL to it or its whole group.

    Parameters
    ----------
    words : name of the program and its arguments; no shell sees them
    folder : in which it runs
    log : for all that it prints
    environment : of the program
    mark : a random text by which its processes are known, should the guardian be killed
    watch : called from time to time; a text says why the program is to be given up
    held : descriptors that the guardian holds open until all has ended

    Raises
    ------
    OSError : no process can be started
    """
    begin = time.monotonic()
    alive, life = os.pipe2(os.O_CLOEXEC)  # the guardian reads until this process closes its end
    answers, report = os.pipe2(os.O_CLOEXEC)
    try:
        numbers = [str(number) for number in (alive, report, log.fileno(), os.getpgrp())]
        process = subprocess.Popen(
            [sys.executable, "-I", "-S", guardian.__file__, *numbers, str(folder), *words],
            stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=log,
            pass_fds=(alive, report, log.fileno(), *held),
        )  # fmt: skip
    except BaseException:
        for descriptor in (alive, life, answers, report):
            os.close(descriptor)
        raise
    os.close(alive)
    os.close(report)
    given_up = ""
    try:
        _give(process, {**environment, RUN_MARK: mark})
        given_up = _watched(answers, watch)
    finally:
        os.close(life)
        answer = _answer(answers)
        os.close(answers)
        if process.wait():
            end_marked(mark)
    return _end(answer, given_up, time.monotonic() - begin)


def _give(process: "subprocess.Popen[bytes]", environment: Mapping[str, str]) -> None:
    """Write the environment of the program to its guardian."""
    if process.stdin is not None:
        with suppress(BrokenPipeError), process.stdin as stdin:
            stdin.write(b"\0".join(os.fsencode(f"{name}={value}") for name, value in environment.items()))


def _watched(answers: int, watch: Callable[[], str]) -> str:
    """Wait for the guardian's answer; return why the program is to be given up before, or an empty text."""
    pause = FIRST_LOOK
    while not select.select([answers], [], [], pause)[0]:
        if given_up := watch():
            return given_up
        pause = min(LOOK_GROWTH * pause, LAST_LOOK)
    return ""


def _answer(answers: int) -> str:
    text = b""
    with suppress(OSError):
        while part := os.read(answers, ANSWER_BYTES):
            text += part
    return text.decode(errors="replace")


def _end(answer: str, given_up: str, seconds: float) -> ProgramEnd:
    kind, _, rest = answer.partition(" ")
    if given_up:
        return ProgramEnd(None, given_up, seconds)
    if kind == "exit":
        code = int(rest)
        return ProgramEnd(code, f"it ended with exit code {code}" if code else "", seconds)
    if kind == "signal":
        return ProgramEnd(None, f"it was ended by signal {rest}", seconds)
    if kind == "missing":
        return ProgramEnd(None, f"it cannot be executed: {rest}", seconds)
    return ProgramEnd(None, GONE, seconds)


def end_marked(mark: str) -> None:
    """End all processes of this user whose environment holds the mark of a run."""
    entry = f"{RUN_MARK}={mark}".encode()
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if int(folder.name) != os.getpid() and entry in (folder / "environ").read_bytes().split(b"\0"):
                os.kill(int(folder.name), signal.SIGKILL)
