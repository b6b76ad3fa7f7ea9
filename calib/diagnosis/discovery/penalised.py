"""Fits of models with free forces: all parameters at once, the forces as smooth as the data let them be.

Steps of Gauss and Newton on the penalised sum of squares; at each of them the weight of the penalty is that of
the linearised problem (the performance iteration of Gu, Journal of the American Statistical Association 87 (1992)
1051). Calibrated parameters, causes that the model has and nuisances are free at the same time.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.diagnosis.bench import Run, simulated
from calib.diagnosis.candidate import Candidate
from calib.diagnosis.discovery.free_force import DISPLACEMENT, VELOCITY, FreeForce
from calib.diagnosis.discovery.smoothing import Smoothing
from calib.diagnosis.fit import Fit
from calib.diagnosis.refit import Fitter, extended, updated
from calib.diagnosis.score import Projection
from calib.diagnosis.signature import Direction, Point

MAX_PENALISED_STEPS = 20  # of a fit  [count]
MAX_PENALISED_HALVINGS = 6  # of a step that does not reduce the penalised sum of squares  [count]
MIN_PENALISED_REDUCTION = 0.2  # of the penalised sum of squares, over the mean square: a smaller one ends a fit  [1]
MIN_RELIABLE_GAIN = 0.7  # actual over predicted reduction, below which derivatives are taken anew  [1]


@dataclass(frozen=True, eq=False)
class States:
    """States of a body that simulations visit.

    Attributes
    ----------
    x, v : (n,) displacements [m] and velocities [m/s], of all records one after the other
    """

    x: np.ndarray
    v: np.ndarray

    @property
    def region(self) -> dict[str, tuple[float, float]]:
        """Least and largest value of each argument."""
        both = {DISPLACEMENT: self.x, VELOCITY: self.v}
        return {name: (float(values.min()), float(values.max())) for name, values in both.items()}


def visited_states(fitter: Fitter, point: Point, body: str) -> States:
    """States of a body in the simulations of all records."""
    rows = ((body, "displacement"), (body, "velocity"))
    runs: list[Run] = [replace(run, rows=rows) for run in point.runs(fitter.evidence.names)]
    views = [view.rows for view in simulated(fitter.pool, runs) if view.usable]
    return States(*np.concatenate(views, axis=1)) if views else States(np.zeros(0), np.zeros(0))


@dataclass(frozen=True, eq=False)
class FreeModel:
    """Free forces that act together, as candidates of a diagnosis.

    Attributes
    ----------
    forces : additive
    candidates : of each
    states : of the body, over which the forces are as small as the data let them be
    """

    forces: tuple[FreeForce, ...]
    candidates: tuple[Candidate, ...]
    states: States

    @property
    def coefficients(self) -> list[str]:
        """Names of all coefficients."""
        return [name for force in self.forces for name in force.coefficients]

    @cached_property
    def visited(self) -> np.ndarray:
        """Basis functions of all forces at the visited states (n, p)."""
        return self.matrix(self.states.x, self.states.v)

    def matrix(self, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Basis functions (n, p) of all forces at displacements (n,) [m] and velocities (n,) [m/s]."""
        return np.column_stack([force.matrix(x, v) for force in self.forces])

    @cached_property
    def differences(self) -> np.ndarray:
        """Second differences (k, p) of all forces."""
        blocks = [force.roughness for force in self.forces]
        whole = np.zeros((sum(len(b) for b in blocks), sum(b.shape[1] for b in blocks)))
        row = column = 0
        for block in blocks:
            whole[row : row + len(block), column : column + block.shape[1]] = block
            row, column = row + len(block), column + block.shape[1]
        return whole

    @property
    def scale(self) -> float:
        """Natural scale of the force per unit mass  [m/s^2]."""
        return next(iter(self.candidates[0].scale.values()))


@dataclass(frozen=True, eq=False)
class PenalisedFit:
    """A model with free forces, fitted.

    Attributes
    ----------
    fit : with the derivatives at its own point
    model : the free forces
    smoothing : the problem for their coefficients, linearised there
    weight : of the penalty
    """

    fit: Fit
    model: FreeModel
    smoothing: Smoothing
    weight: float

    @property
    def coefficients(self) -> np.ndarray:
        """Coefficients (p,) of all forces  [m/s^2]."""
        return np.array([self.fit.value(name) for name in self.model.coefficients])

    @property
    def effective_parameters(self) -> float:
        """Effective number of coefficients."""
        return self.smoothing.effective_parameters(self.weight)

    @property
    def dispersion(self) -> float:
        """Mean square of the residual, in units of the variance of the noise; at least 1."""
        return max(1.0, self.fit.chi2 / max(1.0, self.smoothing.freedom))

    def surface(self, x: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Force per unit mass (n,) and its standard error (n,) at states (n,), without what calibration absorbs."""
        return self.combination(self.model.matrix(x, v))

    def combination(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values (n,) and standard errors of rows (n, p) by the coefficients, without what calibration absorbs."""
        basis = rows @ self.smoothing.gauge(self.model.visited)
        variance = np.sum((basis @ self.smoothing.covariance(self.weight)) * basis, axis=1)
        return basis @ self.coefficients, np.sqrt(self.dispersion * np.maximum(0.0, variance))


def penalised_fit(
    fitter: Fitter,
    base: Fit,
    model: FreeModel,
    columns: np.ndarray | None = None,
    begin: Mapping[str, float] | None = None,
) -> PenalisedFit:
    """Fit calibrated parameters, causes and the coefficients of free forces.

    Parameters
    ----------
    base : the model without the forces
    columns : (N, p) derivatives by the coefficients where the forces are absent; None: computed
    begin : values by name in the place of those of the base and of absent forces; None, or where the simulation of a
        record fails there: these
    """
    candidates = (*base.candidates, *model.candidates)
    values = {name: value for c in model.candidates for name, value in c.absent().items()} | dict(begin or {})
    start = extended(base.point, candidates, values)
    directions = fitter.directions(start, candidates)
    x = np.array([d.at for d in directions])
    now = replace(base, point=start, candidates=candidates, names=tuple(d.name for d in directions))
    elsewhere = fitter.evaluated(start, directions, x, candidates, solved=True) if begin else None
    if begin and elsewhere is None:  # a record cannot be simulated there
        return penalised_fit(fitter, base, model, columns)
    fresh = columns is None or elsewhere is not None
    if elsewhere is not None:
        now = fitter.with_derivatives(elsewhere)
    elif columns is None:
        now = fitter.with_derivatives(now)
    else:
        now = replace(now, columns=np.column_stack([base.columns, columns]))
    for _ in range(MAX_PENALISED_STEPS):
        ahead = _advanced(fitter, now, model, directions, x)
        if ahead is None:
            if fresh:
                break
            now, fresh = fitter.with_derivatives(now), True
            continue
        x_ahead, fit, gain = ahead
        fresh = gain < MIN_RELIABLE_GAIN
        now, x = fitter.with_derivatives(fit) if fresh else updated(fit, now, x_ahead - x), x_ahead
    if not fresh:
        now = fitter.with_derivatives(now)
    smoothing = linearised(now, model, now.residual.size)
    return PenalisedFit(now, model, smoothing, smoothing.weight)


def linearised(fit: Fit, model: FreeModel, count: float) -> Smoothing:
    """Return the problem for the coefficients, linearised about a fit.

    count : of the residuals
    """
    own = np.isin(fit.names, model.coefficients)
    whole = fit.free(fit.columns)
    others = Projection(np.column_stack([whole[:, ~own], fit.nuisances]))
    columns = whole[:, own]
    projected = others(columns)
    value = np.array([fit.value(name) for name in np.array(fit.names)[own]])
    target = others(fit.residual + columns @ value)
    return Smoothing.of(
        columns, projected, target, count - others.rank, model.differences, model.visited, model.scale
    )  # fmt: skip


def _advanced(
    fitter: Fitter, now: Fit, model: FreeModel, directions: Sequence[Direction], x: np.ndarray
) -> tuple[np.ndarray, Fit, float] | None:
    """Parameters and fit after a step, and its actual over its predicted reduction; None where none reduces further."""
    own = np.isin(now.names, model.coefficients)
    smoothing = linearised(now, model, now.residual.size)
    weight = smoothing.weight
    step = np.zeros(x.size)
    step[own] = smoothing.coefficients(weight) - x[own]
    columns = now.free(now.columns)
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0.0] = 1.0
    remainder = now.residual - columns[:, own] @ step[own]
    step[~own] = np.linalg.lstsq(columns[:, ~own] / scale[~own], remainder, rcond=1e-9)[0] / scale[~own]
    low, high = np.array([d.low for d in directions]), np.array([d.high for d in directions])
    before = now.chi2 + smoothing.penalty(weight, x[own])
    for halving in range(MAX_PENALISED_HALVINGS):
        x_ahead = np.clip(x + 0.5**halving * step, low, high)
        change = columns @ (x_ahead - x)
        left = now.residual - change
        predicted = before - float(left @ left) - smoothing.penalty(weight, x_ahead[own])
        if halving == 0 and predicted < MIN_PENALISED_REDUCTION * max(1.0, now.chi2 / now.residual.size):
            return None
        fit = fitter.evaluated(now.point, directions, x_ahead, now.candidates, now.columns @ (x_ahead - x))
        if fit is None:
            continue
        reduction = before - fit.chi2 - smoothing.penalty(weight, x_ahead[own])
        if reduction > 0.0:
            return x_ahead, fit, reduction / max(predicted, 1e-300)
    return None
