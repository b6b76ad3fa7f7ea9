"""Optuna's dashboard over a study's view, read-only and on this machine alone.

The view may grow while it is shown and may end in a torn line after its writer was killed: the journal is read by a
backend of our own that never opens it for writing, takes no lock and leaves an unfinished last line for later.
"""

import json
import os
import re
import shlex
import threading
from collections.abc import Callable, Iterable
from pathlib import Path
from socketserver import ThreadingMixIn
from typing import Any
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer, make_server
from wsgiref.types import StartResponse, WSGIApplication, WSGIEnvironment

import optuna_dashboard
import sqlalchemy.engine
from optuna.artifacts import FileSystemArtifactStore
from optuna.storages import BaseStorage, JournalStorage
from optuna.storages.journal import BaseJournalBackend

from calib.errors import CalibError
from calib.store.address import address_without_password, failure_reason
from calib.store.database import connected

HOST = "127.0.0.1"
PORT = 8080  # of TCP, unless the command states another
HOST_NAMES = ("localhost", HOST, "[::1]")  # in the header Host; a page that rebinds its own DNS name sends that name
ALLOWED_METHODS = ("GET", "HEAD")
HEAD_BYTES = 256  # bytes that identify a journal: its first log names its writer
PORT_SUFFIX = re.compile(r":\d*\Z")  # of a header Host
SECURITY_HEADER = ("X-Content-Type-Options", "nosniff")


def serve(
    view: str | Path,
    artifacts: str | Path | None = None,
    port: int = PORT,
    on_ready: Callable[[str], None] | None = None,
) -> None:
    """Serve the dashboard on loopback until Ctrl-C.

    Parameters
    ----------
    view : journal file, or the URL of an Optuna storage
    artifacts : folder of the pictures, None without
    port : 0 takes a free one
    on_ready : is told the address as soon as it answers

    Raises
    ------
    CalibError : the view does not exist or cannot be read, or the port is taken
    """
    app = application(view, artifacts)
    try:
        server = make_server(HOST, port, app, server_class=_Server, handler_class=_Handler)
    except OSError as error:
        raise CalibError(f"port {port} cannot be used ({error.strerror}); choose another with --port") from error
    with server:
        address = f"http://{HOST}:{server.server_port}/dashboard"
        if on_ready is not None:
            on_ready(address)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            return


def application(view: str | Path, artifacts: str | Path | None = None) -> WSGIApplication:
    """WSGI application that answers GET and HEAD with Optuna's dashboard.

    Other methods are answered with 405, a request whose header Host does not name this machine with 403.
    """
    store = None if artifacts is None else FileSystemArtifactStore(Path(artifacts).absolute())
    if _is_url(view):
        shown = _dashboard(_database(str(view)), store)
        return _ReadOnly(lambda: shown)
    return _ReadOnly(_Following(Path(view).absolute(), store))


def plain_command(view: str | Path, artifacts: str | Path | None = None) -> str:
    """Command line that shows the same view with Optuna's own program (which may also change it)."""
    words = ["optuna-dashboard", address_without_password(str(view))]
    return shlex.join(words if artifacts is None else [*words, "--artifact-dir", str(artifacts)])


class Journal(BaseJournalBackend):
    """A journal file that is only read: complete lines that are JSON, counted from the beginning of the file."""

    def __init__(self, path: Path):
        self.path = path
        self._lock = threading.Lock()
        self._place = (0, 0)  # number of logs before, byte at which the next one begins

    def read_logs(self, log_number_from: int) -> list[dict[str, Any]]:
        """Return the logs from this number on, as far as they are complete; none while there is no file."""
        if not self.path.exists():
            return []
        with self._lock, open(self.path, "rb") as file:
            number, offset = self._place if log_number_from == self._place[0] else (0, 0)
            file.seek(offset)
            logs = []
            for line in file:
                if not line.endswith(b"\n"):
                    break  # not finished, or never to be: the next reading begins here
                offset += len(line)
                log = _log(line)
                if log is not None:
                    if number >= log_number_from:
                        logs.append(log)
                    number += 1
            self._place = (number, offset)
            return logs

    def append_logs(self, logs: list[dict[str, Any]]) -> None:
        """Refuse: nothing is written here."""
        raise PermissionError(f"{self.path} is shown read-only")


class _ReadOnly:
    """WSGI middleware that lets only reading requests to this machine through to what `current` returns."""

    def __init__(self, current: Callable[[], WSGIApplication]):
        self.current = current

    def __call__(self, environ: WSGIEnvironment, start_response: StartResponse) -> Iterable[bytes]:
        host = environ.get("HTTP_HOST", "")
        if PORT_SUFFIX.sub("", host).lower() not in HOST_NAMES:
            names = ", ".join(HOST_NAMES)
            text = f"This dashboard answers only requests to {names}; the header Host of this one is {host!a:.100}.\n"
            return _refused(start_response, "403 Forbidden", text)
        if environ["REQUEST_METHOD"] not in ALLOWED_METHODS:
            allow = ("Allow", ", ".join(ALLOWED_METHODS))
            return _refused(start_response, "405 Method Not Allowed", "This dashboard is read-only.\n", allow)

        def start(status: str, headers: list[tuple[str, str]], *rest: Any) -> Callable[[bytes], object]:
            return start_response(status, [*headers, SECURITY_HEADER], *rest)

        return self.current()(environ, start)


def _refused(start_response: StartResponse, status: str, text: str, *headers: tuple[str, str]) -> list[bytes]:
    """Answer with a plain sentence."""
    body = text.encode("ascii")
    common = [("Content-Type", "text/plain"), ("Content-Length", str(len(body))), SECURITY_HEADER]
    start_response(status, [*common, *headers])
    return [body]


class _Following:
    """The dashboard of a journal file, made anew when the file is another one or has become shorter."""

    def __init__(self, path: Path, store: FileSystemArtifactStore | None):
        self.path, self.store = path, store
        self._lock = threading.Lock()
        self._head, self._size = b"", 0
        self._app: WSGIApplication | None = None
        self()

    def __call__(self) -> WSGIApplication:
        with self._lock:
            try:
                with open(self.path, "rb") as file:
                    head, size = file.read(HEAD_BYTES), os.fstat(file.fileno()).st_size
            except OSError as error:
                if self._app is not None:
                    return self._app  # for a moment there is no file: what was read is still shown
                raise CalibError(f"{self.path}: {error.strerror}; `calib run` makes it with the first trial") from error
            if self._app is None or size < self._size or not head.startswith(self._head):
                self._app = _dashboard(JournalStorage(Journal(self.path)), self.store)
            self._head, self._size = head, size
            return self._app


def _dashboard(storage: BaseStorage, store: FileSystemArtifactStore | None) -> WSGIApplication:
    return optuna_dashboard.wsgi(storage, artifact_store=store)


def _is_url(view: str | Path) -> bool:
    return isinstance(view, str) and "://" in view


def _database(url: str) -> BaseStorage:
    """Storage behind a URL, without making tables or files that are not there."""
    try:
        parsed = sqlalchemy.engine.make_url(url)
    except ValueError as error:
        raise CalibError(f"{address_without_password(url)}: {failure_reason(error, url)}") from None
    if parsed.get_backend_name() == "sqlite" and parsed.database and not Path(parsed.database).exists():
        raise CalibError(f"{parsed.database}: no such file; `calib run` makes it with the first trial")
    return connected(url, skip_table_creation=True)


def _log(line: bytes) -> dict[str, Any] | None:
    try:
        return json.loads(line)
    except ValueError:
        return None  # a torn line that a later writer has ended


class _Server(ThreadingMixIn, WSGIServer):
    """One thread a request: a plot that takes seconds does not hold up the page."""

    daemon_threads = True


class _Handler(WSGIRequestHandler):
    def log_message(self, *args: object) -> None:
        """Say nothing: requests are no news."""
