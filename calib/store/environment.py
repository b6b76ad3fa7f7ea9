"""Versions of libraries, processor and linear algebra: what decides whether a run can be repeated bit for bit."""

import platform
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy.linalg  # noqa: F401 - threadpoolctl sees the linear algebra that is loaded, and each brings its own
import scipy.linalg  # noqa: F401
from llvmlite.binding import get_host_cpu_name
from threadpoolctl import threadpool_info

LIBRARIES = ("calib", "numpy", "scipy", "numba", "llvmlite", "cma", "optuna")


@dataclass(frozen=True)
class Environment:
    """What decides whether a run can be repeated bit for bit.

    Attributes
    ----------
    versions : library -> version
    processor : its name
    cpu : the name that numba compiles for
    blas : folder of a linear algebra -> its kernel and threads
    """

    versions: Mapping[str, str]
    processor: str
    cpu: str
    blas: Mapping[str, str]


@cache
def environment() -> Environment:
    """Return the environment of this process.

    The kernel that a BLAS picks by the processor, or by a variable such as OPENBLAS_CORETYPE, and its number of threads
    change the last digits of what passes through it.
    """
    versions = {"python": platform.python_version()}
    for name in LIBRARIES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = "not installed"
    return Environment(versions, _processor(), get_host_cpu_name(), _blas())


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
