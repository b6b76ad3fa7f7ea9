"""One run of a program: when it is given up, and what its log says."""

import math
import os
import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from calib.execution.deadline import remaining, timeout
from calib.execution.guarded import LAST_LOOK, ProgramEnd, run_guarded
from calib.execution.suspension import SuspensionClock
from calib.simulators.command.run_folder import RunFolder

LOG = "calib.log"  # file of the run folder with all that the program prints
MAX_LOG_BYTES = 256 * 2**20  # of the log, after which a run is given up
PIECE_BYTES = 1 << 20  # of the log that is searched at once
OVERLAP_CHARACTERS = 1000  # that two pieces share, so that a text across their border is found
TAIL_BYTES, TAIL_LINES = 4000, 4  # of the end of a log that a failed run states
TAIL_CHARACTERS = 220  # of these lines together
MAX_MARGIN_S, MARGIN_SHARE = 0.5, 0.1  # s, [1]: a run is given up so long before its trial is, to say why
FAILED, INACTIVE, TIMEOUT = "program failed", "inactive", "timeout"  # statuses of a run


@dataclass
class Watch:
    """Looks at a run that goes on, and says when it is to be given up.

    Time in which this process was suspended, and the program with it, does not count.

    Attributes
    ----------
    log, folder : file of what is printed, folder of the run
    patterns : of which the log must match none
    inactivity : time without output after which a run is given up  [s]
    status : of the run that is given up
    """

    log: Path
    folder: Path
    patterns: Sequence[re.Pattern[str]]
    inactivity: float
    status: str = ""
    _searched: int = 0
    _text: str = ""
    _size: int = -1
    _begin: float = 0.0
    _clock: SuspensionClock = field(default_factory=lambda: SuspensionClock(time.monotonic, LAST_LOOK))
    _active: float = 0.0
    _limit: float = 0.0

    def __post_init__(self) -> None:
        """Begin to watch."""
        self._begin = self._active = time.monotonic()
        self._limit = remaining(self._begin)

    def __call__(self) -> str:
        """Return why the run is to be given up; empty where it is not."""
        try:
            return self._looked(self._clock.look())
        finally:
            self._clock.forget()  # what the look itself has taken

    def _looked(self, suspended: float) -> str:
        if text := self.matched():
            return self._given_up(FAILED, text)
        if self._searched > MAX_LOG_BYTES:
            return self._given_up(FAILED, f"it printed more than {MAX_LOG_BYTES / 2**20:g} MiB")
        if remaining(self._begin, suspended) < min(MAX_MARGIN_S, MARGIN_SHARE * self._limit):
            return self._given_up(TIMEOUT, f"no result within {timeout():g} s of wall-clock time")
        if self.inactivity < math.inf:
            size, now = _bytes_below(self.folder), time.monotonic() - suspended
            if size != self._size:
                self._size, self._active = size, now
            elif now - self._active > self.inactivity:
                return self._given_up(INACTIVE, f"no output for {self.inactivity:g} s")
        return ""

    def _given_up(self, status: str, reason: str) -> str:
        self.status = status
        return reason

    def matched(self) -> str:
        """Return what is wrong with what was printed since the last look; empty where nothing is."""
        with open(self.log, "rb") as file:
            file.seek(self._searched)
            while piece := file.read(PIECE_BYTES):
                self._searched += len(piece)
                self._text = self._text[-OVERLAP_CHARACTERS:] + piece.decode(errors="replace")
                for pattern in self.patterns:
                    if match := pattern.search(self._text):
                        return f"it printed {match[0][:80]!r} (fail_if)"
                if self._searched > MAX_LOG_BYTES:
                    break
        return ""


@dataclass(frozen=True)
class RungEnd:
    """How one command line ended.

    Attributes
    ----------
    status : "" where its output can be read
    reason : of another status
    seconds : wall-clock time  [s]
    """

    status: str
    reason: str
    seconds: float


def run_rung(
    words: Sequence[str],
    folder: RunFolder,
    environment: Mapping[str, str],
    patterns: Sequence[re.Pattern[str]],
    inactivity: float,
) -> RungEnd:
    """Run one command line in a run folder to its end, or until it is given up."""
    log = folder.path / LOG
    with open(log, "wb") as file:
        watch = Watch(log, folder.path, patterns, inactivity)
        end = run_guarded(words, folder.path, file, environment, folder.mark, watch, held=(folder.lock,))
    return _judged(end, watch)


def _judged(end: ProgramEnd, watch: Watch) -> RungEnd:
    if watch.status:
        return RungEnd(watch.status, end.reason, end.seconds)
    if end.code != 0:
        return RungEnd(FAILED, end.reason, end.seconds)
    matched = watch.matched()
    return RungEnd(FAILED if matched else "", matched, end.seconds)


def log_tail(log: Path) -> str:
    """Return the last lines of a log, in one."""
    try:
        with open(log, "rb") as file:
            file.seek(max(0, os.fstat(file.fileno()).st_size - TAIL_BYTES))
            text = file.read().decode(errors="replace")
    except OSError:
        return ""
    lines = [" ".join(line.split()) for line in text.splitlines()]
    return " | ".join([line for line in lines if line][-TAIL_LINES:])[-TAIL_CHARACTERS:]


def _bytes_below(folder: Path) -> int:
    """Bytes in all files below a folder, and their number."""
    total = 0
    for path, _, names in os.walk(folder):
        for name in names:
            try:
                total += 1 + os.stat(os.path.join(path, name), follow_symlinks=False).st_size
            except OSError:
                continue
    return total
