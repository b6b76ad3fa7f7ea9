"""Stepped sines that could be measured: their sweeps, and what a model says would be read."""

import numpy as np
import xarray as xr
from scipy.optimize import nnls

from calib.diagnosis.laboratory import DesignPoint
from calib.diagnosis.part import Part
from calib.dynamics.level_curve import LevelCurve
from calib.records.response import (
    HELD,
    PARTS,
    complex_amplitude,
    harmonic_orders,
    harmonic_tolerances,
    has_phase,
    make_response,
    modulus,
    sigma_of_order,
    sweeps,
    tolerances,
    with_harmonics,
)


def unread_sweeps(point: DesignPoint, measured: xr.Dataset) -> xr.Dataset:
    """Sweeps in each direction and with as many points as a measured response has at a level; nothing is read yet.

    Their level goes over the frequency as that of the sweep of the largest one, as where the acceleration of a base
    was held.

    Parameters
    ----------
    point : largest level, first and last frequency
    """
    known, level = measured["frequency"].values, measured["level"].values
    at_a_level = max(np.unique(known[level == own]).size for own in np.unique(level))
    count = max(at_a_level, *(points.size for _, points in sweeps(measured)))
    upwards = np.linspace(point.setting("frequency"), point.setting("end_frequency"), count)
    directions = sorted({float(way) for way in measured["direction"].values}, reverse=True)
    frequency = np.concatenate([upwards[:: int(way)] for way in directions])
    largest = _largest(measured)
    shape = LevelCurve(known[largest], level[largest])
    levels = np.array([shape(own) for own in frequency.tolist()])
    nothing = np.zeros((measured.sizes["body"], frequency.size))
    return make_response(
        frequency, [str(body) for body in measured.body.values], nothing,
        point.setting("amplitude") * levels / levels.max(), str(measured["level"].attrs["units"]),
        np.repeat(np.arange(float(len(directions))), count), np.repeat(directions, count),
        higher=dict.fromkeys(harmonic_orders(measured)[1:], nothing),
    ).assign_attrs({**{key: own for key, own in measured.attrs.items() if key != HELD}, "status": "ok"})  # fmt: skip


def as_read(unread: xr.Dataset, harmonics: np.ndarray, measured: xr.Dataset, part: Part) -> xr.Dataset:
    """Sweeps with the complex amplitudes (order, body, point) [m] that they would read, uncertain as measured ones are.

    The variance of the sweep of the largest level is a^2 + b^2 |H|^2 (variance function); a is taken in proportion to
    the rms amplitude. That of a higher harmonic is a^2, in proportion to the rms amplitude of the first.

    Parameters
    ----------
    part : of the measured response, whose noise may grow with the amplitude
    """
    of_frequency, of_parts = tolerances(measured)[0], harmonic_tolerances(measured)
    own, size, sigma = _largest(measured), np.abs(complex_amplitude(measured)), np.empty(harmonics.shape)
    for k, body in enumerate(str(body) for body in measured.body.values):
        rows = zip(part.rows, part.noise, strict=True)
        growth = [np.asarray(noise.profile) ** 2 for (name, what), noise in rows if name == body and what in PARTS]
        variance = of_parts[0, k] ** 2 * (np.mean(growth, axis=0) if growth else 1.0)
        terms = np.column_stack([np.full(own.size, np.mean(size[k, own] ** 2)), size[k, own] ** 2])
        shares, _ = nnls(terms / variance[own, None], np.ones(own.size))
        reached = np.abs(harmonics[0, k]) ** 2
        sigma[0, k] = np.sqrt(shares[0] * reached.mean() + shares[1] * reached)
        share = np.mean(of_parts[1:, k, own] ** 2, axis=-1) / np.mean(size[k, own] ** 2)
        sigma[1:, k] = np.sqrt(share * reached.mean())[:, None]
    sigma = np.maximum(sigma, np.finfo(float).tiny)
    read = with_harmonics(unread, harmonics)
    stated = zip(harmonic_orders(measured), sigma, strict=True)
    known = {
        **{sigma_of_order(order): (("body", "point"), values, {"units": "m"}) for order, values in stated},
        "frequency_sigma": ("point", np.full(harmonics.shape[-1], of_frequency.mean()), {"units": "Hz"}),
    }
    return (read if has_phase(measured) else modulus(read)).assign(known)


def _largest(measured: xr.Dataset) -> np.ndarray:
    """Places (k,) of the points of the sweep with the largest level, one of several points where there is one."""
    own = [points for _, points in sweeps(measured)]
    own = [points for points in own if points.size > 1] or [np.arange(measured.sizes["point"])]
    return max(own, key=lambda points: float(measured["level"].values[points].max()))
