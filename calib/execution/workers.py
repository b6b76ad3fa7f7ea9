"""Where a function is evaluated: child processes here or elsewhere, or this process where they cannot import it."""

import ast
import sys
import warnings
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from calib.errors import CalibError
from calib.execution.pool import InProcess, OnCompiling, OpenPool
from calib.execution.pools.identity import identity
from calib.execution.pools.limits import CallLimits
from calib.execution.pools.local import LocalPool
from calib.execution.pools.remote import RemotePool
from calib.execution.pools.results import ResultFolder
from calib.execution.pools.sent import pickled
from calib.execution.pools.settings import PoolSettings
from calib.execution.pools.setup import PoolSetup
from calib.execution.pools.started import loaded

REMOTE = {  # kind -> what is imported for it alone: its packages may be missing, and take long
    "dask": "calib.execution.pools.dask:DaskWorkers",
    "executor": "calib.execution.pools.executor:ExecutorWorkers",
}


def workers(
    function: Callable[[Any], Any],
    pool: PoolSettings,
    timeout: float | None = None,
    *,
    modules: Iterable[str] = (),
    results: ResultFolder | None = None,
    on_note: Callable[[str], None] = lambda text: None,
    on_compiling: OnCompiling | None = None,
) -> OpenPool:
    """Open the pool that a study states, for a function.

    A function of a notebook, an interactive session, or a script that would run its study in each child process, is
    evaluated in this process: no other can import it.

    Parameters
    ----------
    function, timeout : as in `LocalPool`
    modules : outside this package, beside those of the function, that have to be the same on a worker
    results, on_note : as in `RemotePool`
    on_compiling : as in `LocalPool`; not called where evaluations run elsewhere

    Raises
    ------
    CalibError : a script without the guard ``if __name__ == "__main__":`` defines what more than one process needs; the
        workers cannot be reached, or are no fit ones
    """
    sent = pickled(function)
    if pool.kind != "local":
        if sent.in_script:
            raise CalibError(
                f"what is simulated is defined in {_place()}, which workers of kind {pool.kind!r} cannot import: "
                "move it into a module"
            )
        known = identity([*sent.importable, *modules])
        limits = CallLimits(timeout, pool.memory)
        setup = PoolSetup(sent, limits, known, None if results is None else results.path)
        return RemotePool(loaded(REMOTE[pool.kind])(pool), setup, pool.jobs, results, on_note)
    if not sent.in_script:
        return LocalPool(function, pool.local_jobs, timeout, memory=pool.memory, on_compiling=on_compiling)
    script = getattr(sys.modules["__main__"], "__file__", None)
    if script is not None:
        if _guarded(Path(script)):
            return LocalPool(function, pool.local_jobs, timeout, memory=pool.memory, on_compiling=on_compiling)
        if pool.local_jobs > 1:
            raise CalibError(
                f"what is simulated is defined in {script}, which {pool.jobs} child processes would import and run "
                'again: run the study under `if __name__ == "__main__":`, move the definition into a module, or set '
                "jobs to 1"
            )
    warnings.warn(
        f"what is simulated is defined in {_place()}, where child processes cannot import it: all runs in this "
        "process, one after the other and without a time-out; move it into a module to use child processes",
        stacklevel=2,
    )
    return InProcess(function)


def _place() -> str:
    """Say where the module of the script is defined."""
    return getattr(sys.modules["__main__"], "__file__", None) or "this session"


def _guarded(script: Path) -> bool:
    """Whether a script asks for its `__name__`; True where that cannot be told."""
    try:
        tree = ast.parse(script.read_bytes())
    except (OSError, SyntaxError, ValueError):
        return True
    return any(isinstance(node, ast.Name) and node.id == "__name__" for node in ast.walk(tree))
