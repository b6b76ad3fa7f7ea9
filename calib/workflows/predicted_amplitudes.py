"""Amplitudes of a frequency response as a channel that a posterior distribution predicts: read on simulated sweeps."""

import numpy as np
import xarray as xr

from calib.diagnosis.evidence import pairs_compared
from calib.diagnosis.noise import STATED, Noise
from calib.objective import Objective
from calib.objective.stable_stretches import read_at
from calib.records.response import AMPLITUDE_SIGMA_SHARE, PARTS, complex_amplitude, tolerances
from calib.workflows.residual import beside_simulation

AMPLITUDE = "amplitude"  # channel of a response: modulus of the complex amplitude  [m]
ASSUMED_NOISE = f"{AMPLITUDE_SIGMA_SHARE:.0%} of the rms amplitude"  # source of a level that nothing tells


def with_amplitude_channel(response: xr.Dataset) -> xr.Dataset:
    """Return a response with its `amplitude` (body, point)  [m]."""
    size = np.abs(complex_amplitude(response))
    return response.assign({AMPLITUDE: (("body", "point"), size, {"units": "m"})})


def read_amplitudes(simulated: xr.Dataset, measured: xr.Dataset) -> np.ndarray:
    """Amplitudes (body, point) of the measured bodies that its sweeps would read; NaN where no stable motion reaches.

    simulated : as `calib.dynamics.swept_response` has it, at least those bodies
    """
    return np.abs(read_at(simulated.sel(body=measured.body.values), measured))


def noise_of_amplitudes(objective: Objective, name: str, simulated: xr.Dataset) -> dict[tuple[str, str], Noise]:
    """Noise of the amplitude of each body that is compared, as normal noise along the complex amplitude  [m].

    In units of the standard uncertainties it is that of the parts, as a diagnosis estimates it about a simulation. The
    uncertainty of the frequency moves a reading along the curve: it counts where the record states it, and where the
    noise is estimated from distances from the curve, which it has a share in. An amplitude of few standard
    uncertainties is not normal (Rice, Bell System Technical Journal 23 (1944) 282), and its band may begin below 0.

    Parameters
    ----------
    objective : that compares the response `name`
    simulated : at the best point, of status ok
    """
    record = objective.references[name].record
    beside = beside_simulation(objective, name, simulated)
    known: dict[tuple[str, str], Noise] = {}
    if beside is not None:
        part, _ = beside
        rows = zip(part.rows, part.noise, part.used, strict=True)
        known = {row: noise for row, noise, used in rows if used.any() and row[1] in PARTS}
    else:  # there are too few points to estimate it from
        source = STATED if "response_sigma" in record else ASSUMED_NOISE
        known = {row: Noise(1.0, np.zeros(0), source) for row in pairs_compared(objective)[name] if row[1] in PARTS}
    sigma, bodies = _amplitude_sigmas(record, simulated), record.body.values.tolist()
    found = {}
    for body in dict.fromkeys(own for own, _ in known):
        parts = [noise for (own, _), noise in known.items() if own == body]
        square = np.mean([np.broadcast_to(own.sigma * own.profile, sigma.shape[1:]) ** 2 for own in parts], axis=0)
        level = np.sqrt(square) * sigma[bodies.index(body)]
        rms = float(np.sqrt(np.mean(level**2)))
        found[body, AMPLITUDE] = Noise(rms, np.zeros(0), parts[0].source, profile=level / rms)
    return found


def _amplitude_sigmas(record: xr.Dataset, simulated: xr.Dataset) -> np.ndarray:
    """Standard uncertainties (body, point) of the amplitudes of a response  [m].

    That of the frequency counts by what is read one standard uncertainty off on either side, where a motion is.
    """
    of_frequency, of_parts = tolerances(record)
    if "response_sigma" in record and "frequency_sigma" not in record:
        return of_parts
    frequency, middle = record["frequency"], read_amplitudes(simulated, record)
    off = [record.assign(frequency=frequency + side * of_frequency) for side in (-1.0, 1.0)]
    squares = np.array([(read_amplitudes(simulated, own) - middle) ** 2 for own in off])
    there = np.isfinite(squares)
    mean = np.where(there, squares, 0.0).sum(axis=0) / np.maximum(there.sum(axis=0), 1)
    return np.sqrt(of_parts**2 + mean)
