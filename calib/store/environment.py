"""Libraries and processor a study runs on: what decides whether the same numbers come out again."""

import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from llvmlite.binding import get_host_cpu_name

LIBRARIES = ("calib", "numpy", "scipy", "numba", "llvmlite", "cma", "optuna")


@cache
def environment() -> dict:
    """Versions by name, the processor, and the name numba compiles for."""
    versions = {"python": platform.python_version()}
    for name in LIBRARIES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = "not installed"
    return {"versions": versions, "processor": _processor(), "cpu": get_host_cpu_name()}


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass  # not Linux
    return platform.processor() or platform.machine()
