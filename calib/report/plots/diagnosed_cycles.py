"""Mean cycles of diagnosed motions, with the noise of these means.

A diagnosed motion is a Dataset over (row, time) with measured, calibrated and, where effects were added to the model,
extended, each row in its unit; weight in [0, 1], 0 where a sample is not compared; over row sigma, body, channel, unit;
memory (row, lag) and innovation (row), coefficients and standard deviation of the autoregression that the noise is;
time [s]; attributes cycle [periods of the excitation] and, where there is one, period [s].
"""

import math
from typing import NamedTuple

import numpy as np
import scipy
import xarray as xr

from calib.records import STATE
from calib.records.cycles import mean_cycle

IMPULSE_SAMPLES = 1024  # samples after which the impulse response of the noise has decayed


class ComparedCycle(NamedTuple):
    """Mean cycle of a channel, measured and simulated.

    Attributes
    ----------
    abscissa : (n,) phase in the cycle [periods], or time where there is no period [s]
    measured, calibrated : (n,) means of the cycles, of the measurement and the calibrated model  [unit of the row]
    extended : (n,) the same of the extended model, None where there is none
    weight : (n,) of the cycle's samples, in [0, 1]
    sigma : standard deviation of the noise of the means  [unit of the row]
    response : (k,) impulse response of the filter that makes the noise of the means of white noise of unit variance
    cycles : number of cycles averaged
    """

    abscissa: np.ndarray
    measured: np.ndarray
    calibrated: np.ndarray
    extended: np.ndarray | None
    weight: np.ndarray
    sigma: float
    response: np.ndarray
    cycles: float


def compared_cycle(motion: xr.Dataset, row: int) -> ComparedCycle:
    """Mean cycle of a row; of a record without a period the whole record."""
    names = [name for name in ("measured", "calibrated", "extended", "weight") if name in motion]
    rows = np.array([motion[name].values[row] for name in names])
    abscissa, count = motion.time.values - float(motion.time[0]), 1.0
    if "period" in motion.attrs:
        period, length = float(motion.attrs["period"]), int(motion.attrs["cycle"])
        weight = np.array([np.ones(abscissa.size) if name == "weight" else motion.weight.values[row] for name in names])
        mean = mean_cycle(motion.time.values, rows, period, length, weight=weight)
        abscissa, rows, count = mean.phase, mean.loop, mean.cycles
        rows[names.index("weight")] = np.clip(rows[names.index("weight")], 0.0, 1.0)
    means = dict(zip(names, rows, strict=True))
    curves = means["measured"], means["calibrated"], means.get("extended"), means["weight"]
    sigma, response = float(motion.sigma[row]) / math.sqrt(count), _response(motion, row) / math.sqrt(count)
    return ComparedCycle(abscissa, *curves, sigma, response, count)


def _response(motion: xr.Dataset, row: int) -> np.ndarray:
    """Impulse response (IMPULSE_SAMPLES,) of the autoregression of a row's noise  [unit of the row]."""
    impulse = np.eye(1, IMPULSE_SAMPLES)[0]
    feedback = np.concatenate([[1.0], -motion.memory.values[row]])
    return float(motion.innovation[row]) * scipy.signal.lfilter([1.0], feedback, impulse)


def compared_rows(motion: xr.Dataset) -> list[tuple[int, str, str, str]]:
    """Number, body, channel and unit of the rows that are compared."""
    kinds = zip(motion.body.values, motion.channel.values, motion.unit.values, strict=True)
    named = [(k, str(body), str(channel), str(unit)) for k, (body, channel, unit) in enumerate(kinds)]
    return [row for row in named if motion.weight.values[row[0]].any()]


def state_rows(motion: xr.Dataset) -> dict[str, tuple[int, int]]:
    """Rows of displacement and velocity of each body that has both, one of them compared."""
    named = zip(motion.body.values, motion.channel.values, strict=True)
    known = {(str(body), str(channel)): k for k, (body, channel) in enumerate(named)}
    bodies = dict.fromkeys(body for body, _ in known)
    x, v = STATE
    rows = {b: (known[b, x], known[b, v]) for b in bodies if (b, x) in known and (b, v) in known}
    return {b: two for b, two in rows.items() if motion.weight.values[list(two)].any()}


def rms_over_noise(motion: xr.Dataset) -> float:
    """Root mean square of the residual of the mean cycles over its noise, over all compared rows  [1]."""
    squares = [(own.weight * ((own.measured - own.calibrated) / own.sigma) ** 2, own.weight) for own in _cycles(motion)]
    return math.sqrt(sum(s.sum() for s, _ in squares) / max(1.0, sum(w.sum() for _, w in squares)))


def _cycles(motion: xr.Dataset) -> list[ComparedCycle]:
    return [compared_cycle(motion, row) for row, *_ in compared_rows(motion)]
