"""A frequency response beside a measured one, by the distance between curves."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from calib.errors import CalibError
from calib.records import is_response
from calib.records.compared_response import compared_harmonics, compared_tolerances
from calib.records.response import PARTS, parts_of


@dataclass(frozen=True)
class ResponseDistance:
    """Distance of each measured point from the curve that a sweep of its level and direction runs through.

    With F the frequency and H the complex amplitude of a harmonic of a body, r^2 = (dF / sigma_F)^2 + sum |dH|^2 /
    sigma_H^2, over all harmonics and bodies, from a measured point to the nearest one of the simulated curve, its ends
    at folds and grazings included: orthogonal distance regression. A fold that comes early is a distance in frequency
    there, not a jump in amplitude. The distance of a term is the rms of r over that of |H| / sigma_H: responses 10 %
    too large score about 0.1 / sqrt(3). At a held amplitude the complex level is in the place of H
    (`calib.records.compared_response`).

    Source: Boggs, Byrd, Schnabel, SIAM Journal on Scientific and Statistical Computing 8 (1987) 1052-1078.
    """

    name = "frequency_response"
    unit = "Hz, m"
    channels = PARTS

    def __call__(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> xr.DataArray:
        """Return frequency and parts (body, channel, point), with what each is known to as coordinate `tolerance`."""
        if not is_response(record):
            raise CalibError("frequency_response compares frequency responses, and this record is over time")
        names = list(bodies or record.variables["body"].values.tolist())
        rows = [record.variables["body"].values.tolist().index(name) for name in names]
        of_frequency, of_parts = compared_tolerances(record)
        of_parts, channels = of_parts[:, rows], ("frequency", *parts_of(record))
        square = np.mean(np.sum(np.abs(compared_harmonics(record)[:, rows] / of_parts) ** 2, axis=0))
        # the mean over channels is that of three, whatever the number of harmonics
        ratio = np.sqrt(square * ((1 + len(PARTS)) / len(channels)))
        # one frequency, and a row of each body
        shared = np.sqrt(len(names)) * np.broadcast_to(of_frequency, of_parts[0].shape)
        tolerance = float(ratio) * np.stack([shared, *np.repeat(of_parts, len(PARTS), axis=0)], axis=1)
        dims = ("body", "channel", "point")
        coords = {"body": names, "channel": list(channels), "tolerance": (dims, tolerance)}
        return xr.DataArray(self.values(record, names), dims=dims, coords=coords)

    def values(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> np.ndarray:
        """Return the same as a bare array, without the tolerances."""
        names = record.variables["body"].values.tolist()
        rows = [names.index(name) for name in bodies or names]
        frequency = record.variables["frequency"].values
        own = compared_harmonics(record)[:, rows]
        parts = (part for harmonic in own for part in (harmonic.real, harmonic.imag))
        return np.stack([np.broadcast_to(frequency, own[0].shape), *parts], axis=1)

    def trust(self, record: xr.Dataset) -> np.ndarray:
        """Factors (1, point) on the distances of a simulated response: less than 1 of a gross error."""
        return record.variables["trust"].values[None]

    def scale(self, reference: xr.DataArray) -> xr.DataArray:
        """Uncertainty of each value (body, channel, point), times the rms ratio of amplitude to uncertainty."""
        return reference["tolerance"].reset_coords(drop=True)
