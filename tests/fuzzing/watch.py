"""Files that a process touches: by the audit events of Python, and in one folder, by inotify, through any library."""

import ctypes
import os
import struct
import sys
import sysconfig
from dataclasses import dataclass
from pathlib import Path

READ_EVENTS = frozenset(("os.listdir", "os.scandir"))
WRITE_EVENTS = frozenset(
    ("os.remove", "os.rename", "os.rmdir", "os.mkdir", "os.link", "os.symlink", "os.truncate", "os.chmod", "os.chown",
     "os.utime", "os.setxattr", "os.removexattr", "shutil.rmtree", "shutil.move", "shutil.copyfile", "tempfile.mkstemp",
     "tempfile.mkdtemp")
)  # fmt: skip
FORBIDDEN_PREFIXES = (
    "subprocess.", "socket.", "os.system", "os.exec", "os.posix_spawn", "os.spawn", "os.kill", "pty.",
    "ftplib.", "http.", "urllib.", "smtplib.", "webbrowser.", "ctypes.dlopen", "sqlite3.", "os.startfile",
)  # fmt: skip
SYSTEM = ("/proc/", "/sys/", "/dev/null", "/dev/urandom", "/usr/share/", "/usr/lib/", "/lib/", "/etc/localtime")
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
IN_ACCESS, IN_MODIFY, IN_OPEN, IN_MOVED, IN_CREATE, IN_DELETE = 0x1, 0x2, 0x20, 0xC0, 0x100, 0x200
EVENT = struct.Struct("iIII")


@dataclass
class Watch:
    """What a case may touch, and what it touched beyond it.

    Attributes
    ----------
    folder : of the case, in which it may read and write
    readable : further files that it may read
    notes : descriptor of a file, open for appending, that takes the complaints
    """

    folder: str
    readable: frozenset[str]
    notes: int

    def complain(self, what: str) -> None:
        """Note what was touched; processes that are forked from this one note it in the same file."""
        os.write(self.notes, f"{what}\n".encode(errors="replace"))

    def see(self, event: str, arguments: tuple) -> None:
        """Note an audit event of Python that leaves the folder."""
        if event == "open":
            path, mode, flags = arguments
            writing = bool(flags & WRITING) if isinstance(flags, int) else any(c in str(mode) for c in "wax+")
            self._check(path, "written" if writing else "read")
        elif event in READ_EVENTS:
            self._check(arguments[0], "read")
        elif event in WRITE_EVENTS:
            for path in arguments:
                if isinstance(path, str | bytes | os.PathLike):
                    self._check(path, "written")
        elif event.startswith(FORBIDDEN_PREFIXES) and event != "socket.gethostname":
            self.complain(f"{event} {arguments!r:.200}")

    def _check(self, path: object, deed: str) -> None:
        if not isinstance(path, str | bytes | os.PathLike):  # a descriptor
            return
        real = os.path.realpath(os.fsdecode(path))
        if real.startswith(self.folder + os.sep) or real == self.folder:
            return
        if deed == "read" and (real.startswith(PACKAGES + SYSTEM) or real in PACKAGES or real in self.readable):
            return
        if real == "/dev/null" or "/__pycache__" in real and real.startswith(PACKAGES):  # kernels of numba
            return
        self.complain(f"{real} was {deed}")


def _packages() -> tuple[str, ...]:
    """Folders of what is imported: this checkout, the installed packages, the standard library."""
    places = {*sysconfig.get_paths().values(), *(path for path in sys.path if path), str(Path(__file__).parents[2])}
    return tuple(sorted(os.path.realpath(place) for place in places))


PACKAGES = _packages()
_watches: list[Watch] = []


def _hook(event: str, arguments: tuple) -> None:
    if _watches:
        watch = _watches.pop()  # what is called here makes events of its own
        try:
            watch.see(event, arguments)
        finally:
            _watches.append(watch)


def begin(watch: Watch) -> None:
    """Watch this process from now on."""
    _watches[:] = [watch]


def end() -> None:
    """Watch it no more."""
    _watches.clear()


sys.addaudithook(_hook)


class Trap:
    """A folder in which whatever is opened, read or changed, by any process and library, is noted."""

    def __init__(self, folder: Path):
        self._libc = ctypes.CDLL(None, use_errno=True)
        self._file = self._libc.inotify_init1(os.O_NONBLOCK | os.O_CLOEXEC)
        mask = IN_ACCESS | IN_MODIFY | IN_OPEN | IN_MOVED | IN_CREATE | IN_DELETE
        if self._file < 0 or self._libc.inotify_add_watch(self._file, os.fsencode(folder), mask) < 0:
            raise OSError(ctypes.get_errno(), "inotify", str(folder))

    def caught(self) -> list[tuple[str, str]]:
        """Name and "read" or "written" of what was touched since the last call."""
        found = []
        while True:
            try:
                data = os.read(self._file, 65536)
            except BlockingIOError:
                return list(dict.fromkeys(found))
            at = 0
            while at < len(data):
                _, mask, _, length = EVENT.unpack_from(data, at)
                name = data[at + EVENT.size : at + EVENT.size + length].rstrip(b"\0").decode(errors="replace")
                found.append((name, "read" if mask & (IN_OPEN | IN_ACCESS) else "written"))
                at += EVENT.size + length
