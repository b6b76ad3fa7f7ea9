"""The packages of the extra `calib[confidence]`, imported where a posterior is sampled: nautilus and ArviZ."""

import importlib
import warnings
from types import ModuleType

from calib.errors import CalibError


def nautilus() -> ModuleType:
    """Return the package nautilus.

    Raises
    ------
    CalibError : it is not installed
    """
    return _imported("nautilus", "nautilus-sampler")


def arviz() -> ModuleType:
    """Return the package arviz.

    Raises
    ------
    CalibError : it is not installed
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "\\s*ArviZ is undergoing a major refactor", FutureWarning)
        return _imported("arviz", "arviz")


def _imported(name: str, package: str) -> ModuleType:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise CalibError(
            f"--posterior needs the package {package}, which does not import ({error}); "
            'install it: pip install "calib[confidence]"'
        ) from error
