"""The optimiser that a study file names, made where a search begins."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from calib import plugins
from calib.errors import CalibError
from calib.study import Optimiser

COSTLY_OPTIMISER = "surrogate"  # searches where simulations are few and slow, and the study file names no optimiser


@dataclass(frozen=True)
class OptimiserMaker:
    """Makes the optimiser of a study; a refusal names the line of the study file."""

    maker: Callable[..., Optimiser]
    options: Mapping[str, Any]
    place: str

    def __call__(self, **contract: int) -> Optimiser:
        """Return the optimiser for `dim`, `seed`, `budget` and `batch`."""
        try:
            return self.maker(**contract, **self.options)
        except (CalibError, TypeError, ValueError, ImportError) as error:
            raise CalibError(f"{self.place}: {error}") from error


def costly_optimiser(**contract: int) -> Optimiser:
    """Return the optimiser of few, slow simulations, which is imported only where it is wanted."""
    optimiser: Optimiser = plugins.load("calib.optimisers", COSTLY_OPTIMISER)(**contract)
    return optimiser


def no_search(**contract: int) -> Optimiser:
    """Stand in for the optimiser of a study that is only shown."""
    raise CalibError("this study was read to be shown: it has no optimiser")
