"""Force needed for a measured motion."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from calib.errors import CalibError
from calib.features.channels import labelled
from calib.records import CHANNELS
from calib.records.cycles import rows
from calib.records.filter import low_pass


@dataclass(frozen=True)
class ForceBalance:
    """Force that a measured motion needs, against the force that was measured (motion in, force out).

    The distance is the root mean square of the difference over that of the measured force.

    Attributes
    ----------
    cutoff : of the zero-phase low-pass (`calib.records.filter`) on both forces [Hz]; None filters nothing
    decimate : every so many-th sample is compared, after the filter
    """

    cutoff: float | None = None
    decimate: int = 1
    name = "force_balance"
    unit = CHANNELS["force"]
    channels = ("force",)

    def __post_init__(self) -> None:
        if self.decimate < 1:
            raise CalibError(f"decimate is a number of samples from 1 on, got {self.decimate}")

    def __call__(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> xr.DataArray:
        """Forces (body, channel, time)."""
        force = rows(record, bodies, self.channels)
        if self.cutoff is not None:
            force = low_pass(force, record.variables["time"].values, self.cutoff)
        return labelled(force[:, None, :: self.decimate], record, bodies, self.channels, "time")

    def scale(self, reference: xr.DataArray) -> xr.DataArray:
        """Root mean square (body, channel) of the measured force."""
        return xr.apply_ufunc(np.sqrt, (reference**2).mean("time"))
