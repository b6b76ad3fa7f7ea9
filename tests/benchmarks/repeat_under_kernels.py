"""The tests that compute, repeated under the kernels of OpenBLAS that are named: their last digits differ.

    python tests/benchmarks/repeat_under_kernels.py default Haswell Zen SkylakeX Sandybridge Nehalem --threads 1 2

"default" leaves the choice to OpenBLAS. Each line says which kernel was really in use, since OpenBLAS takes another one
where it does not know a name; one that the processor cannot run is said and skipped. Arguments after -- go to pytest
instead of the folders that compute, such as `-- -m slow tests/paper`. The exit status is 1 where some test failed.
"""

import argparse
import os
import re
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).parents[2]
COMPUTING = [
    "tests/confidence", "tests/diagnosis", "tests/dynamics", "tests/optimisers", "tests/paper", "tests/simulators",
    "tests/sweep", "tests/cli/test_cli_dynamics.py", "tests/objective/test_objective.py", "tests/study/test_resume.py",
]  # fmt: skip
VARIABLES = ("OPENBLAS_CORETYPE", "OPENBLAS_NUM_THREADS", "OPENBLAS_L2_SIZE")
IN_USE = (
    "import numpy.linalg, scipy.linalg, threadpoolctl\n"
    "blas = [one for one in threadpoolctl.threadpool_info() if one['internal_api'] == 'openblas']\n"
    "print(' '.join(sorted({one['architecture'] for one in blas})))"
)


def environment(kernel: str, threads: int) -> dict[str, str]:
    """Variables of this process, with those of OpenBLAS set as named."""
    kept = {name: value for name, value in os.environ.items() if name not in VARIABLES}
    kept["OPENBLAS_NUM_THREADS"] = str(threads)
    return kept if kernel == "default" else {**kept, "OPENBLAS_CORETYPE": kernel}


def in_use(variables: dict[str, str]) -> str:
    """Names of the kernels that numpy and scipy take with these variables; empty where they do not run."""
    done = subprocess.run([sys.executable, "-c", IN_USE], env=variables, capture_output=True, text=True, check=False)
    return done.stdout.strip() if done.returncode == 0 else ""


def repeated(variables: dict[str, str], arguments: list[str]) -> tuple[int, str, float]:
    """Exit status of pytest, its closing line with the tests that failed, and the time it took  [s]."""
    begin = time.perf_counter()
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *arguments]
    done = subprocess.run(command, env=variables, cwd=ROOT, capture_output=True, text=True, check=False)
    said = done.stdout.strip().splitlines() or done.stderr.strip().splitlines() or ["no output"]
    failed = [line for line in said if re.match(r"(FAILED|ERROR) ", line)]
    return done.returncode, "\n    ".join([said[-1], *failed]), time.perf_counter() - begin


def main() -> int:
    """Print a line for each kernel and number of threads."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kernels", nargs="+", help='names as OPENBLAS_CORETYPE takes them, or "default"')
    parser.add_argument("--threads", type=int, nargs="+", default=[1], help="numbers of threads, each with each kernel")
    own, arguments = sys.argv[1:], COMPUTING
    if "--" in own:
        own, arguments = own[: own.index("--")], own[own.index("--") + 1 :]
    asked = parser.parse_args(own)
    worst = 0
    for kernel in asked.kernels:
        for threads in asked.threads:
            variables = environment(kernel, threads)
            present = in_use(variables)
            if not present:
                print(f"{kernel:12} {threads} thread(s): does not run on this processor", flush=True)
                continue
            status, said, seconds = repeated(variables, arguments)
            worst = max(worst, int(status != 0))
            print(f"{kernel:12} {threads} thread(s), {present}: {said} ({seconds:.0f} s)", flush=True)
    return worst


if __name__ == "__main__":
    sys.exit(main())
