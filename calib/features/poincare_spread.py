"""Spread of the stroboscopic section."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from calib.features.channels import as_names, compared_channels, picked
from calib.records.cycles import poincare, rows


@dataclass(frozen=True)
class PoincareSpread:
    """Spread of the stroboscopic section, as a share of the amplitude of the motion.

    Root mean square of the section about its mean over half the peak-to-peak value of the record: 0 for a period-1
    motion without noise. A difference of 1 scores 1.

    Attributes
    ----------
    channels : to compare; none named: displacement and velocity as the reference has them
    """

    channels: Sequence[str] = ()
    name = "poincare_spread"
    unit = "1"
    aligned = False  # the section is longer than the record, and its spread does not depend on the trigger

    def __post_init__(self) -> None:
        object.__setattr__(self, "channels", as_names(self.channels))

    def __call__(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> xr.DataArray:
        """Spread (body, channel)."""
        channels = compared_channels(record, self.channels)
        section = poincare(record)
        amplitude = 0.5 * np.ptp(rows(record, None, channels), axis=-1).reshape(-1, len(channels))
        spread = np.stack([section[channel].values.std(axis=1) for channel in channels], axis=1)
        return picked(spread / np.where(amplitude > 0.0, amplitude, 1.0), record, bodies, channels)

    def scale(self, reference: xr.DataArray) -> float:
        """One: the spread is relative already."""
        return 1.0
