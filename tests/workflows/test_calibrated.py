"""What a folder of results lacks is told before the records of its study are read."""

import subprocess
import sys

import pytest
from echo_study import write_study

from calib.errors import CalibError
from calib.workflows import calibrate as calibration
from calib.workflows import diagnose as diagnosis

WRITER = """
import sys
from pathlib import Path
from calib.store.lock import Lock

Lock(Path(sys.argv[1])).acquire()
print("locked", flush=True)
sys.stdin.read()
"""


def test_a_study_without_a_result_is_refused_before_it_is_loaded(tmp_path, monkeypatch):
    monkeypatch.delattr(diagnosis, "load")
    with pytest.raises(CalibError, match=r"there is no result.json in .*out: calibrate first, with `calib run"):
        diagnosis.diagnose_study(write_study(tmp_path))


def test_a_folder_that_is_written_is_refused_before_the_study_is_loaded(tmp_path, monkeypatch):
    monkeypatch.delattr(calibration, "load")
    (tmp_path / "out").mkdir()
    with subprocess.Popen(
        [sys.executable, "-c", WRITER, str(tmp_path / "out")], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as writer:
        writer.stdout.readline()
        with pytest.raises(CalibError, match=f"out is being written by process {writer.pid}"):
            calibration.calibrate(write_study(tmp_path), quiet=True)
        writer.stdin.close()
