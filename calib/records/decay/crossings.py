"""Frequency and damping ratio of a free decay, period by period, by its zero crossings."""

import numpy as np
import xarray as xr

from calib.records.decay.dataset import curves_dataset
from calib.records.decay.smoother import SmoothedDecay

HYSTERESIS = 0.5  # of the amplitude, which each half wave exceeds  [1]
MIN_HYSTERESIS = 4.5  # standard deviations of the noise that this is, at least: 7e-6 by chance
MIN_CROSSINGS = 4  # of one period whose half waves have both their ends
CROSSING_SHARE = 0.15  # of a half wave, on both sides of a crossing: samples through which its line goes  [1]


def crossing_curves(decay: SmoothedDecay) -> xr.Dataset:
    """Frequency and damping ratio of each period, from one crossing of the mean to the next but one.

    A crossing lies where a line through the samples near it vanishes; the amplitude of a half wave is that of the half
    sine between its crossings that fits it best; the logarithmic decrement is that of half waves of one sign.
    """
    (time, values), one = decay.without_mean, decay.oscillation
    amplitude = np.exp(one.basis.matrix(time) @ one.log_amplitude)
    level = HYSTERESIS * amplitude
    beyond = np.flatnonzero((np.abs(values) > level) & (level > MIN_HYSTERESIS * decay.noise))
    crossing, of_crossing = _crossings(time, values, beyond, decay.noise)
    if crossing.size < MIN_CROSSINGS:
        return curves_dataset(*np.empty((6, 0)), attrs={"method": "zero crossings"})
    amplitude, of_amplitude = _amplitudes(time, values, crossing, decay.noise)
    length = crossing[2:-1] - crossing[:-3]
    decrement = np.log(amplitude[:-2] / amplitude[2:])
    turn = np.hypot(2.0 * np.pi, decrement)
    relative = of_amplitude / amplitude
    return curves_dataset(
        time=0.5 * (crossing[1:-2] + crossing[2:-1]),
        amplitude=np.sqrt(amplitude[:-2] * amplitude[2:]),
        frequency=1.0 / length,
        damping_ratio=decrement / turn,
        frequency_sigma=np.hypot(of_crossing[2:-1], of_crossing[:-3]) / length**2,
        damping_ratio_sigma=np.hypot(relative[:-2], relative[2:]) * (2.0 * np.pi) ** 2 / turn**3,
        attrs={"method": "zero crossings"},
    )


def _crossings(time: np.ndarray, values: np.ndarray, beyond: np.ndarray, noise: float) -> tuple[np.ndarray, np.ndarray]:
    """Instants (m,) at which values pass zero between samples `beyond` of two signs, and their uncertainty  [s]."""
    turns = np.flatnonzero(np.diff(np.sign(values[beyond])))
    if turns.size < MIN_CROSSINGS:
        return np.empty(0), np.empty(0)
    near = max(1, int(CROSSING_SHARE * np.median(np.diff(beyond[turns]))))
    found = []
    for before, after in zip(beyond[turns], beyond[turns + 1], strict=True):
        start = before + 1 + int(np.argmax(values[before + 1 : after + 1] * values[before] <= 0.0))
        t, x = (row[max(0, start - near) : start + near] for row in (time, values))
        rate = float((t - t.mean()) @ x / ((t - t.mean()) @ (t - t.mean())))
        found.append((t.mean() - x.mean() / rate, noise / (abs(rate) * np.sqrt(t.size))))
    instants, sigma = np.array(found).T
    return instants, sigma


def _amplitudes(
    time: np.ndarray, values: np.ndarray, crossing: np.ndarray, noise: float
) -> tuple[np.ndarray, np.ndarray]:
    """Amplitude (m - 1,) of the half sine between crossings (m,), and its standard uncertainty  [unit]."""
    number = np.searchsorted(crossing, time) - 1
    inside = (number >= 0) & (number < crossing.size - 1)
    number, time, values = number[inside], time[inside], values[inside]
    wave = np.sin(np.pi * (time - crossing[number]) / np.diff(crossing)[number])
    power = np.bincount(number, wave**2, crossing.size - 1)
    return np.abs(np.bincount(number, wave * values, crossing.size - 1)) / power, noise / np.sqrt(power)
