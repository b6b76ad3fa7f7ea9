"""A PostgreSQL server of a test's own: started, killed and started again."""

import os
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import pytest
from programs import required

PASSWORD = "s3cr3t/p@ss"  # with what an address has to escape
ESCAPED = "s3cr3t%2Fp%40ss"
USER = "lab"
PATIENCE = 30.0  # s, for the server to start
OPTIONS = ("fsync=off", "full_page_writes=off", "shared_buffers=16MB", "listen_addresses=127.0.0.1")


class Server:
    """A cluster in `folder`, which the account of the server owns: PostgreSQL refuses to run as root.

    Only the password opens it, over TCP on a free port of this machine.
    """

    def __init__(self, folder: Path):
        pg_ctl = Path(required("pg_ctlcluster"))
        self.programs = sorted(Path("/usr/lib/postgresql").glob("*/bin"), key=lambda path: float(path.parent.name))[-1]
        assert pg_ctl.exists()
        self.folder, self.port = folder, _free_port()
        self._account = ["runuser", "-u", "postgres", "--"] if os.geteuid() == 0 else []
        if self._account:
            shutil.chown(folder, "postgres")
        secret = folder / "password"
        secret.write_text(PASSWORD)
        secret.chmod(0o644)
        self._run(
            "initdb", "-D", f"{folder}/data", "-U", USER, "--auth=scram-sha-256", f"--pwfile={secret}", "--no-sync",
            "--locale=C", "--encoding=UTF8", "--no-instructions",
        )  # fmt: skip
        self.start()

    def _run(self, program: str, *arguments: str) -> None:
        command = [*self._account, str(self.programs / program), *arguments]
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd="/")
        assert done.returncode == 0, done.stderr

    def start(self) -> None:
        """Start it, and wait until it answers."""
        settings = " ".join(f"-c {option}" for option in OPTIONS)
        self._run(
            "pg_ctl", "start", "-w", f"-t{PATIENCE:.0f}", "-D", f"{self.folder}/data", "-l", f"{self.folder}/log",
            "-o", f"-p {self.port} -k '' {settings}",
        )  # fmt: skip

    def processes(self) -> list[int]:
        """The server and its children, the server first."""
        first = int((self.folder / "data" / "postmaster.pid").read_text().split()[0])
        return [first, *_children(first)]

    def kill(self) -> None:
        """End all its processes at once, as a power failure would."""
        processes = self.processes()
        self.signal(signal.SIGKILL)
        wait_until(lambda: not any(Path(f"/proc/{process}").exists() for process in processes))

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to all its processes."""
        for process in self.processes():
            with suppress(ProcessLookupError):  # a child has just ended
                os.kill(process, number)

    def url(self, database: str = "postgres", password: str = ESCAPED) -> str:
        """Address of a database, for SQLAlchemy."""
        return f"postgresql+psycopg://{USER}:{password}@127.0.0.1:{self.port}/{database}"

    def create(self, database: str) -> str:
        """Make an empty database; return its address."""
        self.execute(f'CREATE DATABASE "{database}"')
        return self.url(database)

    def execute(self, statement: str, database: str = "postgres") -> Sequence[Sequence[object]]:
        """Rows of a statement."""
        psycopg = pytest.importorskip("psycopg")
        with psycopg.connect(
            host="127.0.0.1", port=self.port, user=USER, password=PASSWORD, dbname=database, autocommit=True
        ) as connection:
            answer = connection.execute(statement)
            return answer.fetchall() if answer.description else []


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def _children(parent: int) -> list[int]:
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:  # it has just ended
            continue
        if int(fields[1]) == parent:
            found.append(int(path.parent.name))
    return found


def wait_until(holds, patience: float = 20.0) -> None:
    """Wait for a condition; fail where it does not come true."""
    limit = time.monotonic() + patience
    while not holds():
        assert time.monotonic() < limit, "it did not come true"
        time.sleep(0.02)
