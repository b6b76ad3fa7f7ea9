"""A pool leaves no folder behind, however its process ends."""

import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest
from child_environment import environment

SCRIPT = """
import pool_functions as f
from calib.execution.pools.local import LocalPool

if __name__ == "__main__":
    with LocalPool(f.slow_square, 1) as pool:
        for payloads in ([0.0], [1.0]):
            print(dict(pool.map(payloads)), flush=True)
"""


@pytest.fixture
def short_folder():
    """A folder of a short path: that of a socket has at most 107 characters."""
    with tempfile.TemporaryDirectory(prefix="calib-") as folder:
        yield Path(folder)


@pytest.mark.parametrize("killed", [False, True])
def test_the_folder_of_the_socket_of_the_fork_server_is_deleted(tmp_path, killed, short_folder):
    script, temporary = tmp_path / "script.py", short_folder
    script.write_text(SCRIPT)
    with subprocess.Popen(
        [sys.executable, script], env={**environment(), "TMPDIR": str(temporary)},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        assert process.stdout.readline() == "{0: 0.0}\n"
        assert [folder.name[:5] for folder in temporary.iterdir()] == ["pymp-"]
        if killed:
            process.kill()
        process.communicate()
    assert process.returncode == (-signal.SIGKILL if killed else 0)
    limit = time.monotonic() + 30.0
    while list(temporary.iterdir()):
        assert time.monotonic() < limit
        time.sleep(0.05)
