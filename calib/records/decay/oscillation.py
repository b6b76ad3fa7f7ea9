"""A slowly varying oscillation in sampled values, by least squares: splines for logarithm of amplitude and phase."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import cho_factor, cho_solve

TINY = float(np.finfo(float).tiny)  # against division by zero
MAX_OSCILLATION_STEPS = 40  # of Gauss and Newton
MAX_OSCILLATION_HALVINGS = 12  # of one step
PHASE_TOLERANCE_RAD = 1e-9  # largest change of log amplitude or phase at which a search ends  [rad]
MAX_TRIAL_STEPS = 8  # of a fit that is only compared with others: one that takes more is far from the best
MAX_PHASE_STEP_RAD = 1.0  # of log amplitude or phase in one step  [rad]
SPLINE_RIDGE = 1e-10  # of the normal equations with columns of unit size: holds what no sample sees  [1]
SQUARE_ROUNDING = 1e-12  # of a sum of squares, by which it may rise in a step  [1]


@dataclass(frozen=True, eq=False)
class SplineBasis:
    """B-splines over an interval of time.

    Attributes
    ----------
    knots : with the ends repeated  [s]
    degree : of the polynomials
    """

    knots: np.ndarray
    degree: int

    @classmethod
    def between(cls, breaks: np.ndarray, degree: int) -> "SplineBasis":
        """B-splines with these breaks, the ends included  [s]."""
        return cls(np.concatenate([[breaks[0]] * degree, breaks, [breaks[-1]] * degree]), degree)

    @property
    def size(self) -> int:
        """Number of splines."""
        return int(self.knots.size - self.degree - 1)

    @property
    def range(self) -> tuple[float, float]:
        """First and last instant  [s]."""
        return float(self.knots[0]), float(self.knots[-1])

    @property
    def sites(self) -> np.ndarray:
        """Coefficients (size,) of the function t: the averages of successive knots (Greville)  [s]."""
        return np.array([self.knots[k + 1 : k + 1 + self.degree].mean() for k in range(self.size)])

    def local(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values (n, degree + 1) of the splines that are not 0 at these instants, and the number (n,) of the first."""
        sparse = BSpline.design_matrix(time, self.knots, self.degree)
        order = self.degree + 1
        return sparse.data.reshape(-1, order), sparse.indices[::order]

    def matrix(self, time: np.ndarray, derivative: int = 0) -> np.ndarray:
        """Values (n, size) of the splines, or of a derivative, at these instants  [1/s^derivative]."""
        return np.asarray(BSpline(self.knots, np.eye(self.size), self.degree)(time, derivative))


@dataclass(frozen=True, eq=False)
class Oscillation:
    """x = G_0 + Re[exp(p)] + sum of Re[G_m exp(i m phase)] + sum of Re[G_j exp(-i omega_j t)], splines over time.

    Attributes
    ----------
    basis : of all splines
    log_amplitude, phase : (size,) coefficients of p = log amplitude + i phase  [1], [rad]
    mean : (size,) coefficients of G_0  [unit]
    companions : (j, 2, size) coefficients of the real and the imaginary part of each G_j  [unit]
    harmonics : (m, 2, size) those of each G_m  [unit]
    time, residual : (n,) instants of all samples  [s], measured minus fitted  [unit]
    used : (n,) whether a sample is fitted, or left out as an outlier
    covariance : (2 size, 2 size) of log amplitude and phase where a sample has variance 1
    linear_terms : splines that are fitted beside log amplitude and phase
    """

    basis: SplineBasis
    log_amplitude: np.ndarray
    phase: np.ndarray
    mean: np.ndarray
    companions: np.ndarray
    harmonics: np.ndarray
    time: np.ndarray
    residual: np.ndarray
    used: np.ndarray
    covariance: np.ndarray
    linear_terms: int


class _SplineColumns:
    """Columns that are splines times factors (n, term) of the samples, of which few are not 0 in any one row."""

    def __init__(self, basis: SplineBasis, time: np.ndarray):
        self.splines, self.first = basis.local(time)
        self.size = basis.size
        self.of_spline = self.first[:, None] + np.arange(basis.degree + 1)
        ends = np.flatnonzero(np.diff(self.first)) + 1
        self.pieces = [slice(*ends) for ends in zip([0, *ends], [*ends, time.size], strict=True)]

    def spline(self, coefficients: np.ndarray) -> np.ndarray:
        """Spline (n,) with these coefficients (size,)."""
        return np.einsum("ij,ij->i", self.splines, coefficients[self.of_spline])

    def combined(self, factors: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """Sum (n,) of factors (n, term) times splines with these coefficients (term, size)."""
        return np.asarray(sum(f * self.spline(c) for f, c in zip(factors.T, coefficients, strict=True)))

    def equations(self, factors: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Normal matrix (term * size, term * size) of the columns, and their products with values (n,)."""
        terms = factors.shape[1]
        normal, right = np.zeros((terms * self.size,) * 2), np.zeros(terms * self.size)
        for piece in self.pieces:
            rows = (factors[piece, :, None] * self.splines[piece, None, :]).reshape(piece.stop - piece.start, -1)
            at = (self.size * np.arange(terms)[:, None] + self.of_spline[piece.start]).ravel()
            normal[np.ix_(at, at)] += rows.T @ rows
            right[at] += rows.T @ values[piece]
        return normal, right


class _OscillationView(NamedTuple):
    """The fit at some log amplitude and phase, its linear unknowns at their best.

    factors : (n, term) of the splines: slopes over log amplitude and phase, then those of the linear unknowns
    linear : (term - 2, size)
    residual : (n,)
    square : sum over the samples that are used
    """

    factors: np.ndarray
    linear: np.ndarray
    residual: np.ndarray
    square: float


class _OscillationFit:
    """The least-squares problem of the oscillation."""

    def __init__(
        self,
        time: np.ndarray,
        values: np.ndarray,
        basis: SplineBasis,
        harmonics: Sequence[int],
        companions: Sequence[float],
        used: np.ndarray,
    ):
        self.values, self.harmonics, self.used = values, harmonics, used.astype(float)
        self.columns = _SplineColumns(basis, time)
        turns = [np.exp(2j * np.pi * frequency * time) for frequency in companions]
        self.fixed = [np.ones(time.size), *(part for turn in turns for part in (turn.real, turn.imag))]

    def view(self, log_amplitude: np.ndarray, phase: np.ndarray) -> _OscillationView:
        columns = self.columns
        angle = columns.spline(phase)
        turns = [np.exp(1j * m * angle) for m in self.harmonics]
        factors = np.column_stack([*self.fixed, *(part for turn in turns for part in (turn.real, turn.imag))])
        carrier = np.exp(columns.spline(log_amplitude) + 1j * angle)
        remainder = self.values - carrier.real
        linear = _solved(*self.equations(factors, remainder)).reshape(-1, columns.size)
        rate = -carrier.imag  # of the model over the phase
        for m, turn, parts in zip(
            self.harmonics, turns, linear[len(self.fixed) :].reshape(-1, 2, columns.size), strict=True
        ):
            rate = rate + m * (columns.spline(parts[1]) * turn.real - columns.spline(parts[0]) * turn.imag)
        every = np.column_stack([carrier.real, rate, factors])
        residual = remainder - columns.combined(factors, linear)
        return _OscillationView(every, linear, residual, float(self.used @ residual**2))

    def equations(self, factors: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Normal equations of the samples that are used."""
        return self.columns.equations(self.used[:, None] * factors, self.used * values)

    def step(self, now: _OscillationView) -> np.ndarray:
        """Step (2, size) of log amplitude and phase by Gauss and Newton."""
        whole = _solved(*self.equations(now.factors, now.residual))
        return whole[: 2 * self.columns.size].reshape(2, -1)

    def ahead(
        self, now: _OscillationView, state: np.ndarray, step: np.ndarray
    ) -> tuple[np.ndarray, _OscillationView] | None:
        """State and view after the step, halved until the sum of squares does not rise; None where it always does."""
        for halving in range(MAX_OSCILLATION_HALVINGS):
            there = state + 0.5**halving * step
            view = self.view(*there)
            if view.square <= now.square * (1.0 + SQUARE_ROUNDING):
                return there, view
        return None


def fitted(
    time: np.ndarray,
    values: np.ndarray,
    basis: SplineBasis,
    start: np.ndarray,
    harmonics: Sequence[int],
    companions: Sequence[float],
    used: np.ndarray,
    steps: int = MAX_OSCILLATION_STEPS,
) -> Oscillation:
    """Fit an oscillation to samples by Gauss-Newton steps.

    Parameters
    ----------
    time, values : (n,)  [s], [unit]
    basis : of log amplitude and phase, and of what goes with them
    start : (2, size) coefficients of log amplitude and phase to begin with
    harmonics : orders of the harmonics that go with it
    companions : frequencies of other modes  [Hz]
    used : (n,) whether a sample is fitted
    steps : at most
    """
    search, state, size = _OscillationFit(time, values, basis, harmonics, companions, used), start, basis.size
    now = search.view(*state)
    for _ in range(steps):
        step = search.step(now)
        ahead = search.ahead(now, state, step * min(1.0, MAX_PHASE_STEP_RAD / max(np.abs(step).max(), TINY)))
        if ahead is None:
            break
        moved = float(np.abs(ahead[0] - state).max())
        state, now = ahead
        if moved <= PHASE_TOLERANCE_RAD:
            break
    normal, _ = search.equations(now.factors, now.residual)
    return Oscillation(
        basis=basis,
        log_amplitude=state[0],
        phase=state[1],
        mean=now.linear[0],
        companions=now.linear[1 : 1 + 2 * len(companions)].reshape(-1, 2, size),
        harmonics=now.linear[1 + 2 * len(companions) :].reshape(-1, 2, size),
        time=time,
        residual=now.residual,
        used=used,
        covariance=_solved(normal, np.eye(len(normal), 2 * size))[: 2 * size],
        linear_terms=len(now.linear),
    )


def _solved(normal: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solution of normal equations, its columns brought to unit size, with a small ridge."""
    size = np.diag(normal)
    scale = 1.0 / np.sqrt(np.maximum(size, SPLINE_RIDGE**2 * size.max() + TINY))
    factor = cho_factor(normal * np.outer(scale, scale) + SPLINE_RIDGE * np.eye(size.size), check_finite=False)
    return np.asarray((cho_solve(factor, (scale * right.T).T, check_finite=False).T * scale).T)
