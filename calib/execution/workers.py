"""Where a function is evaluated: child processes, or this process where they cannot import it."""

import ast
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from calib.errors import CalibError
from calib.execution.pool import InProcess
from calib.execution.pools.local import LocalPool
from calib.execution.pools.sent import pickled


def workers(function: Callable[[Any], Any], jobs: int = 1, timeout: float | None = None) -> LocalPool | InProcess:
    """Child processes for a function; this process where the function needs what no child process can import.

    That are the cells of a notebook or an interactive session, and a script that would run its study in each child.

    Parameters
    ----------
    function, jobs, timeout : as in `LocalPool`

    Raises
    ------
    CalibError : a script without the guard ``if __name__ == "__main__":`` defines what more than one process needs
    """
    if not pickled(function).in_script:
        return LocalPool(function, jobs, timeout)
    script = getattr(sys.modules["__main__"], "__file__", None)
    if script is not None:
        if _guarded(Path(script)):
            return LocalPool(function, jobs, timeout)
        if jobs > 1:
            raise CalibError(
                f"what is simulated is defined in {script}, which {jobs} child processes would import and run again: "
                'run the study under `if __name__ == "__main__":`, move the definition into a module, or set jobs to 1'
            )
    place = "this session" if script is None else script
    warnings.warn(
        f"what is simulated is defined in {place}, where child processes cannot import it: all runs in this "
        "process, one after the other and without a time-out; move it into a module to use child processes",
        stacklevel=2,
    )
    return InProcess(function)


def _guarded(script: Path) -> bool:
    """Whether a script asks for its `__name__`; True where that cannot be told."""
    try:
        tree = ast.parse(script.read_bytes())
    except (OSError, SyntaxError, ValueError):
        return True
    return any(isinstance(node, ast.Name) and node.id == "__name__" for node in ast.walk(tree))
