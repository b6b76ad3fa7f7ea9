"""Peak of the receptance of a sweep: its height, its frequency, and their standard errors.

Near a resonance 1 / |H|^2 of one mode is a parabola over the frequency: that of the inverse, or line-fit, method
(Ewins, Modal Testing, 2nd ed. 2000, chapter 4). It is fitted between the half-power points. A peak that leans, as
that of a stiffness that depends on the amplitude, is none: by how much the minimum of a cubic through one more point on
either side differs is the least of the standard errors.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import toeplitz

from calib.records.phase_unit import HALF_POWER

MIN_PEAK_POINTS = 3  # that determine a parabola  [count]


@dataclass(frozen=True)
class Peak:
    """Peak of the receptance of a sweep.

    Attributes
    ----------
    receptance, frequency : [m per unit of the level], [Hz]
    relative_error, frequency_error : standard errors of both  [1], [Hz]
    damping_ratio : by the width of the peak; 0 where it is not resolved  [1]
    resolved : whether the sweep passes it; if not, it is the largest measured one, at an end or at a jump
    """

    receptance: float
    frequency: float
    relative_error: float = 0.0
    frequency_error: float = 0.0
    damping_ratio: float = 0.0
    resolved: bool = True

    @property
    def resonance(self) -> float:
        """Natural frequency: damping puts the largest amplitude below it, by its square to first order  [Hz]."""
        return self.frequency * (1.0 + self.damping_ratio**2)


def peak(
    frequency: np.ndarray,
    receptance: np.ndarray,
    sigma: np.ndarray,
    frequency_sigma: np.ndarray,
    correlation: np.ndarray | None = None,
) -> Peak:
    """Peak of a receptance (n,) over the frequencies (n,) of a sweep, in the order measured.

    Parameters
    ----------
    sigma, frequency_sigma : (n,) standard uncertainties of either
    correlation : (n,) of the noise of points 0, 1, 2, ... apart; None: it is uncorrelated
    """
    top = int(np.argmax(receptance))
    above = receptance >= HALF_POWER * receptance[top]
    first, last = top, top
    while first > 0 and above[first - 1]:
        first -= 1
    while last < above.size - 1 and above[last + 1]:
        last += 1
    found = None
    if first < top < last:
        rho = toeplitz((np.arange(above.size) == 0).astype(float) if correlation is None else correlation)
        own = slice(first, last + 1)
        found = _vertex(frequency[own], receptance[own], sigma[own], frequency_sigma[own], rho[own, own])
        wider = slice(max(first - 1, 0), last + 2)
        found = found and _leaning(found, frequency[wider], receptance[wider], sigma[wider])
    return found or _largest(top, frequency, receptance, sigma, frequency_sigma)


def _vertex(
    frequency: np.ndarray, receptance: np.ndarray, sigma: np.ndarray, frequency_sigma: np.ndarray, rho: np.ndarray
) -> Peak | None:
    """Vertex of the parabola through 1 / |H|^2 of points (n,) whose noise has the correlation (n, n); None without one.

    What the parabola leaves beyond the noise enlarges its errors.
    """
    scale, middle = float(np.ptp(frequency)), float(np.mean(frequency))
    x, y = (frequency - middle) / scale, receptance[np.argmax(receptance)] ** 2 / receptance**2
    own = np.vander(x, MIN_PEAK_POINTS)
    error = 2.0 * sigma / receptance * y
    for _ in range(2):  # the second time with what the frequencies contribute by the slope
        weighted = np.linalg.pinv(own / error[:, None]) / error
        a, b, c = weighted @ y
        total = np.hypot(error, (2.0 * a * x + b) * frequency_sigma / scale)
        error = total
    if not a > 0.0 or not x.min() < -b / (2.0 * a) < x.max():
        return None
    height = c - b * b / (4.0 * a)
    if not height > 0.0:
        return None
    freedom = x.size - MIN_PEAK_POINTS
    misfit = float((((y - own @ [a, b, c]) / error) ** 2).sum()) / freedom if freedom else 1.0
    covariance = max(1.0, misfit) * weighted @ (np.outer(error, error) * rho) @ weighted.T
    by_place = np.array([b / (2.0 * a * a), -1.0 / (2.0 * a), 0.0])
    by_height = np.array([b * b / (4.0 * a * a), -b / (2.0 * a), 1.0])
    place = float(middle - scale * b / (2.0 * a))
    return Peak(
        float(receptance.max() / np.sqrt(height)),
        place,
        float(np.sqrt(by_height @ covariance @ by_height) / (2.0 * height)),
        float(scale * np.sqrt(by_place @ covariance @ by_place)),
        float(scale * np.sqrt(height / a)) / place,  # y = height (1 + ((f - place) / (zeta place))^2)
    )


def _leaning(own: Peak, frequency: np.ndarray, receptance: np.ndarray, sigma: np.ndarray) -> Peak:
    """Return a peak with the errors that a cubic through 1 / |H|^2 of points (n,) around it shows."""
    if frequency.size <= MIN_PEAK_POINTS:
        return own
    scale = float(np.ptp(frequency))
    x, y = (frequency - own.frequency) / scale, (own.receptance / receptance) ** 2
    cubic = np.polynomial.Polynomial.fit(x, y, MIN_PEAK_POINTS, w=receptance / (2.0 * sigma * y))
    turns = [float(turn.real) for turn in cubic.deriv().roots() if abs(turn.imag) == 0.0]
    places = [turn for turn in turns if x.min() < turn < x.max() and cubic(turn) > 0.0]
    if not places:
        return replace(own, resolved=False)
    place = min(places, key=cubic)
    apart, height = abs(place) * scale, abs(float(cubic(place)) ** -0.5 - 1.0)
    return replace(
        own,
        relative_error=max(own.relative_error, height),
        frequency_error=max(own.frequency_error, apart),
    )


def _largest(
    top: int, frequency: np.ndarray, receptance: np.ndarray, sigma: np.ndarray, frequency_sigma: np.ndarray
) -> Peak:
    """The largest receptance, whose frequency is known to the step at which it is."""
    around = slice(max(top - 1, 0), top + 2)
    step = float(np.abs(np.diff(frequency[around])).mean()) if frequency[around].size > 1 else 0.0
    error = float(np.hypot(step / np.sqrt(6.0), frequency_sigma[top]))
    share = float(sigma[top] / receptance[top])
    return Peak(float(receptance[top]), float(frequency[top]), share, error, resolved=False)
