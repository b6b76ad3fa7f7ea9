"""Stepped sines that could be measured: their sweeps, and what a model says would be read."""

import numpy as np
import xarray as xr

from calib.diagnosis.laboratory import DesignPoint
from calib.records.response import complex_amplitude, has_phase, make_response, sweeps, tolerances, with_amplitude


def unread_sweeps(point: DesignPoint, measured: xr.Dataset) -> xr.Dataset:
    """Sweeps at one level, in each direction and with as many points as a measured response has; nothing is read yet.

    Parameters
    ----------
    point : level, first and last frequency
    """
    count = max(points.size for _, points in sweeps(measured))
    attrs = {key: own for key, own in measured.attrs.items() if key not in ("kind", "status")}
    upwards = np.linspace(point.setting("frequency"), point.setting("end_frequency"), count)
    directions = sorted({float(way) for way in measured["direction"].values}, reverse=True)
    frequency = np.concatenate([upwards[:: int(way)] for way in directions])
    return make_response(
        frequency, [str(body) for body in measured.body.values],
        np.ones((measured.sizes["body"], frequency.size)), point.setting("amplitude"),
        str(measured["level"].attrs["units"]), np.repeat(np.arange(float(len(directions))), count),
        np.repeat(directions, count), **attrs,
    )  # fmt: skip


def as_read(unread: xr.Dataset, amplitude: np.ndarray, measured: xr.Dataset) -> xr.Dataset:
    """Sweeps with the complex amplitudes (body, point) [m] that they would read, uncertain as a measured response is.

    In proportion to the motion: each body's standard uncertainty has the ratio to its rms amplitude that it has there.
    """
    amplitude = amplitude if has_phase(measured) else np.abs(amplitude) + 0.0j
    of_frequency, of_parts = tolerances(measured)
    shares = _rms(of_parts) / np.maximum(_rms(complex_amplitude(measured)), np.finfo(float).tiny)
    sigma = np.maximum(shares * _rms(amplitude), np.finfo(float).tiny)
    return with_amplitude(unread, amplitude).assign(
        response_sigma=(("body", "point"), np.repeat(sigma, amplitude.shape[1], axis=1), {"units": "m"}),
        frequency_sigma=("point", np.full(amplitude.shape[1], of_frequency.mean()), {"units": "Hz"}),
    )


def _rms(rows: np.ndarray) -> np.ndarray:
    """Root mean square (body, 1) of rows (body, point)."""
    return np.asarray(np.sqrt(np.mean(np.abs(rows) ** 2, axis=1, keepdims=True)))
