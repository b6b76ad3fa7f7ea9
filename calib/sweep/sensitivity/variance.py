"""Variance-based (Sobol) indices of the parameters for an output."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from calib.sweep.sensitivity.design import SensitivityDesign
from calib.sweep.sensitivity.document import GIVEN_DATA, SALTELLI, Estimate, Influence
from calib.sweep.sensitivity.morris import CONFIDENCE
from calib.sweep.sensitivity.package import salib

SOBOL_RESAMPLES = 200  # of the bootstrap
MIN_OTHER_SAMPLES = 25  # that show another value than the most frequent one, below which no index is given  [base
# samples]; of a kind in fewer, intervals of first-order indices hold the truth in 2-78 % of designs instead of 95 %
MIN_POINTS = 40  # that show an output, below which no index is given from them
MIN_PAIRS = 20  # points A and A_Bi that both show an output, below which no total index is given from them
HARMONICS = 6  # of the mean output over a parameter's rank, whose variance is its first-order index
HALF_WIDTH = float(ndtri(0.5 * (1.0 + CONFIDENCE)))  # of an interval, in standard deviations of the bootstrap


class SaltelliRows(NamedTuple):
    """An output at the points A (n,), B (n,) and A with coordinate i from B (n, dim), scaled to unit variance."""

    a: np.ndarray
    b: np.ndarray
    ab: np.ndarray

    @classmethod
    def of(cls, design: SensitivityDesign, values: np.ndarray) -> "SaltelliRows":
        """Sort the values (size,) of an output."""
        known = values[np.isfinite(values)]
        rows = (design.grouped(values) - known.mean()) / known.std()
        return cls(rows[:, 0], rows[:, -1], rows[:, 1:-1])

    def variances(self, drawn: np.ndarray) -> np.ndarray:
        """Variance (resamples,) over all points of the base samples drawn (resamples, n); NaN where they are equal."""
        y = np.concatenate([self.a[:, None], self.ab, self.b[:, None]], axis=1)
        variances = (y**2).mean(axis=1)[drawn].mean(axis=1) - y.mean(axis=1)[drawn].mean(axis=1) ** 2
        equal = y.min(axis=1)[drawn].min(axis=1) == y.max(axis=1)[drawn].max(axis=1)
        return np.where(equal, np.nan, variances)


def sobol_influences(
    design: SensitivityDesign, names: Sequence[str], values: np.ndarray
) -> tuple[str, tuple[Influence, ...], str]:
    """Estimator, influence of each parameter on an output, and why there are none.

    Where all points show the output: the estimators of Saltelli et al. (2010), Computer Physics Communications 181,
    259, over the variance of all points. Else those of given data, from the points that do, whose parameters need not
    be independent of each other: first is that of EASI less its bias by the bootstrap (Plischke, Borgonovo and Smith
    2013, European Journal of Operational Research 226, 536, eq. 30); total is half the mean square of the difference
    between A and A with the parameter from B, over the pairs both of which show the output, over the variance. The
    bootstrap is over base samples, all points of which are drawn together.

    Parameters
    ----------
    values : (size,) of the output, NaN where a point does not show it
    """
    known = np.isfinite(values)
    if known.sum() < MIN_POINTS and not known.all():
        return GIVEN_DATA, (), f"not available: {known.sum()} points show it, {MIN_POINTS} are needed"
    estimator = SALTELLI if known.all() else GIVEN_DATA
    others = _other_samples(design.grouped(values))
    if others < MIN_OTHER_SAMPLES:
        reason = (
            f"not available: {others} of {design.groups} base samples show another value than the most frequent "
            f"one, {MIN_OTHER_SAMPLES} are needed"
        )
        return estimator, (), reason
    rows = SaltelliRows.of(design, values)
    drawn = np.random.default_rng([design.seed, 1]).integers(design.groups, size=(SOBOL_RESAMPLES, design.groups))
    if known.all():
        variances = rows.variances(drawn)
        return estimator, tuple(_complete(name, rows, axis, drawn, variances) for axis, name in enumerate(names)), ""
    points = design.grouped(design.points)
    found = [_given(name, rows, points[:, :, axis], axis, drawn) for axis, name in enumerate(names)]
    return estimator, tuple(found), ""


def _other_samples(grouped: np.ndarray) -> int:
    """Base samples with a value, among grouped ones (groups, group_size), other than the most frequent of all.

    NaN is no value.
    """
    known = np.isfinite(grouped)
    distinct, counts = np.unique(grouped[known], return_counts=True)
    return int((known & (grouped != distinct[counts.argmax()])).any(axis=1).sum())


def _complete(name: str, rows: SaltelliRows, axis: int, drawn: np.ndarray, variances: np.ndarray) -> Influence:
    """Indices of one parameter where all points show the output; `variances` (resamples,) are those of `drawn`."""
    change = rows.ab[:, axis] - rows.a

    def index(terms: np.ndarray) -> Estimate:
        return _estimated(float(terms.mean()), terms[drawn].mean(axis=1) / variances)

    first, total = index(rows.b * change), index(0.5 * change**2)  # Saltelli et al. 2010, table 2, (b) and (f)
    return Influence(name, first=first, total=total, count=rows.a.size * (2 + rows.ab.shape[1]))


def _given(name: str, rows: SaltelliRows, x: np.ndarray, axis: int, drawn: np.ndarray) -> Influence:
    """Indices of one parameter, whose coordinate is x (groups, group_size), from the points that show the output."""
    y = np.concatenate([rows.a[:, None], rows.ab, rows.b[:, None]], axis=1)

    def ratio(picked: np.ndarray | slice) -> float:
        shown = np.isfinite(y[picked])
        return easi(x[picked][shown], y[picked][shown])

    raw, resampled = ratio(slice(None)), np.array([ratio(picked) for picked in drawn])
    first = _estimated(2.0 * raw - float(np.nanmean(resampled)), resampled)
    squares = (rows.a - rows.ab[:, axis]) ** 2
    pairs = int(np.isfinite(squares).sum())
    count = int(np.isfinite(y).sum())
    if pairs < MIN_PAIRS:
        reason = (
            f"no total index: {pairs} pairs of points that differ in it alone show the output, {MIN_PAIRS} are needed"
        )
        return Influence(name, first=first, count=count, reason=reason)

    def total(picked: np.ndarray | slice) -> float:
        variance = float(np.nanvar(y[picked]))
        return 0.5 * float(np.nanmean(squares[picked])) / variance if variance > 0.0 else np.nan

    estimate = _estimated(total(slice(None)), np.array([total(picked) for picked in drawn]))
    return Influence(name, first=first, total=estimate, count=count)


def easi(x: np.ndarray, y: np.ndarray) -> float:
    """Share of the variance of y (n,) in the first harmonics of y over the rank of x (n,), biased by noise in y.

    NaN where y is constant. EASI of Plischke (2010), Reliability Engineering & System Safety 95, 354.
    """
    if not y.size or np.ptp(y) == 0.0:
        return np.nan
    analysis = salib("analyze.rbd_fast")
    return float(analysis.compute_first_order(analysis.permute_outputs(x, y), HARMONICS))


def _estimated(value: float, resampled: np.ndarray) -> Estimate:
    """Index with its interval; a resample (resamples,) of equal values, which is NaN, says nothing of it."""
    half = HALF_WIDTH * float(np.nanstd(resampled, ddof=1))
    return Estimate(value, value - half, value + half)
