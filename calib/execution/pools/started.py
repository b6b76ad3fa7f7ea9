"""Clusters and executors that pools of this process share: starting one takes seconds, or a place in a queue."""

import importlib
import json
import threading
import warnings
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from calib.errors import CalibError
from calib.execution.pools.settings import PoolSettings

EXTRAS = {  # module -> the extra that installs it
    "distributed": "dask", "dask_jobqueue": "dask", "executorlib": "executor",
}  # fmt: skip
_started: dict[str, tuple[Any, Callable[[Any], None]]] = {}  # with what ends it


def started(settings: PoolSettings, make: Callable[[type], Any], end: Callable[[Any], None]) -> Any:
    """Return the object of the class that the settings name, made where this process has none of the same settings.

    Parameters
    ----------
    make : class -> the object
    end : what is done with it when this process ends

    Raises
    ------
    CalibError : the class is not there, or does not take the options
    """
    key = _key(settings)
    if key not in _started:
        if not _started:
            threading.Thread(target=_end_with_main, name="started").start()
        named = str(settings.named)
        made = loaded(named)
        try:
            _started[key] = make(made), end
        except (TypeError, ValueError, OSError) as error:
            raise CalibError(f"[pool] options: {named!r} does not start with them: {error}") from error
    return _started[key][0]


def discard(settings: PoolSettings) -> None:
    """End the object of these settings; the next that is asked for is a new one."""
    if (known := _started.pop(_key(settings), None)) is not None:
        known[1](known[0])


def end_all() -> None:
    """End everything that was started."""
    while _started:
        thing, end = _started.popitem()[1]
        with suppress(Exception):  # the process ends: nobody could mend it
            end(thing)


def _end_with_main() -> None:
    """End everything when the main thread has ended: what is registered with `atexit` comes after all other threads."""
    threading.main_thread().join()
    end_all()


def loaded(reference: str) -> Any:
    """Return the thing that "module:Name" names.

    Raises
    ------
    CalibError : there is none; with the extra that installs its module
    """
    module, _, name = reference.partition(":")
    try:
        with warnings.catch_warnings(action="ignore", category=DeprecationWarning):  # the package's own
            return getattr(importlib.import_module(module), name)
    except ModuleNotFoundError as error:
        missing = str(error.name)
        extra = EXTRAS.get(missing.partition(".")[0])
        remedy = "install it" if extra is None else f'`pip install "calib[{extra}]"` installs it'
        raise CalibError(f"{reference!r} needs the module {missing!r}, which is not there: {remedy}") from error
    except (ImportError, AttributeError) as error:
        raise CalibError(f"{reference!r} does not load: {error}") from error


def _key(settings: PoolSettings) -> str:
    return json.dumps([settings.named, settings.jobs, dict(settings.options)], sort_keys=True, default=repr)
