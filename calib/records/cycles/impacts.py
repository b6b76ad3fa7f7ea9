"""Impacts: their number per period, and the phase, velocity change and duration of the strongest."""

import numpy as np
import xarray as xr

from calib.records.cycles.loop import period_of
from calib.records.record import mean_interval
from calib.records.white_noise import white_noise_std

CONTACT_THRESHOLD = 0.2  # a body is in contact while its acceleration stands out by this share of the greatest
PULSE_HALF_WIDTH = 0.02  # half width of the neighbourhood from which an impact stands out, in periods
PULSE_FOOT = 0.1  # share of its peak below which a pulse of acceleration ends


def impacts_per_period(record: xr.Dataset) -> float:
    """Impacts per period of the excitation, NaN where the record does not list its impacts."""
    if "impact_time" not in record.variables or "frequency" not in record.attrs:
        return float("nan")
    time = record.variables["time"].values
    periods = (time[-1] - time[0] + mean_interval(record)) / period_of(record)
    return record.variables["impact_time"].size / periods


def impact(phase: np.ndarray, velocity: np.ndarray) -> tuple[float, float, float]:
    """Phase, velocity change and duration of the strongest impact, where a closed velocity loop changes fastest.

    The pulse is where the acceleration stands out from its median within +-0.02 periods, around the sample where it
    does so most and down to a tenth of that. Its centroid is the phase of the impact, its integral the change of
    velocity, and the time for which it exceeds 0.2 of its peak the contact time (ends interpolated; an instantaneous
    impact lasts up to 2.7 samples). It is an impact where the change exceeds 5 % of the velocity's amplitude and ten
    standard deviations of its noise.

    Parameters
    ----------
    phase : (n,) uniform over whole periods  [1, in periods]
    velocity : (n,)  [m/s]

    Returns
    -------
    phase of the impact in [0, periods) [1, in periods], change of velocity [m/s], contact time [1, in periods];
    NaN where there is no impact
    """
    none = (float("nan"),) * 3
    size = velocity.size
    spacing = (phase[-1] - phase[0]) / (size - 1)
    half = max(3, round(PULSE_HALF_WIDTH / spacing))
    if size < 4 * half:
        return none
    gain = np.roll(velocity, -1) - velocity  # between samples j and j + 1
    around = np.arange(-half, half + 1)
    neighbours = np.lib.stride_tricks.sliding_window_view(np.pad(gain, half, mode="wrap"), around.size)
    excess = gain - np.median(neighbours, axis=1)
    peak = int(np.argmax(np.abs(excess)))
    pulse = np.sign(excess[peak]) * excess[(peak + around) % size]
    weight = _hump(pulse - PULSE_FOOT * pulse[half], half)
    change = float(np.sign(excess[peak]) * pulse[weight > 0.0].sum())
    noise = float(white_noise_std(velocity, order=2))
    if abs(change) <= max(0.025 * np.ptp(velocity), 10.0 * noise):
        return none
    position = peak + 0.5 + (around @ weight) / weight.sum()
    contact = _width(pulse - CONTACT_THRESHOLD * pulse[half], half)
    return float((phase[0] + position * spacing) % (size * spacing)), change, float(spacing * contact)


def _hump(values: np.ndarray, centre: int) -> np.ndarray:
    """Return the values of the stretch around `centre` that is positive, zero elsewhere."""
    negative = np.flatnonzero(values <= 0.0)
    left = negative[negative < centre].max(initial=-1)
    right = negative[negative > centre].min(initial=values.size)
    hump = np.zeros_like(values)
    hump[left + 1 : right] = values[left + 1 : right]
    return hump


def _width(values: np.ndarray, centre: int) -> float:
    """Length in samples of the stretch around `centre` that is positive, its ends interpolated."""
    width = 0.0
    for side in (values[centre:], values[centre::-1]):
        below = np.flatnonzero(side <= 0.0)
        end = int(below[0]) if below.size else side.size - 1
        width += end - 1 + side[end - 1] / (side[end - 1] - side[end]) if below.size else end
    return width
