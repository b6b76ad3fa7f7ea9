"""The closed loop of displacement and velocity."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from calib.features.channels import as_names, labelled, mean_loops, picked, spread, trust_of_velocity
from calib.records import STATE
from calib.records.cycles import loop_sigma, mean_cycle, period_of


@dataclass(frozen=True)
class PhaseCurve:
    """The closed loop of displacement and velocity over the period of the excitation.

    Loops are compared sample by sample at the same phase, each channel over the reference's root mean square about its
    mean: an identical loop scores 0, one 10 % larger 0.10. Comparing velocity at the same displacement instead would
    give a distance of 0.15 for identical loops, because a loop is no function of displacement.

    Attributes
    ----------
    channels : to compare; ("displacement",) for a reference without velocity
    periods : length of the loop; n to tell the halves of a period-n motion apart
    """

    channels: Sequence[str] = STATE
    periods: int = 1
    name = "phase_curve"
    unit = "m, m/s"

    def __post_init__(self) -> None:
        object.__setattr__(self, "channels", as_names(self.channels))

    def __call__(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> xr.DataArray:
        """Mean loops (body, channel, phase)."""
        return labelled(self.values(record, bodies), record, bodies, self.channels, "phase")

    def values(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> np.ndarray:
        """Return the same as a bare array."""
        return mean_loops(record, bodies, self.channels, self.periods)[0]

    def trust(self, record: xr.Dataset) -> np.ndarray:
        """Trust (channel, phase) in the values of a simulated record."""
        time, trust = record.variables["time"].values, record.variables["trust"].values[None]
        mean = mean_cycle(time, trust, period_of(record), self.periods)
        return trust_of_velocity(np.clip(mean.loop, 0.0, 1.0), self.channels)

    def scale(self, reference: xr.DataArray) -> xr.DataArray:
        """Root mean square (body, channel) of the reference's loop about its mean."""
        return spread(reference)

    def uncertainty(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> xr.DataArray | None:
        """Standard uncertainty (body, channel, phase) from the record's sigma, None where it has none."""
        stated = [loop_sigma(record, channel, self.periods) for channel in self.channels]
        sigma = [own for own in stated if own is not None]
        if len(sigma) < len(stated):
            return None
        return picked(np.stack(sigma, axis=1), record, bodies, self.channels, "phase")
