"""Phase of the strongest impact."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from calib.features.channels import impacts, labelled

PERIODS_PER_RADIAN = 1.0 / (2.0 * np.pi)  # a shift by delta periods changes a loop by about 2 pi delta of its size


@dataclass(frozen=True)
class ImpactPhase:
    """Phase at which the velocity of a body changes fastest (see `calib.records.cycles.impact`).

    A difference of one radian, 1/(2 pi) of a period, scores 1; differences are taken around the circle.
    """

    name = "impact_phase"
    unit = "1"
    channels = ("velocity",)
    wraps = 1.0

    def __call__(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> xr.DataArray:
        """Phase (body, channel) in [0, 1), in periods; NaN where there is no impact."""
        return labelled(impacts(record, bodies)[..., 0], record, bodies, self.channels)

    def scale(self, reference: xr.DataArray) -> float:
        """One radian, in periods."""
        return PERIODS_PER_RADIAN
