"""A curve over the amplitude of a free decay: measured, and of simulations at the same amplitudes."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import xarray as xr

from calib.errors import CalibError
from calib.features.channels import labelled
from calib.records.cycles import rows
from calib.records.decay import DecayFrame, amplitude_curves, decay_channel, over_amplitude, smoothed_record
from calib.records.decay.oscillation import Oscillation

QUANTITIES = "frequency", "damping_ratio"
MAX_REMEMBERED_FITS = 8  # of simulations, which a frequency and a damping ratio are both taken from


class DecayQuantity(NamedTuple):
    """What is told over amplitude.

    name : variable of `amplitude_curves`
    tolerance : least standard uncertainty that weights the amplitudes, over the curve's own size  [1]
    """

    name: str
    tolerance: float


class _MeasuredCurve(NamedTuple):
    """How a record is smoothed, log amplitudes (m,), and at these values and standard uncertainties (m,)."""

    frame: DecayFrame
    log_amplitude: np.ndarray
    values: np.ndarray
    sigma: np.ndarray


@dataclass(frozen=True, eq=False)
class PreparedCurve:
    """A feature over the amplitudes of one measured decay.

    Simulations are smoothed with the splines of the measured record, so that what these smooth away is the same in
    both. A simulation that does not pass an amplitude has there its value at the nearest one.

    Attributes
    ----------
    name, unit, channels : of the feature
    quantity : which curve
    curves : by (body, channel)
    """

    name: str
    unit: str
    channels: Sequence[str]
    quantity: DecayQuantity
    curves: dict[tuple[str, str], _MeasuredCurve] = field(repr=False)
    reference: xr.Dataset = field(repr=False)

    def __call__(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> xr.DataArray:
        """Return the curve (body, channel, point) of the record that it is prepared for, or of a simulation."""
        if record is self.reference:
            return self._labelled(np.array([curve.values for curve in self.curves.values()]))
        return self._labelled(self.values(record, bodies))

    def values(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> np.ndarray:
        """Return the curve (body, channel, point) of a simulation; NaN where it does not oscillate."""
        time = record.variables["time"].values.tobytes()
        found = []
        for (body, channel), curve in self.curves.items():
            row = rows(record, [body], [channel])[0]
            one = _fit(curve.frame, time, row.tobytes())
            none = np.full(curve.values.shape, np.nan)
            found.append(none if one is None else over_amplitude(one, curve.log_amplitude)[1 + self._index])
        return np.array(found).reshape(-1, len(self._channels), len(found[0]))

    def scale(self, reference: xr.DataArray) -> xr.DataArray:
        """Root mean square (body, channel) of the measured curve, by its weights: 10 % larger scores 0.10."""
        weight = 1.0 / self.uncertainty(self.reference)
        return xr.apply_ufunc(np.sqrt, ((weight * reference) ** 2).mean("point") / (weight**2).mean("point"))

    def uncertainty(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> xr.DataArray:
        """Return the standard uncertainty (body, channel, point) of the measured curve, no less than the tolerance."""
        rows = []
        for curve in self.curves.values():
            least = self.quantity.tolerance * float(np.median(np.abs(curve.values)))
            rows.append(np.hypot(curve.sigma, least))
        return self._labelled(np.array(rows))

    @property
    def _index(self) -> int:
        return QUANTITIES.index(self.quantity.name)

    @property
    def _channels(self) -> list[str]:
        return list(dict.fromkeys(channel for _, channel in self.curves))

    def _labelled(self, values: np.ndarray) -> xr.DataArray:
        bodies = list(dict.fromkeys(body for body, _ in self.curves))
        shaped = values.reshape(len(bodies), len(self._channels), -1)
        return labelled(shaped, self.reference, bodies, self._channels, "point")


def prepared_curve(
    feature_name: str,
    unit: str,
    quantity: DecayQuantity,
    channels: Sequence[str],
    reference: xr.Dataset,
    bodies: Sequence[str] | None,
) -> PreparedCurve:
    """Analyse a measured decay, and return the feature over its amplitudes.

    Raises
    ------
    CalibError : no free decay, too short, or one that does not decay
    """
    curves = {}
    for body in bodies or [str(name) for name in reference.body.values]:
        for channel in channels or (decay_channel(reference),):
            decay = smoothed_record(reference, body, channel)
            own = amplitude_curves(decay)
            curves[body, channel] = _MeasuredCurve(
                decay.frame,
                np.log(own.amplitude.values),
                own[quantity.name].values,
                own[f"{quantity.name}_sigma"].values,
            )
    return PreparedCurve(feature_name, unit, channels, quantity, curves, reference)


@lru_cache(maxsize=MAX_REMEMBERED_FITS)
def _fit(frame: DecayFrame, time: bytes, values: bytes) -> Oscillation | None:
    """Fit of a simulated channel, whose float64 these are; None where it does not oscillate."""
    try:
        return frame.smoothed(np.frombuffer(time), np.frombuffer(values))
    except CalibError:  # no oscillation that its samples resolve
        return None
