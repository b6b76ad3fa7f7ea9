"""Damping ratio of a free decay over its amplitude."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from calib.features.channels import as_names
from calib.features.decay_curve import DecayQuantity, PreparedCurve, prepared_curve

DAMPING_TOLERANCE = 1e-2  # below which damping ratios at different amplitudes count alike  [1]


@dataclass(frozen=True)
class DecayCurve:
    """Damping ratio of the dominant mode of a free decay over its amplitude.

    With A the amplitude and omega the damped frequency it is -A' / A over the modulus of i omega + A' / A: constant for
    viscous damping, proportional to A for quadratic drag, to 1 / A for dry friction. It is compared at the amplitudes
    of the feature `backbone`, by its uncertainties.

    Attributes
    ----------
    channels : whose amplitude is meant; none named: displacement, or velocity where the reference has none
    """

    channels: Sequence[str] = ()
    name = "decay"
    unit = "1"

    def __post_init__(self) -> None:
        object.__setattr__(self, "channels", as_names(self.channels))

    def prepared(self, reference: xr.Dataset, bodies: Sequence[str] | None = None) -> PreparedCurve:
        """Return the feature over the amplitudes of a measured decay."""
        quantity = DecayQuantity("damping_ratio", DAMPING_TOLERANCE)
        return prepared_curve(self.name, self.unit, quantity, self.channels, reference, bodies)

    def __call__(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> xr.DataArray:
        """Damping ratios (body, channel, point) of a record at amplitudes of its own."""
        return self.prepared(record, bodies)(record, bodies)

    def scale(self, reference: xr.DataArray) -> xr.DataArray:
        """Root mean square (body, channel) of the damping ratio: 10 % larger scores 0.10."""
        return xr.apply_ufunc(np.sqrt, (reference**2).mean("point"))
