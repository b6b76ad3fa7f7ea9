"""A simulator tried once before a search begins."""

from dataclasses import dataclass

import xarray as xr


@dataclass(frozen=True, eq=False)
class DryRun:
    """What one run has shown.

    Attributes
    ----------
    record : its answer
    facts : what else there is to say, each with its name
    """

    record: xr.Dataset
    facts: tuple[tuple[str, str], ...] = ()
