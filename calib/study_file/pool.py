"""Where the evaluations of a study run: what its file says, or what takes its place."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import tomlkit

from calib.errors import CalibError
from calib.execution.pools.settings import PoolSettings
from calib.study_file.mistakes import Mistakes, read_as
from calib.study_file.schema import PoolTable, StudyToml
from calib.units import to_si


def pool_settings(
    shape: StudyToml, mistakes: Mistakes, jobs: int | None, given: Mapping[str, Any] | None
) -> PoolSettings:
    """Settings of the pool.

    Parameters
    ----------
    jobs : takes the place of the file's
    given : keys of a [pool] table that takes the place of the file's

    Raises
    ------
    CalibError : a mistake in `jobs` or in what is `given`; those of the file are noted in `mistakes`
    """
    if given is None:
        settings = _settings(shape.pool, mistakes, "pool")
    else:
        table, asked = read_as(PoolTable, Path("the pool"), tomlkit.dumps(dict(given)))
        settings = _settings(table, asked)
        asked.tell()
    short = shape.study.jobs
    if settings.kind == "local" and short is not None:
        if given is None and settings.jobs not in (None, short):
            mistakes.add(
                ("pool", "jobs"), f"expected {short}, as [study] jobs says, got {settings.jobs}; state one of them"
            )
        settings = settings if settings.jobs is not None else replace(settings, jobs=short)
    return settings if jobs is None else replace(settings, jobs=jobs)


def _settings(table: PoolTable, mistakes: Mistakes, *key: str) -> PoolSettings:
    memory = None
    if table.memory is not None:
        with mistakes.at(*key, "memory"):
            memory = to_si(table.memory, "byte")
            if not memory > 0.0:
                raise CalibError(f"expected a size above 0 bytes, got {table.memory!r}")
    with mistakes.at(*key):
        return PoolSettings(
            table.kind, table.jobs, memory, table.scheduler, table.cluster, table.executor, table.options
        )
    return PoolSettings()
