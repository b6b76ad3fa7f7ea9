"""Stable stretches of a simulated response as curves, and what an instrument reads on them at set frequencies."""

from typing import NamedTuple

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline, PPoly

from calib.records.response import complex_harmonics, harmonic_orders, sweeps

MIN_SPLINE_POINTS = 4  # fewer are joined by straight lines
# of the largest range of a stretch's amplitudes: less counts as that much in its chord length, as rounding may be all
# that a harmonic has which the model lacks  [1]
MIN_SPAN_SHARE = 1e-6
MAX_GAP_SHARE = 0.01  # of the frequencies of a sweep: from the end of a stretch to where the next one begins  [1]


class StableStretch(NamedTuple):
    """One stable stretch in the order swept.

    Attributes
    ----------
    along : (m,) chord length in units of the ranges of the stretch
    spline : over it; None where there are few points
    points : (m, 1 + 2 n) frequency [Hz], real parts and imaginary parts [m] of n rows: the bodies of the first
        harmonic, those of the next one, and so on
    """

    along: np.ndarray
    spline: CubicSpline | None
    points: np.ndarray

    def reaches(self, frequency: float) -> bool:
        """Whether it has a point at a frequency  [Hz]."""
        own = self.points[:, 0]
        return bool(own.min() <= frequency <= own.max())

    def at(self, frequency: float) -> np.ndarray:
        """Complex amplitudes (row,) at a frequency [Hz], of the last point there in the order swept; else of an end.

        A stretch ends where it turns back, and its frequency rises or falls up to there.
        """
        own = self.points[:, 0]
        if self.spline is None:
            order = np.argsort(own)
            row = np.array([np.interp(frequency, own[order], column[order]) for column in self.points.T])
        else:
            roots = PPoly(self.spline.c[..., 0], self.spline.x).solve(frequency, extrapolate=False)
            row = self.spline(roots[-1]) if roots.size else self.points[int(np.argmin(np.abs(own - frequency)))]
        rows = (row.size - 1) // 2
        return np.asarray(row[1 : 1 + rows] + 1j * row[1 + rows :])


def stable_stretches(simulated: xr.Dataset, sweep: float) -> list[StableStretch]:
    """Stable stretches of a sweep, in the order swept."""
    stretches = []
    amplitude = complex_harmonics(simulated).reshape(-1, simulated.sizes["point"])
    own = simulated["sweep"].values == sweep
    for piece in dict.fromkeys(simulated["piece"].values[own].tolist()):
        at = np.flatnonzero(own & (simulated["piece"].values == piece))
        points = np.column_stack([simulated["frequency"].values[at], amplitude[:, at].real.T, amplitude[:, at].imag.T])
        span = np.ptp(points, axis=0)
        span[1:] = np.maximum(span[1:], MIN_SPAN_SHARE * span[1:].max())
        chord = np.linalg.norm(np.diff(points / np.where(span > 0.0, span, 1.0), axis=0), axis=1)
        keep = np.concatenate([[True], chord > 0.0])
        along, points = np.concatenate([[0.0], np.cumsum(chord)])[keep], points[keep]
        spline = CubicSpline(along, points) if along.size >= MIN_SPLINE_POINTS else None
        stretches.append(StableStretch(along, spline, points))
    return stretches


def read_at(simulated: xr.Dataset, measured: xr.Dataset) -> np.ndarray:
    """Complex amplitudes (body, point) of the first harmonic, as `harmonics_at`  [m]."""
    return np.asarray(harmonics_at(simulated, measured)[0])


def harmonics_at(simulated: xr.Dataset, measured: xr.Dataset) -> np.ndarray:
    """Complex amplitudes (order, body, point) that sweeps of a measured response would read at its frequencies  [m].

    The orders are those of the simulated one.

    A sweep that has jumped goes on a little beyond the end of its stretch: between both it is on the next one. NaN
    where no stretch reaches, as where the motion was not periodic.
    """
    shape = len(harmonic_orders(simulated)), simulated.sizes["body"], measured.sizes["point"]
    read = np.full((shape[0] * shape[1], shape[2]), np.nan + 0.0j)
    for sweep, points in sweeps(measured):
        stretches = stable_stretches(simulated, sweep)
        frequencies = measured["frequency"].values[points]
        gap = MAX_GAP_SHARE * float(np.ptp(frequencies))
        for point, frequency in zip(points.tolist(), frequencies.tolist(), strict=True):
            own = next((stretch for stretch in stretches if stretch.reaches(frequency)), None)
            own = own or next((s for s in stretches if abs(s.points[0, 0] - frequency) <= gap), None)
            if own is not None:
                read[:, point] = own.at(frequency)
    return read.reshape(shape)
