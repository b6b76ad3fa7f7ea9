"""What is compared of a frequency response: its complex amplitudes, or the complex levels that held amplitudes took.

Where a controller held the amplitude of a body, the motion is given and the level with its phase is what was measured.
A force that balances a given motion is linear in the parameters of stiffness, damping and mass, and the receptance is
its reciprocal: near a sharp resonance that is so steep in them that no fit gets far. So of the body that was held
a^2 / H is compared, with the median amplitude a that was held in a sweep, and of other bodies a H_b / H, their motion
when the body moves by a. The modulus of the first is a times the level of a point over that of the sweep.
"""

import numpy as np
import xarray as xr

from calib.records.held_response import is_held
from calib.records.response import HELD, HELD_AMPLITUDE, PARTS, complex_amplitude, median_of_sweeps, tolerances


def compared_amplitude(record: xr.Dataset) -> np.ndarray:
    """Complex values (body, point) of a response that are compared  [m]."""
    return compared_of(complex_amplitude(record), record["sweep"].values, record)


def compared_of(amplitude: np.ndarray, sweep: np.ndarray, measured: xr.Dataset) -> np.ndarray:
    """Complex values (body, n) that are compared of amplitudes (body, n) in sweeps (n,) of a measured response  [m].

    Their own inverse: of these values it gives the amplitudes again.
    """
    if not is_held(measured):
        return amplitude
    row = measured.body.values.tolist().index(measured.attrs[HELD])
    held, size = amplitude[row], _held_amplitude(sweep, measured)
    found = amplitude * size / held
    found[row] = size**2 / held
    return found


def compared_tolerances(record: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Standard uncertainties of frequencies (point,) [Hz] and of either part of what is compared (body, point)  [m].

    As `calib.records.response.tolerances` has them of the amplitudes, in proportion to these of the body that was held.
    """
    of_frequency, of_parts = tolerances(record)
    if not is_held(record):
        return of_frequency, of_parts
    row = record.body.values.tolist().index(record.attrs[HELD])
    ratio = _held_amplitude(record["sweep"].values, record) / np.abs(complex_amplitude(record)[row])
    found = of_parts * ratio
    found[row] *= ratio
    return of_frequency, found


def in_standard_uncertainties(record: xr.Dataset) -> xr.Dataset:
    """Return a response with the parts of what is compared in units of their standard uncertainties  [1]."""
    _, sigma = compared_tolerances(record)
    own = compared_amplitude(record)
    values = zip(PARTS, (own.real / sigma, own.imag / sigma), strict=True)
    return record.assign({part: (("body", "point"), value, {"units": "1"}) for part, value in values})


def _held_amplitude(sweep: np.ndarray, measured: xr.Dataset) -> np.ndarray:
    """Median amplitude (n,) that was held in the sweep of each point  [m]."""
    return median_of_sweeps(measured, measured[HELD_AMPLITUDE].values, sweep)
