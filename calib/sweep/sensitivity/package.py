"""The package SALib, imported where a sensitivity is asked for: it belongs to the extra `calib[sensitivity]`."""

import importlib
from types import ModuleType

from calib.errors import CalibError


def salib(module: str) -> ModuleType:
    """Return a module of the package SALib, such as "sample.sobol".

    Raises
    ------
    CalibError : it is not installed
    """
    try:
        return importlib.import_module(f"SALib.{module}")
    except ImportError as error:
        raise CalibError(
            f"a sensitivity needs the package SALib, which does not import ({error}); "
            'install it: pip install "calib[sensitivity]"'
        ) from error
