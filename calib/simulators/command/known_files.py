"""Files that decide records, compared with what they were when the study was read."""

import os
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

from calib.errors import CalibError, CodeChanged
from calib.execution.files import checksum
from calib.simulators.command.version import ProgramVersion

Stamp = tuple[int, int, int, int]  # inode, size [byte], times of change of content and of inode [ns]
SHOWN_CHARACTERS = 20  # of an identity in a message
AGAIN = (
    "start again: what has ended is kept, and counts as long as all files are those that it was made with; the runs "
    "under way are not"
)
_same: dict[tuple[str, str], Stamp] = {}  # path and identity -> last stamp at which this process has found them alike


@dataclass(frozen=True)
class KnownFile:
    """A file that decides records.

    Attributes
    ----------
    name : in the identity of the study, such as "program ccx"
    path : as a text, since it crosses to child processes; of a program without "/" its name, looked for on `search`
    identity : "sha256 ..." of its content, or what the command line of its version printed
    stamp : of the file when its identity was taken
    search : PATH on which a program is looked for; None: that of `calib`
    version : command line that prints the identity; None: it is the SHA-256
    """

    name: str
    path: str
    identity: str
    stamp: Stamp
    search: str | None = None
    version: ProgramVersion | None = None

    def check(self) -> None:
        """Compare the file with what it was; its content is read only where its stamp has changed.

        Raises
        ------
        CodeChanged : it is another one, or there is none any more
        """
        found = located(self.path, self.search)
        if found is None:
            raise CodeChanged(f"{self.name}: {self.path} is there no longer; put it back, and {AGAIN}")
        try:
            stamp = stamp_of(found)
            if stamp in (self.stamp, _same.get((str(found), self.identity))):
                return
            identity = content_identity(found) if self.version is None else self.version.printed()
        except (OSError, CalibError) as error:
            raise CodeChanged(f"{self.name}: {found} cannot be read any more ({error}); {AGAIN}") from error
        if identity != self.identity:
            raise CodeChanged(
                f"{self.name}: {found} has changed since the study was read ({_short(self.identity)} then, "
                f"{_short(identity)} now); {AGAIN}"
            )
        _same[str(found), self.identity] = stamp


def _short(identity: str) -> str:
    return identity if len(identity) <= SHOWN_CHARACTERS else f"{identity[:SHOWN_CHARACTERS]}..."


def known_file(name: str, path: Path, identity: str = "") -> KnownFile:
    """Return a file as it is now; its `identity` is the SHA-256 unless it is stated.

    Raises
    ------
    CalibError : it cannot be read
    """
    try:
        stamp = stamp_of(path)  # before its content: a change while that is read is found by the first check
        return KnownFile(name, str(path), identity or content_identity(path), stamp)
    except OSError as error:
        raise CalibError(f"{path}: {error.strerror}; put the file back, or run the study again") from error


def known_program(
    name: str, word: str, search: str | None, version: ProgramVersion | None = None, identity: str = ""
) -> KnownFile:
    """Return a program as it is now.

    Parameters
    ----------
    word : its path, or its name where it is looked for on `search`
    version, identity : command line that prints its version, and what that has printed; None and "": the SHA-256

    Raises
    ------
    CalibError : there is none of that name, or it cannot be read
    """
    path = shutil.which(word, path=search)
    if path is None:
        raise CalibError(
            f"run: there is no program {word!r} that can be executed; install it, put its folder on PATH, or state "
            "its path, relative to the study file"
        )
    return replace(known_file(name, Path(path), identity), path=word, search=search, version=version)


def located(word: str, search: str | None) -> Path | None:
    """Return the file of a path, or of the name of a program; None where there is none."""
    path = word if os.sep in word else shutil.which(word, path=search)
    return None if path is None or not Path(path).is_file() else Path(path)


def stamp_of(path: Path) -> Stamp:
    """Return what changes with a file, without reading it."""
    stat = path.stat()
    return stat.st_ino, stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns


def content_identity(path: Path) -> str:
    """Return "sha256 ..." of the content of a file."""
    return f"sha256 {checksum(path)}"
