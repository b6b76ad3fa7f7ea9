"""The channels themselves, sample by sample."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from calib.features.channels import as_names, compared_channels, labelled, picked, spread, trust_of_velocity
from calib.records.cycles import rows


@dataclass(frozen=True)
class TimeHistory:
    """The channels themselves, sample by sample: for excitations without a period too.

    The distance is the root mean square of the difference over that of the reference about its mean.

    Attributes
    ----------
    channels : to compare; none named: displacement and velocity as the reference has them
    """

    channels: Sequence[str] = ()
    name = "time_history"
    unit = "that of the channel"

    def __post_init__(self) -> None:
        object.__setattr__(self, "channels", as_names(self.channels))

    def __call__(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> xr.DataArray:
        """Channels (body, channel, time)."""
        channels = compared_channels(record, self.channels)
        return labelled(self.values(record, bodies), record, bodies, channels, "time")

    def values(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> np.ndarray:
        """Return the same as a bare array."""
        channels = compared_channels(record, self.channels)
        values = rows(record, bodies, channels)
        return values.reshape(-1, len(channels), values.shape[-1])

    def trust(self, record: xr.Dataset) -> np.ndarray:
        """Trust (channel, time) in the values of a simulated record."""
        return trust_of_velocity(record.variables["trust"].values, compared_channels(record, self.channels))

    def scale(self, reference: xr.DataArray) -> xr.DataArray:
        """Root mean square (body, channel) of the reference about its mean."""
        return spread(reference)

    def uncertainty(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> xr.DataArray | None:
        """Standard uncertainty (body, channel, time) from the record's sigma, None where it has none."""
        channels = compared_channels(record, self.channels)
        names = [f"{channel}_sigma" for channel in channels]
        if any(name not in record.variables for name in names):
            return None
        size = record.sizes["time"]
        sigma = [record.variables[name].values for name in names]
        full = [np.repeat(s[:, None], size, axis=1) if s.ndim == 1 else s for s in sigma]
        return picked(np.stack(full, axis=1), record, bodies, channels, "time")
