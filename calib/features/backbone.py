"""Frequency of a free decay over its amplitude."""

from collections.abc import Sequence
from dataclasses import dataclass

import xarray as xr

from calib.features.channels import as_names
from calib.features.decay_curve import DecayQuantity, PreparedCurve, prepared_curve

BACKBONE_TOLERANCE = 1e-3  # below which frequencies at different amplitudes count alike  [1]


@dataclass(frozen=True)
class BackboneCurve:
    """Damped frequency of the dominant mode of a free decay over its amplitude: the backbone of the measured record.

    Log amplitude and phase are smoothed by splines (`calib.records.decay`). Frequencies are compared at 24 amplitudes
    of the measured record, in geometric progression down to 5 times the amplitude's standard error, by their
    uncertainties. A simulation counts with the frequency at which it passes each amplitude, at whatever instant; beyond
    its own amplitudes with that at the nearest one.

    Attributes
    ----------
    channels : whose amplitude is meant; none named: displacement, or velocity where the reference has none
    """

    channels: Sequence[str] = ()
    name = "backbone"
    unit = "Hz"

    def __post_init__(self) -> None:
        object.__setattr__(self, "channels", as_names(self.channels))

    def prepared(self, reference: xr.Dataset, bodies: Sequence[str] | None = None) -> PreparedCurve:
        """Return the feature over the amplitudes of a measured decay."""
        quantity = DecayQuantity("frequency", BACKBONE_TOLERANCE)
        return prepared_curve(self.name, self.unit, quantity, self.channels, reference, bodies)

    def __call__(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> xr.DataArray:
        """Frequencies (body, channel, point) of a record at amplitudes of its own."""
        return self.prepared(record, bodies)(record, bodies)

    def scale(self, reference: xr.DataArray) -> xr.DataArray:
        """Return the mean frequency (body, channel): 10 % higher scores 0.10."""
        return reference.mean("point")
