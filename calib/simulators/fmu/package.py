"""The package fmpy, imported where an FMU is read or run: it belongs to the extra `calib[fmu]`."""

import importlib
from types import ModuleType

from calib.errors import CalibError


def fmpy() -> ModuleType:
    """Return the package fmpy.

    Raises
    ------
    CalibError : it is not installed
    """
    try:
        return importlib.import_module("fmpy")
    except ImportError as error:
        raise CalibError(
            f"the simulator 'fmu' needs the package fmpy, which does not import ({error}); "
            'install it: pip install "calib[fmu]"'
        ) from error
