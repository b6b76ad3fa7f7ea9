"""Versions of libraries, processor and linear algebra: what decides whether a run can be repeated bit for bit."""

import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy.linalg  # noqa: F401 - threadpoolctl sees the linear algebra that is loaded, and each brings its own
import scipy.linalg  # noqa: F401
from llvmlite.binding import get_host_cpu_name
from threadpoolctl import threadpool_info

LIBRARIES = ("calib", "numpy", "scipy", "numba", "llvmlite", "cma", "optuna")


@cache
def environment() -> dict[str, Any]:
    """Versions by name, the processor, the name numba compiles for, and the kernels and threads of each BLAS.

    The kernel that a BLAS picks by the processor, or by a variable such as OPENBLAS_CORETYPE, and its number of threads
    change the last digits of what passes through it.
    """
    versions = {"python": platform.python_version()}
    for name in LIBRARIES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = "not installed"
    return {"versions": versions, "processor": _processor(), "cpu": get_host_cpu_name(), "blas": _blas()}


def _blas() -> dict[str, str]:
    """Kernel and threads of each BLAS in this process, by the folder it was loaded from."""
    kernels = {
        Path(blas["filepath"]).parent.name: (
            f"{blas['internal_api']} {blas['version']}, kernel {blas.get('architecture', 'unknown')}, "
            f"{blas['num_threads']} thread(s)"
        )
        for blas in threadpool_info()
        if blas["user_api"] == "blas"
    }
    return dict(sorted(kernels.items()))  # they are listed in the order in which they were loaded


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass  # not Linux
    return platform.processor() or platform.machine()
