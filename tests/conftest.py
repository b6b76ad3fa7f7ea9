"""What all tests share: one thread a process for linear algebra, the fork server, signals, and the order."""

import os
import signal
from collections import Counter
from functools import partial

import pytest
from dask_processes import DaskProcesses

from calib.execution.pools.starting import THREAD_VARIABLES

# before numpy is imported: as in the child processes of a pool, for the processes of the tests share the cores, and a
# BLAS whose threads wait for one another takes several times as long
os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))

# a shell without job control starts what runs in the background with SIGINT ignored, and so would be what a test starts
# and interrupts
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

LONG_FILES = (  # few tests, and some twenty seconds or more
    "diagnosis/test_diagnose.py", "docs/test_blocks.py", "dynamics/test_response.py", "effects/test_conformance.py",
    "fmu/test_calibration.py", "hidden/test_drawn.py", "hidden/test_foreign_beam.py", "hidden/test_found.py",
    "measured/test_benchmarks.py", "measured/test_diagnosis.py", "measured/test_spring_disc.py", "paper/test_fe.py",
    "paper/test_minimal.py", "paper/test_story.py", "simulators/test_compliant_contact.py",
    "simulators/test_uncompiled_contact.py", "study/test_elsewhere.py", "study/test_killed.py",
    "study/test_recovery.py", "study/test_resume.py", "sweep/test_killed_sweep.py", "tests/test_calculix_beam.py",
    "workflows/test_calibrate.py", "workflows/test_command_study.py", "workflows/test_confidence.py",
    "workflows/test_new.py", "workflows/test_window.py",
)  # fmt: skip


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let the files that take longest begin first, lest one of them runs alone in the end: then those of many tests."""
    files = Counter(item.path for item in items)
    items.sort(key=lambda item: (not str(item.path).endswith(LONG_FILES), -files[item.path]))


@pytest.fixture(scope="session", autouse=True)
def fork_server():
    """Start it with all imported that calibrations and sweeps need.

    A process has one fork server, and it preloads what the first pool needs. Where that is a pool of next to nothing,
    every child of every later pool imports numba, scipy and xarray by itself: two seconds of each `calib run`.
    """
    # here: the process that only hands tests out to others reads this file too
    from calib.execution.pools.local import LocalPool
    from calib.simulators.delaminated_beam import DelaminatedBeam
    from calib.simulators.four_dof import FourDof
    from calib.simulators.oscillator import Oscillator
    from calib.workflows.calibrate import calibrate

    with LocalPool(partial(calibrate, DelaminatedBeam, FourDof, Oscillator)) as pool:
        assert list(pool.map([])) == []  # the server starts, and no child


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """A Dask scheduler, and a worker of two threads."""
    with DaskProcesses(tmp_path_factory.mktemp("dask")) as processes:
        processes.add_worker(threads=2)
        yield processes
