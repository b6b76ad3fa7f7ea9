"""Records of runs with the same inputs, kept in the folder of the results."""

import hashlib
import json
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import xarray as xr

from calib.errors import CalibError
from calib.records import SIMULATIONS, read, write

CACHE = "cache"  # folder below that of the results
MAX_CACHE_BYTES = 2**30  # of its files, above which the oldest half is deleted when a process begins
MAX_WRITING_S = 3600.0  # s, after which a file that has not its final name was left by a killed process


def cache_key(parts: Mapping[str, object]) -> str:
    """SHA-256 of everything that decides a record, as JSON takes it."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True, default=str).encode()).hexdigest()


def cached(results: Path, key: str) -> xr.Dataset | None:
    """Record of a run with the same key, None where there is none that can be read.

    Its attribute `simulations` is 0.
    """
    path = _path(results, key)
    if not path.exists():
        return None
    with suppress(CalibError, OSError):
        return read(path).assign_attrs({SIMULATIONS: 0})
    return None


def remember(results: Path, key: str, record: xr.Dataset) -> None:
    """Keep the record of a run; a disk that is full or cannot be written keeps none."""
    path = _path(results, key)
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        write(record, path)


def shrink(results: Path) -> None:
    """Delete what a killed process has not finished writing and, of a cache that is too large, the oldest half."""
    with suppress(OSError):
        for torn in (results / CACHE).glob(".*"):
            if torn.stat().st_mtime < time.time() - MAX_WRITING_S:
                torn.unlink()
        sizes = {path: path.stat() for path in (results / CACHE).glob("*.nc")}
        if sum(stat.st_size for stat in sizes.values()) > MAX_CACHE_BYTES:
            for path in sorted(sizes, key=lambda path: sizes[path].st_mtime_ns)[: len(sizes) // 2]:
                path.unlink()


def _path(results: Path, key: str) -> Path:
    return results / CACHE / f"{key}.nc"
