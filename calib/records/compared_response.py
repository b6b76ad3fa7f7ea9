"""What is compared of a frequency response: its complex amplitudes, or the complex levels that held amplitudes took.

Where a controller held the amplitude of a body, the motion is given and the level with its phase is what was measured.
A force that balances a given motion is linear in the parameters of stiffness, damping and mass, and the receptance is
its reciprocal: near a sharp resonance that is so steep in them that no fit gets far. So of the body that was held
a^2 / H is compared, with the median amplitude a that was held in a sweep, and of other bodies a H_b / H, their motion
when the body moves by a. The modulus of the first is a times the level of a point over that of the sweep.

Higher harmonics are properties of that motion, whatever phase the force has: of all bodies a / |H| H_k exp(-i k arg H)
is compared, the k-th harmonic when the body moves by a, its phase counted from k times that of the body's first one.
"""

import numpy as np
import xarray as xr

from calib.records.held_response import is_held
from calib.records.response import (
    HELD,
    HELD_AMPLITUDE,
    complex_amplitude,
    complex_harmonics,
    harmonic_orders,
    harmonic_tolerances,
    median_of_sweeps,
    split_parts,
    tolerances,
)


def compared_harmonics(record: xr.Dataset) -> np.ndarray:
    """Complex values (order, body, point) of a response that are compared  [m]."""
    return compared_of(complex_harmonics(record), record["sweep"].values, record)


def compared_of(harmonics: np.ndarray, sweep: np.ndarray, measured: xr.Dataset) -> np.ndarray:
    """Complex values (order, body, n) that are compared of harmonics (order, body, n) in sweeps (n,)  [m].

    Their own inverse: of these values it gives the harmonics again.

    measured : response, of whose sweeps and orders they are
    """
    if not is_held(measured):
        return harmonics
    row = measured.body.values.tolist().index(measured.attrs[HELD])
    held, size = harmonics[0, row], _held_amplitude(sweep, measured)
    further = np.array(harmonic_orders(measured)[1:])[:, None]
    turned = np.exp(-1j * further * np.angle(held)) * size / np.abs(held)  # (order above the first, n)
    found = np.concatenate([harmonics[:1] * size / held, harmonics[1:] * turned[:, None]])
    found[0, row] = size**2 / held
    return found


def compared_tolerances(record: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Standard uncertainties of frequencies (point,) [Hz], of either part of what is compared (order, body, point) [m].

    As `calib.records.response` has them of the harmonics, in proportion to these of the body that was held. A higher
    harmonic is turned by as many times the phase of the held motion as its order, and its uncertainty has that phase's.
    """
    of_frequency, of_parts = tolerances(record)[0], harmonic_tolerances(record)
    if not is_held(record):
        return of_frequency, of_parts
    row = record.body.values.tolist().index(record.attrs[HELD])
    ratio = _held_amplitude(record["sweep"].values, record) / np.abs(complex_amplitude(record)[row])
    found = of_parts * ratio
    of_held = found[0, row].copy()
    higher, order = np.abs(complex_harmonics(record)[1:]), np.array(harmonic_orders(record)[1:])[:, None, None]
    by_phase = order * higher / np.abs(complex_amplitude(record)[row]) * of_held
    found[1:] = np.hypot(found[1:], by_phase)
    found[0, row] *= ratio
    return of_frequency, found


def in_standard_uncertainties(record: xr.Dataset) -> xr.Dataset:
    """Return a response with the parts of what is compared in units of their standard uncertainties  [1]."""
    _, sigma = compared_tolerances(record)
    scaled = split_parts(record, compared_harmonics(record) / sigma)
    return record.assign({part: (("body", "point"), value, {"units": "1"}) for part, value in scaled})


def _held_amplitude(sweep: np.ndarray, measured: xr.Dataset) -> np.ndarray:
    """Median amplitude (n,) that was held in the sweep of each point  [m]."""
    return median_of_sweeps(measured, measured[HELD_AMPLITUDE].values, sweep)
