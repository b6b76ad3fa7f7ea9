"""A script that defines what is simulated: what it has to do is told before a process starts."""

import subprocess
import sys

import pytest
from child_environment import environment

OWN = """
import warnings
from calib.errors import CalibError
from calib.execution.pools.settings import PoolSettings
from calib.execution.workers import workers

def own(x):
    return x * x

"""
BARE = """
try:
    with warnings.catch_warnings(record=True) as told, workers(own, PoolSettings(jobs={jobs})) as pool:
        print(type(pool).__name__, sorted(dict(pool.map([1, 2])).values()), len(told))
except CalibError as refusal:
    print(refusal)
"""
GUARDED = """
if __name__ == "__main__":
    with workers(own, PoolSettings(jobs={jobs})) as pool:
        print(type(pool).__name__, sorted(dict(pool.map([1, 2])).values()), 0)
"""


def printed(tmp_path, body, jobs):
    script = tmp_path / "script.py"
    script.write_text(OWN + body.format(jobs=jobs))
    ended = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, env=environment())
    assert ended.returncode == 0, ended.stderr
    assert ended.stderr == ""
    return ended.stdout.strip()


def test_several_jobs_without_the_guard_are_refused_in_one_line(tmp_path):
    message = printed(tmp_path, BARE, 2)
    assert len(message.splitlines()) == 1
    assert 'run the study under `if __name__ == "__main__":`' in message
    assert message.endswith("or set jobs to 1")


@pytest.mark.parametrize(
    ("body", "jobs", "expected"),
    [(BARE, 1, "InProcess [1, 4] 1"), (GUARDED, 2, "LocalPool [1, 4] 0"), (GUARDED, 1, "LocalPool [1, 4] 0")],
)
def test_one_job_runs_in_the_script_and_the_guard_allows_more(tmp_path, body, jobs, expected):
    assert printed(tmp_path, body, jobs) == expected


ELSEWHERE = """
try:
    workers(own, PoolSettings("executor", executor="concurrent.futures:ThreadPoolExecutor"))
except CalibError as refusal:
    print(refusal)
"""


def test_a_script_that_defines_the_function_has_no_workers_elsewhere(tmp_path):
    assert "which workers of kind 'executor' cannot import: move it into a module" in printed(tmp_path, ELSEWHERE, 1)


def test_packages_of_workers_elsewhere_are_imported_for_them_alone():
    program = "import sys, calib.cli, calib.execution.workers; print({'distributed', 'executorlib'} & {*sys.modules})"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, env=environment(), check=True
    )
    assert done.stdout.strip() == "set()"
