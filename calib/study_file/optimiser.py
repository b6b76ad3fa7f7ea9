"""The optimiser that a study file names, made where a search begins."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from calib.errors import CalibError
from calib.study import Optimiser


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


def no_search(**contract: int) -> Optimiser:
    """Stand in for the optimiser of a study that is only shown."""
    raise CalibError("this study was read to be shown: it has no optimiser")
