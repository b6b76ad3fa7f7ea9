"""The tests that kill a study or a sweep at random moments, with more kills than the suite has time for.

    python tests/benchmarks/repeat_kills.py --kills 20

Whatever the number, what goes on after the last kill has to end as if there had been none, and no process may be left.
Arguments after -- go to pytest. The exit status is that of pytest.
"""

import argparse
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
TESTS = [
    "tests/study/test_killed.py", "tests/study/test_resume.py::test_a_killed_study_ends_as_the_uninterrupted_one",
    "tests/sweep/test_killed_sweep.py::test_many_kills_change_nothing",
    "tests/workflows/test_command_study.py::test_nothing_is_left_after_kills_at_random",
]  # fmt: skip


def main() -> int:
    """Run the tests with so many kills each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=20)
    asked, arguments = parser.parse_known_args()
    command = [sys.executable, "-m", "pytest", "-m", "slow or not slow", *TESTS, *(a for a in arguments if a != "--")]
    variables = {**os.environ, "CALIB_KILLS": str(asked.kills)}
    return subprocess.run(command, env=variables, cwd=ROOT, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
