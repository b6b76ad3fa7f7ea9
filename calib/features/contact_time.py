"""Duration of the strongest impact."""

from collections.abc import Sequence
from dataclasses import dataclass

import xarray as xr

from calib.features.channels import impacts, labelled


@dataclass(frozen=True)
class ContactTime:
    """Share of the period for which the acceleration of a body's strongest impact exceeds 0.2 of its peak."""

    name = "contact_time"
    unit = "1"
    channels = ("velocity",)

    def __call__(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> xr.DataArray:
        """Contact time (body, channel), in periods; NaN where there is no impact."""
        return labelled(impacts(record, bodies)[..., 2], record, bodies, self.channels)

    def scale(self, reference: xr.DataArray) -> xr.DataArray:
        """Return the reference's own contact time: 10 % longer scores 0.10."""
        return reference
