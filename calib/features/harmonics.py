"""Complex amplitudes of the first harmonics of the excitation."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from calib.errors import CalibError
from calib.features.channels import as_names, compared_channels, labelled, mean_loops
from calib.records.cycles import harmonics


@dataclass(frozen=True)
class Harmonics:
    """Complex amplitudes of the first harmonics of the excitation: x = mean + sum of Re[c_n exp(2 pi i n phase)].

    Attributes
    ----------
    number : of harmonics
    channels : to compare; none named: displacement and velocity as the reference has them
    """

    number: int = 5
    channels: Sequence[str] = ()
    name = "harmonics"
    unit = "that of the channel"

    def __post_init__(self) -> None:
        if self.number < 1:
            raise CalibError(f"harmonics are counted from 1 on, got number = {self.number}")
        object.__setattr__(self, "channels", as_names(self.channels))

    def __call__(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> xr.DataArray:
        """Real and imaginary part (body, channel, harmonic, part)."""
        channels = compared_channels(record, self.channels)
        return labelled(self.values(record, bodies), record, bodies, channels, "harmonic", "part")

    def values(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> np.ndarray:
        """Return the same as a bare array."""
        channels = compared_channels(record, self.channels)
        loops, phase = mean_loops(record, bodies, channels)
        if self.number > (phase.size - 1) // 2:
            raise CalibError(f"{phase.size} samples a period resolve fewer than {self.number} harmonics; ask for fewer")
        turn = np.exp(-2j * np.pi * np.arange(1, self.number + 1) * phase[0])
        amplitude = harmonics(loops, self.number) * turn
        return np.stack([amplitude.real, amplitude.imag], axis=-1)

    def scale(self, reference: xr.DataArray) -> xr.DataArray:
        """Magnitude (body, channel) of the reference's fundamental, over the root of the number of numbers.

        So the distance is the root of the summed squares of the differences, relative to the fundamental.
        """
        fundamental = xr.apply_ufunc(np.sqrt, (reference.isel(harmonic=0) ** 2).sum("part"))
        return fundamental / np.sqrt(2.0 * self.number)
