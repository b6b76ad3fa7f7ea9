"""What all tests share: threads of linear algebra, the fork server, signals, collecting, and the order of the files."""

import gc
import os
import signal
import sys
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

FIRST_FILES = (  # the first compiles the kernels that most tests take from the cache; the next need none meanwhile
    "docs/test_blocks.py", "workflows/test_command_study.py", "cli/test_cli.py", "cli/test_cli_dynamics.py",
    "workflows/test_python_study.py",
)  # fmt: skip
LONG_FILES = (  # few tests, and some ten seconds or more
    "confidence/window/test_region.py", "delaminated_beam/test_error_estimate.py",
    "diagnosis/discovery/test_responses.py", "diagnosis/test_diagnose.py", "diagnosis/test_harmonics.py",
    "diagnosis/test_pairs.py", "diagnosis/test_responses.py", "diagnosis/test_stand_ins.py",
    "dynamics/test_response.py", "effects/test_conformance.py", "fmu/test_calibration.py", "hidden/test_beam.py",
    "hidden/test_discovered.py", "hidden/test_drawn.py", "hidden/test_foreign_beam.py", "hidden/test_found.py",
    "hidden/test_hider.py", "hidden/test_remainder.py", "hidden/test_stepped.py", "measured/test_benchmarks.py",
    "measured/test_diagnosis.py",
    "measured/test_sloshing.py", "measured/test_spring_disc.py", "pages/test_page.py", "paper/test_fe.py",
    "paper/test_minimal.py", "paper/test_story.py", "paper/test_window.py", "pools/test_remote.py",
    "readers/test_damaged.py", "sensitivity/test_study.py", "simulators/test_compliant_contact.py",
    "simulators/test_uncompiled_contact.py", "store/test_postgresql.py", "study/test_elsewhere.py",
    "study/test_killed.py", "study/test_recovery.py", "study/test_resume.py", "sweep/test_killed_sweep.py",
    "sweep/test_run.py", "tests/test_calculix_beam.py", "tests/test_response_recovery.py", "tests/test_studies.py",
    "workflows/test_calibrate.py", "workflows/test_confidence.py", "workflows/test_diagnose.py",
    "workflows/test_discover.py",
    "workflows/test_held_study.py", "workflows/test_new.py", "workflows/test_predicted_amplitudes.py",
    "workflows/test_record_remarks.py", "workflows/test_records_of_two_kinds.py", "workflows/test_window.py",
)  # fmt: skip


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Collect at the price of one run: the garbage collector aside, and what was compiled kept for the next.

    What is collected lives until the end, and the collector would go through it again and again, as it would during
    the tests. Bytecode is written whatever PYTHONDONTWRITEBYTECODE says, as an installation writes it: otherwise each
    child process of the tests compiles the sources of calib again, and each run the tests' assertions.
    """
    gc.disable()
    kept, sys.dont_write_bytecode = sys.dont_write_bytecode, False
    try:
        return (yield)
    finally:
        sys.dont_write_bytecode = kept
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let the files that take longest begin first, lest one of them runs alone in the end: then those of many tests."""
    files = Counter(item.path for item in items)
    rank = {path: _rank(str(path)) for path in files}
    items.sort(key=lambda item: (rank[item.path], -files[item.path]))


def _rank(path: str) -> int:
    for place, name in enumerate(FIRST_FILES):
        if path.endswith(name):
            return place
    return len(FIRST_FILES) + (not path.endswith(LONG_FILES))


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
def without_pictures():
    """Draw none in the tests of a file, which asks for it by `usefixtures`."""
    from undrawn import empty_pictures  # here, as above

    with empty_pictures():
        yield


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """A Dask scheduler, and a worker of two threads."""
    with DaskProcesses(tmp_path_factory.mktemp("dask")) as processes:
        processes.add_worker(threads=2)
        yield processes
