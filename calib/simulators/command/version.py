"""The version of a program, as a command line prints it."""

import shlex
import subprocess
from dataclasses import dataclass

from calib.errors import CalibError

VERSION_TIMEOUT_S = 30.0  # s, for the command line that gives the version
MAX_VERSION_BYTES = 400  # of what it prints


@dataclass(frozen=True)
class ProgramVersion:
    """A command line that prints the version of a program.

    Attributes
    ----------
    line : as the study states it
    words : of it, with an absolute path where it states a relative one
    """

    line: str
    words: tuple[str, ...]

    def printed(self) -> str:
        """Return what it prints, in one line.

        Raises
        ------
        CalibError : it cannot be executed, takes too long, or prints nothing
        """
        try:
            done = subprocess.run(
                self.words, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False,
                timeout=VERSION_TIMEOUT_S,
            )  # fmt: skip
        except (OSError, subprocess.TimeoutExpired) as error:
            raise CalibError(f"version: {self.line!r} gives no version ({error}); mend it, or leave it out") from error
        text = " ".join(done.stdout[:MAX_VERSION_BYTES].decode(errors="replace").split())
        if not text:
            raise CalibError(f"version: {self.line!r} prints nothing; mend it, or leave it out")
        return text


def stated_version(line: str, study: str) -> ProgramVersion:
    """Return a command line, whose program is relative to the folder of the `study` where it states a relative path."""
    words = shlex.split(line)
    if "/" in words[0] and not words[0].startswith("/"):
        words[0] = f"{study}/{words[0]}"
    return ProgramVersion(line, tuple(words))
