"""Emulated margin: a Gaussian process of one condition, along the axes in which it varies fastest and slowest."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist

from calib.confidence.window.observed import KIND_MARGIN
from calib.emulation.gaussian_process import GaussianProcess, fit
from calib.emulation.trend import Trend, monomials_of_trend

MIN_STD = 1e-9  # of a margin, lest a certain one be divided by zero  [1]
NEAR_BOUNDARY = 0.5  # of the margin's spread: points by which the stated errors are checked  [1]
MAX_INFLATION = 3.0  # of stated standard deviations  [1]
MIN_MARGIN_POINTS = 4  # of which a margin is emulated
POINTS_A_COEFFICIENT = 3  # of a trend
MIN_CHECKED_POINTS = 8  # near a boundary, from which stated errors are checked
POWERS = (0.0, 0.5, 1.0)  # of the power transformation of a misfit's margin  [1]
TURNS = 2  # of the axes, each by the gradients of the emulator along the axes before
GRADIENT_STEP = 1e-4  # edges of the cube


@dataclass(frozen=True, eq=False)
class EmulatedMargin:
    """One margin's emulator.

    Attributes
    ----------
    label : what bounds the window where the margin is zero
    process : emulator of the transformed margin, over positions along the axes
    axes : (dim, dim) orthonormal columns, along which correlation lengths are measured
    of_kind : whether the kind of motion changes where it is zero
    inflation : of its standard deviations, by the residuals of the points near the boundary left out one at a time
    power : of the transformation (see `transformed`)
    """

    label: str
    process: GaussianProcess
    axes: np.ndarray
    of_kind: bool
    inflation: float
    power: float = 0.0

    @property
    def scale(self) -> float:
        """Standard deviation of the transformed margin over the points it was fitted to."""
        return float(self.process.scale[0])

    @property
    def noise_variance(self) -> float:
        """Variance of the transformed margin's noise."""
        return float(self.process.noise_std[0] ** 2)

    def predicted(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation (m,) of the transformed margin at points (m, dim)."""
        emulated = self.process.predict(points @ self.axes)
        return emulated.mean[:, 0], np.maximum(self.inflation * emulated.std[:, 0], MIN_STD)

    def covariance(self, points: np.ndarray) -> np.ndarray:
        """Covariance (m, m) of the transformed margin at points (m, dim), not inflated."""
        return self.process.covariance(points @ self.axes)[0]

    def draws(self, points: np.ndarray, number: int, seed: int) -> np.ndarray:
        """Joint draws (number, m) of the transformed margin at points (m, dim)."""
        mean = self.predicted(points)[0]
        return mean + self.inflation * (self.process.draw(points @ self.axes, number, seed)[:, :, 0] - mean)


def signed_distances(points: np.ndarray, right: np.ndarray, lengths: np.ndarray | None = None) -> np.ndarray:
    """Half the distance (n,) of points (n, dim) from the nearest one of the other label, negative where wrong.

    Parameters
    ----------
    lengths : (dim,) in which distances along each axis are measured, but for their geometric mean; None: equal ones
    """
    scale = np.ones(points.shape[1]) if lengths is None else lengths / np.exp(np.log(lengths).mean())
    across = cdist(points[right] / scale, points[~right] / scale)
    signed = np.empty(len(points))
    signed[right], signed[~right] = 0.5 * across.min(axis=1), -0.5 * across.min(axis=0)
    return signed


def transformed(margins: np.ndarray, power: float) -> np.ndarray:
    """Margins after the power transformation (1 - exp(-power margin)) / power; of power 0 they are as they were.

    It keeps zero, sign and slope at zero. It is Box & Cox's (1964, J. R. Stat. Soc. B 26, 211) of (1 + r^2) / 2, whose
    negative logarithm the margin of a misfit r is: power 1 gives (1 - r^2) / 2, a quadratic wherever the residuals are
    linear in the parameters; power 0 lets far points weigh less, where these are not.
    """
    return -np.expm1(-power * margins) / power if power else margins


def emulated_margin(
    label: str,
    of_kind: bool,
    points: np.ndarray,
    values: np.ndarray,
    held: EmulatedMargin | None = None,
    variances: np.ndarray | None = None,
) -> EmulatedMargin | None:
    """Emulate a margin with the axes, trend and power that predict left-out points best; None where there are too few.

    Parameters
    ----------
    points, values : (n, dim) and (n,)
    held : an emulator of fewer points, whose axes, hyperparameters, trend and power are taken over
    variances : (n,) known ones of the values
    """
    if len(points) < MIN_MARGIN_POINTS:
        return None
    near = _near_boundary(values)
    if held is not None:
        axes, power = held.axes, held.power
        process = held.process.given(points @ axes, transformed(values, power)[:, None], variances)
    else:
        fits = [
            (process, axes, power)
            for power in ((0.0,) if of_kind else POWERS)
            for process, axes in _fits(points, transformed(values, power), near, variances)
        ]
        process, axes, power = max(
            fits, key=lambda own: _predictive_density(own[0], near) - own[2] * values[near].mean()
        )
    return EmulatedMargin(label, process, axes, of_kind, _inflation(process, near), power)


def kind_margin(points: np.ndarray, right: np.ndarray, held: EmulatedMargin | None = None) -> EmulatedMargin | None:
    """Margin of a kind of which nothing is known but the label: the signed distance from where it changes.

    A change lies anywhere on the way to the nearest point of the other kind, evenly so: its distance is half that way,
    with a variance of a third of the square of this half. Close pairs tell the boundary, others little. What is near is
    measured in the correlation lengths that the margin has by distances in all directions alike.

    Parameters
    ----------
    points, right : (n, dim), (n,) whether each is of the kind
    held : an emulator of fewer points
    """
    metric = held
    if metric is None:
        signed = signed_distances(points, right)
        metric = emulated_margin(KIND_MARGIN, True, points, signed, variances=signed**2 / 3.0)
    if metric is None:
        return None
    signed = signed_distances(points @ metric.axes, right, metric.process.lengths[0])
    return emulated_margin(KIND_MARGIN, True, points, signed, held, signed**2 / 3.0)


def _fits(
    points: np.ndarray, values: np.ndarray, near: np.ndarray, variances: np.ndarray | None
) -> list[tuple[GaussianProcess, np.ndarray]]:
    """Emulators along the cube's axes and turned ones, and with each trend that the points suffice for.

    A window that is narrow across some direction and long along others has no single correlation length for any
    parameter. The principal axes of the gradients near the boundary (Constantine, Dow & Wang 2014, SIAM J. Sci. Comput.
    36, A1500) are directions in which the margin varies fastest and slowest; along them it has.
    """
    axes = np.eye(points.shape[1])
    fits = [(fit(points, values, Trend.CONSTANT, variances=variances), axes)]
    for _ in range(TURNS):
        axes = axes @ _principal_axes(fits[-1][0], points[near] @ axes)
        fits.append((fit(points @ axes, values, Trend.CONSTANT, variances=variances), axes))
    process, axes = max(fits, key=lambda own: _predictive_density(own[0], near))
    for trend in (Trend.LINEAR, Trend.QUADRATIC):
        if len(points) >= POINTS_A_COEFFICIENT * monomials_of_trend(points[:1], trend).shape[1]:
            fits.append((fit(points @ axes, values, trend, process, variances), axes))
    return fits


def _principal_axes(process: GaussianProcess, positions: np.ndarray) -> np.ndarray:
    """Orthonormal columns (dim, dim): principal axes of the gradients at positions (k, dim), the steepest first."""
    count, dim = positions.shape
    steps = GRADIENT_STEP * np.eye(dim)
    either = np.stack([positions + sign * step for step in steps for sign in (1.0, -1.0)])
    mean = process.predict(either.reshape(-1, dim)).mean[:, 0].reshape(dim, 2, count)
    gradients = (mean[:, 0] - mean[:, 1]) / (2.0 * GRADIENT_STEP)
    return np.linalg.eigh(gradients @ gradients.T)[1][:, ::-1]


def _predictive_density(process: GaussianProcess, near: np.ndarray) -> float:
    """Mean logarithm of the predictive density of the points `near` the boundary, left out one at a time.

    Of a transformed value; that of the margin itself has the logarithm of the transformation's slope, minus power times
    margin, beside it.
    """
    left_out = process.leave_one_out()
    residuals, std = left_out.residuals[near, 0], left_out.std[near, 0]
    return float(np.mean(-np.log(std) - 0.5 * (residuals / std) ** 2))


def _inflation(process: GaussianProcess, near: np.ndarray) -> float:
    """Root mean square of the standardised residuals of the points `near` the boundary, at least 1."""
    left_out = process.leave_one_out()
    z = left_out.residuals[near, 0] / left_out.std[near, 0]
    return float(np.clip(np.sqrt(np.mean(z**2)), 1.0, MAX_INFLATION))


def _near_boundary(margins: np.ndarray) -> np.ndarray:
    """Which points (n,) are near the boundary: all, where these are few."""
    near = np.abs(margins) < NEAR_BOUNDARY * margins.std()
    return near if near.sum() >= MIN_CHECKED_POINTS else np.ones(len(near), dtype=bool)
