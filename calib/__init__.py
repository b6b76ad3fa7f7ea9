"""Calibrate simulators of vibro-impacting structures against measured phase curves."""

import hashlib
import importlib
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # for type checkers; at run time each is imported when it is first used
    from calib.errors import CalibError as CalibError
    from calib.modelling.effect import Effect as Effect
    from calib.modelling.model import Model as Model
    from calib.modelling.parameter import Parameter as Parameter
    from calib.modelling.simulator import Request as Request
    from calib.records.excitation import Excitation as Excitation
    from calib.workflows.record import Record as Record
    from calib.workflows.study import Study as Study

_DOOR = {
    "CalibError": "calib.errors",
    "Effect": "calib.modelling.effect",
    "Excitation": "calib.records.excitation",
    "Model": "calib.modelling.model",
    "Parameter": "calib.modelling.parameter",
    "Record": "calib.workflows.record",
    "Request": "calib.modelling.simulator",
    "Study": "calib.workflows.study",
}  # name -> module; imported when it is first used
__all__ = sorted(_DOOR)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return importlib.import_module("importlib.metadata").version("calib")
    if name not in _DOOR:
        raise AttributeError(f"module 'calib' has no attribute {name!r}; it has {', '.join(_DOOR)}")
    return getattr(importlib.import_module(_DOOR[name]), name)


def __dir__() -> list[str]:
    return __all__


def _kernel_cache() -> Path:
    """Folder of compiled kernels, named by a hash of every source that may hold one.

    numba's cache sees only the file of the function itself: a kernel that calls one of another file would keep old
    machine code after an edit there. So the folder, not the file, carries the identity of the sources.
    """
    digest = hashlib.sha256()
    here = Path(__file__).parent
    compiled = [here / "modelling" / "laws.py", *here.glob("simulators/**/*.py"), *here.glob("effects/*.py")]
    for source in sorted(compiled):
        digest.update(source.name.encode() + source.read_bytes())
    root = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(root) / "calib" / "kernels" / digest.hexdigest()[:16]


def _point_numba_to(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / ".writable").touch()
    except OSError:
        import atexit  # only where the home folder cannot be written
        import shutil
        import tempfile
        import warnings

        folder = Path(tempfile.mkdtemp(prefix="calib-kernels-"))
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        warnings.warn(f"the kernel cache cannot be written; compiling into {folder} for this process", stacklevel=3)
    os.environ["NUMBA_CACHE_DIR"] = str(folder)  # read when numba is first imported, here or in a child process
    if "numba" in sys.modules:
        sys.modules["numba"].config.CACHE_DIR = str(folder)


if "NUMBA_CACHE_DIR" not in os.environ:
    _point_numba_to(_kernel_cache())
