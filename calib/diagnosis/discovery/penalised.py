"""Fits of models with free forces: all parameters at once, the forces as smooth as the data let them be.

Steps of Gauss and Newton on the penalised sum of squares, damped where the whole step reduces it too little
(Marquardt, SIAM Journal on Applied Mathematics 11 (1963) 431); at each of them the weight of the penalty is that of
the linearised problem (the performance iteration of Gu, Journal of the American Statistical Association 87 (1992)
1051). A force that changes the motion altogether has further minima, the more the more parameters it has: fits begin
with few effective parameters, from the minimum of which they go on with those that the data let them have. Calibrated
parameters, causes that the model has and nuisances are free at the same time.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from calib.diagnosis.bench import Run, simulated
from calib.diagnosis.candidate import Candidate
from calib.diagnosis.discovery.free_force import DISPLACEMENT, VELOCITY, FreeForce
from calib.diagnosis.discovery.place import ForcePlace
from calib.diagnosis.discovery.smoothing import Smoothing
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.excess import degrees_of_freedom
from calib.diagnosis.fit import Fit
from calib.diagnosis.refit import (
    MAX_GAIN_RATIO,
    MIN_STEPS_BEFORE_ABANDONING,
    Fitter,
    extended,
    updated,
)
from calib.diagnosis.score import Projection
from calib.diagnosis.signature import Direction, Point

MAX_PENALISED_STEPS = 20  # of a fit  [count]
MAX_DAMPINGS = 8  # of a step that does not reduce the penalised sum of squares  [count]
MIN_DAMPING, DAMPING_FACTOR = 0.01, 5.0  # share of the diagonal that is added, the first and its growth  [1]
SHARE_OF_EACH = 1e-3  # of the prior of a sum, by which each of its forces is small  [1]
MIN_GAIN = 0.05  # actual over predicted reduction, below which a step is damped further  [1]
STAGES = 3.0, np.inf  # effective parameters beyond linear that each function may have, one after the other  [1]
MIN_PENALISED_REDUCTION = 0.2  # of the penalised sum of squares, over the mean square: a smaller one ends a fit  [1]
MIN_RELIABLE_GAIN = 0.7  # actual over predicted reduction, below which derivatives are taken anew  [1]


@dataclass(frozen=True, eq=False)
class States:
    """States of a body, or at an interface, that simulations visit.

    Attributes
    ----------
    x, v : (n,) displacements, or clearances [m], and velocities, or rates [m/s], of all records one after the other
    """

    x: np.ndarray
    v: np.ndarray

    @property
    def region(self) -> dict[str, tuple[float, float]]:
        """Least and largest value of each argument."""
        both = {DISPLACEMENT: self.x, VELOCITY: self.v}
        return {name: (float(values.min()), float(values.max())) for name, values in both.items()}


def visited_states(fitter: Fitter, point: Point, place: ForcePlace) -> States:
    """States that a force law sees at a place in the simulations of all records."""
    runs: list[Run] = [replace(run, rows=place.rows) for run in point.runs(fitter.evidence.names)]
    views = [place.states(view.rows, point.values) for view in simulated(fitter.pool, runs) if view.usable]
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
    def differences(self) -> list[np.ndarray]:
        """Second differences (k, p) along each argument of each force."""
        rows, first = [], 0
        for force in self.forces:
            for own in force.roughness:
                rows.append(np.zeros((len(own), len(self.coefficients))))
                rows[-1][:, first : first + own.shape[1]] = own
            first += len(force.coefficients)
        return rows

    @cached_property
    def prior(self) -> np.ndarray:
        """Mean square (p, p) of the force over the visited states, over that of its natural scale.

        That of each of the forces counts a little: a constant may be a part of either of two, and is shared by them.
        """
        each = block_diag(*(force.matrix(self.states.x, self.states.v) for force in self.forces))
        squares = self.visited.T @ self.visited + SHARE_OF_EACH * each.T @ each
        return squares / (len(self.visited) * self.scale**2)

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
        return max(1.0, self.fit.chi2 / max(1.0, self.smoothing.freedom - self.effective_parameters))

    def degrees_of_freedom(self, evidence: Evidence) -> float:
        """Degrees of freedom of the residual: of the coefficients only the effective ones count.

        The number of residuals less the trace of the influence matrix (Wood, Generalized Additive Models, 2017, section
        6.1.2).
        """
        others = degrees_of_freedom(evidence, self.fit) + len(self.model.coefficients)
        return max(1.0, others - self.effective_parameters)

    def surface(self, x: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Force per unit mass (n,) and its standard error (n,) at states (n,), without what calibration absorbs."""
        return self.combination(self.model.matrix(x, v))

    def combination(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values (n,) and standard errors of rows (n, p) by the coefficients, without what calibration absorbs."""
        basis = rows @ self.smoothing.gauge(self.model.visited)
        return basis @ self.coefficients, np.sqrt(self.dispersion) * self.smoothing.errors(basis, self.weight)


def penalised_fit(
    fitter: Fitter,
    base: Fit,
    model: FreeModel,
    columns: np.ndarray | None = None,
    begin: Mapping[str, float] | None = None,
    rival: float = np.inf,
) -> PenalisedFit:
    """Fit calibrated parameters, causes and the coefficients of free forces.

    Parameters
    ----------
    base : the model without the forces
    columns : (N, p) derivatives by the coefficients where the forces are absent; None: computed
    begin : values by name in the place of those of the base and of absent forces; None, or where the simulation of a
        record fails there: these
    rival : chi-square that another model attains: a fit that is predicted to attain no less is abandoned after a few
        steps
    """
    candidates = (*base.candidates, *model.candidates)
    values = {name: value for c in model.candidates for name, value in c.absent().items()} | dict(begin or {})
    start = extended(base.point, candidates, values)
    directions = fitter.directions(start, candidates)
    x = np.clip([d.at for d in directions], *_bounds(directions))
    names = tuple(d.name for d in directions)
    now = replace(base, point=start, candidates=candidates, names=names, relative_errors=())
    elsewhere = fitter.evaluated(start, directions, x, candidates, solved=True) if begin else None
    if begin and elsewhere is None:  # a record cannot be simulated there
        return penalised_fit(fitter, base, model, columns, rival=rival)
    fresh = columns is None or elsewhere is not None
    if elsewhere is not None:
        now = fitter.with_derivatives(elsewhere)
    elif columns is None:
        now = fitter.with_derivatives(now)
    else:
        now = replace(now, columns=np.column_stack([base.columns, columns]))
    for allowed in STAGES if elsewhere is None else STAGES[-1:]:
        now, x, fresh, abandoned = _minimised(fitter, now, model, directions, x, fresh, allowed, rival)
        if abandoned:
            break
    if not (fresh or abandoned):
        now = fitter.with_derivatives(now)
    smoothing = linearised(now, model)
    return PenalisedFit(now, model, smoothing, smoothing.weight)


def nested(richer: PenalisedFit, model: FreeModel) -> tuple[float, dict[str, float]]:
    """Penalised sum of squares and values at the minimum of a model of fewer forces, linearised about a richer fit."""
    fit, coefficients = richer.fit, set(richer.model.coefficients) - set(model.coefficients)
    shared = np.array([name not in coefficients for name in fit.names])
    names = tuple(np.array(fit.names)[shared].tolist())
    x = np.array([fit.value(name) for name in fit.names])
    columns = fit.free(fit.columns)
    residual = fit.residual + columns[:, ~shared] @ x[~shared]
    without = replace(fit, residual=residual, columns=fit.columns[:, shared], names=names, relative_errors=())
    smoothing = linearised(without, model)
    own, weight = np.isin(names, model.coefficients), smoothing.weight
    step = _step(without.residual, columns[:, shared], own, smoothing, weight, x[shared], 0.0)
    ahead, left = x[shared] + step, without.residual - columns[:, shared] @ step
    total = float(left @ left) + smoothing.penalty(weight, ahead[own])
    return total, {name: float(value) for name, value in zip(names, ahead, strict=True)}


def linearised(fit: Fit, model: FreeModel) -> Smoothing:
    """Return the problem for the coefficients, linearised about a fit."""
    own = np.isin(fit.names, model.coefficients)
    whole = fit.free(fit.columns)
    others = Projection(np.column_stack([whole[:, ~own], fit.nuisances]))
    columns = whole[:, own]
    projected = others(columns)
    value = np.array([fit.value(name) for name in np.array(fit.names)[own]])
    target = others(fit.residual + columns @ value)
    counted = (fit.residual != 0.0) | whole.any(axis=1)  # the others have no weight
    freedom = float(np.count_nonzero(counted)) - others.rank
    return Smoothing.of(columns, projected, target, freedom, model.differences, model.prior)


@dataclass(frozen=True, eq=False)
class _Advance:
    """A step of a fit.

    Attributes
    ----------
    converged : whether no further reduction of the penalised sum of squares is predicted
    x, fit : after the step; None where none was taken
    predicted : reduction of the penalised sum of squares
    gain : actual over predicted reduction  [1]
    damping : of the next step  [1]
    negligible : whether a further step would end the fit if it brought no more than this one
    """

    converged: bool
    x: np.ndarray | None = None
    fit: Fit | None = None
    predicted: float = 0.0
    gain: float = 0.0
    damping: float = 0.0
    negligible: bool = False


def _minimised(
    fitter: Fitter,
    now: Fit,
    model: FreeModel,
    directions: Sequence[Direction],
    x: np.ndarray,
    fresh: bool,
    allowed: float,
    rival: float,
) -> tuple[Fit, np.ndarray, bool, bool]:
    """Fit, parameters, and whether its derivatives are those at its point, where no step reduces the penalised sum.

    And whether the fit was abandoned, beside a rival.

    allowed : effective parameters of each function, beyond linear ones; where there is a limit, the minimum is a start
        for the next fit, and derivatives that were updated on the way may show it
    """
    damping = 0.0
    for number in range(MAX_PENALISED_STEPS):
        ahead = _advanced(fitter, now, model, directions, x, allowed, damping)
        if ahead.fit is None or ahead.x is None:
            if fresh or (ahead.converged and np.isfinite(allowed)):
                break
            now, fresh = fitter.with_derivatives(now), True
            continue
        ended, damping = fresh and ahead.negligible, ahead.damping
        abandoned = number >= MIN_STEPS_BEFORE_ABANDONING and ahead.fit.chi2 - MAX_GAIN_RATIO * ahead.predicted > rival
        fresh = ahead.gain < MIN_RELIABLE_GAIN and not (ended or abandoned)
        now = fitter.with_derivatives(ahead.fit) if fresh else updated(ahead.fit, now, ahead.x - x)
        x = ahead.x
        if ended or abandoned:
            return now, x, ended, abandoned
    return now, x, fresh, False


def _advanced(
    fitter: Fitter,
    now: Fit,
    model: FreeModel,
    directions: Sequence[Direction],
    x: np.ndarray,
    allowed: float,
    damping: float,
) -> _Advance:
    """Take a step, damped the more the longer none reduces the penalised sum of squares."""
    own = np.isin(now.names, model.coefficients)
    columns = now.free(now.columns)
    least = MIN_PENALISED_REDUCTION * max(1.0, now.chi2 / now.residual.size)
    for number in range(MAX_DAMPINGS):
        x_ahead, smoothing, weight = _ahead(now, model, x, _bounds(directions), allowed, damping)
        before = now.chi2 + smoothing.penalty(weight, x[own])
        left = now.residual - columns @ (x_ahead - x)
        predicted = before - float(left @ left) - smoothing.penalty(weight, x_ahead[own])
        if predicted < least and number == 0 and damping > 0.0:
            damping = 0.0  # that of the step before hides what is left
            continue
        if predicted < least:
            return _Advance(converged=damping == 0.0)
        fit = fitter.evaluated(now.point, directions, x_ahead, now.candidates, now.columns @ (x_ahead - x))
        reduction = -1.0 if fit is None else before - fit.chi2 - smoothing.penalty(weight, x_ahead[own])
        if fit is not None and reduction > MIN_GAIN * predicted:
            eased = damping / DAMPING_FACTOR if reduction > MIN_RELIABLE_GAIN * predicted else damping
            damping = eased if eased >= MIN_DAMPING else 0.0
            return _Advance(False, x_ahead, fit, predicted, reduction / predicted, damping, reduction < least)
        damping = max(MIN_DAMPING, DAMPING_FACTOR * damping)
    return _Advance(converged=False)


def _ahead(
    now: Fit,
    model: FreeModel,
    x: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    allowed: float,
    damping: float,
) -> tuple[np.ndarray, Smoothing, float]:
    """Parameters after a damped step within bounds, the problem for the coefficients, and the weight of the penalty.

    Those that would leave their bounds are held there, and the others are solved for beside them.
    """
    columns, own = now.free(now.columns), np.isin(now.names, model.coefficients)
    step, held = np.zeros(x.size), np.zeros(x.size, dtype=bool)
    while True:
        names = tuple(np.array(now.names)[~held].tolist())
        beside = replace(
            now, residual=now.residual - columns @ step, columns=now.columns[:, ~held], names=names, relative_errors=()
        )
        smoothing = linearised(beside, model)
        weight = smoothing.weight_of(allowed * len(model.forces))
        whole = step.copy()
        whole[~held] = _step(beside.residual, columns[:, ~held], own[~held], smoothing, weight, x[~held], damping)
        inside = np.clip(x + whole, *bounds)
        beyond = (inside != x + whole) & ~held
        if not beyond.any():
            return inside, smoothing, weight
        step[beyond] = (inside - x)[beyond]
        held |= beyond


def _bounds(directions: Sequence[Direction]) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest values (k,) of parameters."""
    return np.array([d.low for d in directions]), np.array([d.high for d in directions])


def _step(
    residual: np.ndarray,
    columns: np.ndarray,
    own: np.ndarray,
    smoothing: Smoothing,
    weight: float,
    x: np.ndarray,
    damping: float,
) -> np.ndarray:
    """Step (k,) of Gauss and Newton, damped after Marquardt: of the coefficients `own`, then of the others."""
    step = np.zeros(x.size)
    step[own] = smoothing.coefficients(weight, damping, x[own]) - x[own]
    scale = np.linalg.norm(columns[:, ~own], axis=0)
    scale[scale == 0.0] = 1.0
    rows = np.vstack([columns[:, ~own] / scale, np.sqrt(damping) * np.eye(scale.size)])
    target = np.concatenate([residual - columns[:, own] @ step[own], np.zeros(scale.size)])
    step[~own] = np.linalg.lstsq(rows, target, rcond=1e-9)[0] / scale
    return step
