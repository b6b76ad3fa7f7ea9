"""Emulated region: the probability that a point is admissible, from an emulator of each margin."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist
from scipy.stats import norm

from calib.confidence.window.observed import KIND_MARGIN, Observed
from calib.emulation.gaussian_process import GaussianProcess, fit
from calib.emulation.trend import Trend, monomials_of_trend

MIN_STD = 1e-9  # of a margin, lest a certain one be divided by zero  [1]
EXPLAINED_PROBABILITY = 0.5  # of a kind's margins being positive, below which they explain another kind  [1]
NEAR_BOUNDARY = 0.5  # of the margin's spread: points by which the stated errors are checked  [1]
MAX_INFLATION = 3.0  # of stated standard deviations  [1]
MIN_MARGIN_POINTS = 4  # of which a margin is emulated
POINTS_A_COEFFICIENT = 3  # of a trend
MIN_CHECKED_POINTS = 8  # near a boundary, from which stated errors are checked
POWERS = (0.0, 0.5, 1.0)  # of the power transformation of a misfit's margin  [1]


@dataclass(frozen=True, eq=False)
class EmulatedMargin:
    """One margin's emulator.

    Attributes
    ----------
    label : what bounds the window where the margin is zero
    process : emulator of the transformed margin
    of_kind : whether the kind of motion changes where it is zero
    inflation : of its standard deviations, by the residuals of the points near the boundary left out one at a time
    power : of the transformation (see `transformed`)
    """

    label: str
    process: GaussianProcess
    of_kind: bool
    inflation: float
    power: float = 0.0

    def predicted(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation (m,) of the transformed margin at points (m, dim)."""
        emulated = self.process.predict(points)
        return emulated.mean[:, 0], np.maximum(self.inflation * emulated.std[:, 0], MIN_STD)


@dataclass(frozen=True, eq=False)
class Region:
    """Emulated region of the unit cube in which all margins are positive; there may be none.

    Attributes
    ----------
    margins : emulators of all of them, that of the kind among them where other margins do not explain it
    """

    margins: tuple[EmulatedMargin, ...]

    @property
    def labels(self) -> tuple[str, ...]:
        """What may bound the region."""
        return tuple(margin.label for margin in self.margins)

    def met(self, points: np.ndarray) -> np.ndarray:
        """Probability (m, margins) that each margin is positive at points (m, dim)."""
        columns = []
        for margin in self.margins:
            mean, std = margin.predicted(points)
            columns.append(norm.cdf(mean / std))
        return np.column_stack(columns) if columns else np.ones((len(points), 0))

    def probability(self, points: np.ndarray) -> np.ndarray:
        """Probability (m,) that points (m, dim) are admissible."""
        return self.met(points).prod(axis=1)

    def log_probability(self, points: np.ndarray) -> np.ndarray:
        """Natural logarithm (m,) of the probability that points (m, dim) are admissible, finite far outside too."""
        total = np.zeros(len(points))
        for margin in self.margins:
            mean, std = margin.predicted(points)
            total += norm.logcdf(mean / std)
        return total

    def kind(self, points: np.ndarray) -> np.ndarray:
        """Probability (m,) that the motion is of the measured kind at points (m, dim)."""
        met = self.met(points)
        return met[:, [margin.of_kind for margin in self.margins]].prod(axis=1)

    def draws(self, points: np.ndarray, number: int, seed: int) -> np.ndarray:
        """Draws (number, m) of whether points (m, dim) are admissible, jointly."""
        inside = np.ones((number, len(points)), dtype=bool)
        for k, margin in enumerate(self.margins):
            mean = margin.process.predict(points).mean[:, 0]
            drawn = margin.process.draw(points, number, seed + k)[:, :, 0]
            inside &= mean + margin.inflation * (drawn - mean) > 0
        return inside


def emulated(observed: Observed, held: Region | None = None) -> Region | None:
    """Emulate the region from what was observed; None where no point is of the measured kind, or they are too few.

    Parameters
    ----------
    held : a region of fewer points, whose hyperparameters and trends are taken over
    """
    known = {} if held is None else {margin.label: margin for margin in held.margins}
    margins = []
    for k, (label, of_kind) in enumerate(zip(observed.labels, observed.of_kind, strict=True)):
        shown = observed.right & np.isfinite(observed.margins[:, k])
        points, values = observed.points[shown], observed.margins[shown, k]
        margins.append(_emulated_margin(label, of_kind, points, values, known.get(label)))
    region = Region(_explaining([margin for margin in margins if margin is not None], observed.points[~observed.right]))
    unexplained = ~observed.right
    if unexplained.any():
        unexplained[unexplained] = region.kind(observed.points[unexplained]) > EXPLAINED_PROBABILITY
    if unexplained.any() and observed.right.any():
        used, own = observed.right | unexplained, known.get(KIND_MARGIN)
        points, right = observed.points[used], observed.right[used]
        if own is None:
            own = _kind_margin(points, right)
        if own is not None:
            own = _kind_margin(points, right, own.process.lengths[0], known.get(KIND_MARGIN))
        region = Region((*region.margins, *([] if own is None else [own])))
    return region if region.margins else None


def _explaining(margins: Sequence[EmulatedMargin], wrong: np.ndarray) -> tuple[EmulatedMargin, ...]:
    """Margins without those of a kind that explain none of the points (k, dim) of another kind.

    The clearance of a motion, say, falls to zero also where an impact appears and the kind stays.
    """
    return tuple(
        margin
        for margin in margins
        if not margin.of_kind or (len(wrong) and (Region((margin,)).probability(wrong) < EXPLAINED_PROBABILITY).any())
    )


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


def _emulated_margin(
    label: str,
    of_kind: bool,
    points: np.ndarray,
    values: np.ndarray,
    held: EmulatedMargin | None = None,
    variances: np.ndarray | None = None,
) -> EmulatedMargin | None:
    """Emulate a margin with the trend and the power that predict left-out points best; None where there are too few."""
    if len(points) < MIN_MARGIN_POINTS:
        return None
    near = _near_boundary(values)
    if held is not None:
        process, power = held.process.given(points, transformed(values, held.power)[:, None], variances), held.power
    else:
        fits = [
            (process, power)
            for power in ((0.0,) if of_kind else POWERS)
            for process in _fits(points, transformed(values, power), variances)
        ]
        process, power = max(fits, key=lambda own: _predictive_density(own[0], near) - own[1] * values[near].mean())
    return EmulatedMargin(label, process, of_kind, _inflation(process, near), power)


def _kind_margin(
    points: np.ndarray, right: np.ndarray, lengths: np.ndarray | None = None, held: EmulatedMargin | None = None
) -> EmulatedMargin | None:
    """Margin of a kind of which nothing is known but the label: the signed distance from where it changes.

    A change lies anywhere on the way to the nearest point of the other kind, evenly so: its distance is half that way,
    with a variance of a third of the square of this half. Close pairs tell the boundary, others little.
    """
    signed = signed_distances(points, right, lengths)
    return _emulated_margin(KIND_MARGIN, True, points, signed, held, signed**2 / 3.0)


def _fits(points: np.ndarray, values: np.ndarray, variances: np.ndarray | None) -> list[GaussianProcess]:
    """Emulators with each trend that the points suffice for."""
    fits = [fit(points, values, Trend.CONSTANT, variances=variances)]
    for trend in (Trend.LINEAR, Trend.QUADRATIC):
        if len(points) >= POINTS_A_COEFFICIENT * monomials_of_trend(points[:1], trend).shape[1]:
            fits.append(fit(points, values, trend, fits[0], variances))
    return fits


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
