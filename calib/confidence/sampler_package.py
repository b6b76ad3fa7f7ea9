"""The package nautilus, imported where a posterior is sampled: it belongs to the extra `calib[confidence]`."""

import importlib
from types import ModuleType

from calib.errors import CalibError


def nautilus() -> ModuleType:
    """Return the package nautilus.

    Raises
    ------
    CalibError : it is not installed
    """
    try:
        return importlib.import_module("nautilus")
    except ImportError as error:
        raise CalibError(
            f"--posterior needs the package nautilus-sampler, which does not import ({error}); "
            'install it: pip install "calib[confidence]"'
        ) from error
