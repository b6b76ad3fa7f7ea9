"""Half the peak-to-peak value."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from calib.features.channels import as_names, compared_channels, labelled, mean_loops
from calib.records.cycles import rows


@dataclass(frozen=True)
class Amplitude:
    """Half the peak-to-peak value: of the mean loop, or of the whole record where the excitation has no period.

    Attributes
    ----------
    channels : to compare; none named: displacement and velocity as the reference has them
    """

    channels: Sequence[str] = ()
    name = "amplitude"
    unit = "that of the channel"

    def __post_init__(self) -> None:
        object.__setattr__(self, "channels", as_names(self.channels))

    def __call__(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> xr.DataArray:
        """Amplitudes (body, channel)."""
        return labelled(self.values(record, bodies), record, bodies, compared_channels(record, self.channels))

    def values(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> np.ndarray:
        """Return the same as a bare array."""
        channels = compared_channels(record, self.channels)
        if "frequency" in record.attrs:
            values, _ = mean_loops(record, bodies, channels)
        else:
            values = rows(record, bodies, channels)
            values = values.reshape(-1, len(channels), values.shape[-1])
        return 0.5 * np.ptp(values, axis=-1)

    def scale(self, reference: xr.DataArray) -> xr.DataArray:
        """Return the reference's own amplitude (body, channel): 10 % larger scores 0.10."""
        return abs(reference)
