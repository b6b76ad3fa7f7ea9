"""What has to be the same here and on a worker: Python, libraries, and code."""

import hashlib
import platform
import sys
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

NUMERICAL = ("numpy", "scipy", "numba", "llvmlite")  # libraries whose version decides what a simulation gives
PYTHON, PACKAGE = "python", "calib"
SOURCE_DIGEST_DIGITS = 12  # hexadecimal, of a digest that a message shows
ABSENT = "not installed"


def identity(modules: Iterable[str] = ()) -> dict[str, str]:
    """Return what decides what an evaluation gives in this process, by name.

    Parameters
    ----------
    modules : outside this package, whose source files count too

    Returns
    -------
    "python", "calib" and the numerical libraries -> version, with a digest of the source of "calib"; module -> digest
    """
    known = {PYTHON: platform.python_version(), PACKAGE: f"{_version(PACKAGE)}, source {_package_digest()}"}
    known |= {name: _version(name) for name in NUMERICAL}
    for module in sorted(set(modules)):
        if module.partition(".")[0] not in (PYTHON, PACKAGE, *NUMERICAL, *sys.stdlib_module_names):
            known[module] = _digest(module)
    return known


def differences(here: Mapping[str, str], there: Mapping[str, str]) -> list[str]:
    """Say what is another on a worker: one text for each name."""
    return [
        f"{name} is {there.get(name, ABSENT)} there, {here[name]} here"
        for name in here
        if there.get(name) != here[name]
    ]


def processor() -> str:
    """Return the name of the processor that kernels are compiled for."""
    from llvmlite.binding import get_host_cpu_name  # slow to import, and few processes ask

    return get_host_cpu_name()


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ABSENT


def _digest(module: str) -> str:
    try:
        spec = find_spec(module)
    except (ImportError, ValueError):  # its package is absent; a module made by hand has no specification
        spec = None
    if spec is None:
        return "not found"
    if spec.origin is None or not Path(spec.origin).is_file():
        return "without a file"
    return f"sha256 {hashlib.sha256(Path(spec.origin).read_bytes()).hexdigest()[:SOURCE_DIGEST_DIGITS]}"


@cache
def _package_digest() -> str:
    digest, root = hashlib.sha256(), Path(__file__).parents[2]
    for source in sorted(root.rglob("*.py")):
        digest.update(str(source.relative_to(root)).encode() + source.read_bytes())
    return digest.hexdigest()[:SOURCE_DIGEST_DIGITS]
