"""Frequency and damping ratio of a free decay over its amplitude, by its smoother and by its analytic signal."""

import numpy as np
import xarray as xr

from calib.errors import CalibError
from calib.records.decay.analytic_signal import analytic_signal
from calib.records.decay.dataset import curves_dataset
from calib.records.decay.oscillation import Oscillation
from calib.records.decay.smoother import SmoothedDecay

AMPLITUDE_POINTS = 24  # amplitudes at which the curves are told
FINE_POINTS = 800  # instants between which amplitudes are interpolated
MIN_FALL = 0.1  # of the logarithm of the amplitude, of a motion that decays  [1]
LEAST_DESCENT = 1e-12  # between instants, by which an amplitude that does not fall is made to  [1]


def over_amplitude(one: Oscillation, log_amplitude: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Instant, frequency and damping ratio (m,) of an oscillation where it passes these amplitudes  [s], [Hz], [1].

    Amplitudes that it does not pass take the values at the nearest end.

    log_amplitude : (m,) natural logarithms
    """
    fine = np.linspace(*one.basis.range, FINE_POINTS)
    fall = -np.minimum.accumulate(one.basis.matrix(fine) @ one.log_amplitude) + LEAST_DESCENT * np.arange(fine.size)
    time = np.interp(-log_amplitude, fall, fine)
    return time, *at_instants(one, time)


def at_instants(one: Oscillation, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Damped frequency  [Hz] and damping ratio  [1] (m,) of an oscillation at these instants  [s]."""
    slopes = one.basis.matrix(time, 1)
    omega, rate = slopes @ one.phase, -slopes @ one.log_amplitude
    return omega / (2.0 * np.pi), rate / np.hypot(omega, rate)


def amplitude_curves(decay: SmoothedDecay) -> xr.Dataset:
    """Frequency and damping ratio at amplitudes in geometric progression, with their standard uncertainties.

    The first and the last amplitude are half a step within the range: a motion released nearly alike passes them too.

    The noise is propagated through the splines and through the amplitude itself; the mean squared difference
    of the fits with other numbers of splines, by their weights, is added.

    Raises
    ------
    CalibError : the amplitude does not fall
    """
    one = decay.oscillation
    ends = np.minimum.accumulate(one.basis.matrix(np.linspace(*one.basis.range, FINE_POINTS)) @ one.log_amplitude)
    if ends[0] - ends[-1] < MIN_FALL:
        (start, end), fall = one.basis.range, -np.expm1(ends[-1] - ends[0])
        raise CalibError(
            f"expected a motion that decays, got one whose amplitude falls by {100.0 * fall:.2g} % in "
            f"{end - start:.4g} s; record longer, or compare it by another feature"
        )
    share = (np.arange(AMPLITUDE_POINTS) + 0.5) / AMPLITUDE_POINTS
    log_amplitude = ends[0] + share * (ends[-1] - ends[0])
    time, frequency, damping = over_amplitude(one, log_amplitude)
    variance = _variance(one, time, decay.noise)
    for other in decay.alternatives:
        beside = np.array(over_amplitude(other.oscillation, log_amplitude)[1:])
        variance += other.weight * np.square(beside - [frequency, damping])
    sigma = np.sqrt(variance)
    return curves_dataset(
        time, np.exp(log_amplitude), frequency, damping, *sigma, attrs={"method": "smoother", **decay.facts}
    )


def analytic_curves(decay: SmoothedDecay) -> xr.Dataset:
    """Frequency and damping ratio at every sample but those near the ends, by the Hilbert transform.

    Log amplitude and phase are averaged over one period before their slopes are taken; no uncertainty is known.
    """
    tone = analytic_signal(*decay.without_mean)
    inside = tone.inside
    omega, rate = 2.0 * np.pi * tone.frequency, tone.decay_rate
    damping = rate / np.hypot(omega, rate)
    return curves_dataset(
        tone.time[inside],
        tone.amplitude[inside],
        tone.frequency[inside],
        damping[inside],
        attrs={"method": "analytic signal"},
    )


def _variance(one: Oscillation, time: np.ndarray, noise: float) -> np.ndarray:
    """Variance (2, m) of frequency  [Hz^2] and damping ratio  [1] at the amplitudes passed at these instants."""
    values, slopes = one.basis.matrix(time), one.basis.matrix(time, 1)
    bends = one.basis.matrix(time, 2) if one.basis.degree > 1 else np.zeros_like(slopes)
    rate, omega = -slopes @ one.log_amplitude, slopes @ one.phase
    own = np.hypot(rate, omega)
    later = np.where(rate > 0.0, 1.0 / np.where(rate > 0.0, rate, 1.0), 0.0)[:, None] * values  # of a larger amplitude
    none = np.zeros_like(values)
    of_omega = np.hstack([(bends @ one.phase)[:, None] * later, slopes])
    of_rate = np.hstack([-(bends @ one.log_amplitude)[:, None] * later - slopes, none])
    of_damping = (omega / own**3)[:, None] * (omega[:, None] * of_rate - rate[:, None] * of_omega)
    rows = np.stack([of_omega / (2.0 * np.pi), of_damping])
    return np.asarray(noise**2 * np.einsum("qij,jk,qik->qi", rows, one.covariance, rows))
