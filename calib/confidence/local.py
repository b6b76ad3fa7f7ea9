"""Confidence in the values at the best point, from the residuals in its neighbourhood (see `covariance`)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import stats

from calib.confidence.covariance import distance_to_minimum, sandwich, unit_covariance
from calib.confidence.derivatives import Evaluate, differentiate, why_unusable
from calib.confidence.identifiability import undetermined_combinations
from calib.errors import CalibError
from calib.modelling.parameter import Space
from calib.records import OK
from calib.store.plain import plain, typed
from calib.study import ConfidenceSummary, CorrelationSummary, Outcome, UndeterminedGroup

MAX_EDGE_DISTANCE = 1e-3  # of the window: a value nearer to its end is at its edge  [1]
MIN_REPORTED_STEP = 1e-6  # of the window: a search that ends nearer to the minimum has converged  [1]
INTERVAL_QUANTILE = stats.norm.cdf(2.0)  # probability below +2 standard errors of a normal variable  [1]


@dataclass(frozen=True, eq=False)
class Linearised:
    """The least-squares problem linearised at a point of the unit cube, and what the noise does to its estimate.

    Attributes
    ----------
    residuals : (m,) at the point
    jacobian : (m, dim) of them, in the unit cube
    unit_covariance : (dim, dim) of the estimate under white noise of unit variance
    covariance : (dim, dim) under the noise as the residuals show it; without the distance to the minimum
    degrees_of_freedom : (dim,) of its variances
    """

    residuals: np.ndarray
    jacobian: np.ndarray
    unit_covariance: np.ndarray
    covariance: np.ndarray
    degrees_of_freedom: np.ndarray


@dataclass(frozen=True)
class Confidence:
    """Standard errors, intervals and what is not determined, at one point.

    standard_error is in SI (of a log window: value times the standard error of the logarithm; infinite where it exceeds
    the window); interval is (low, high) in SI, the 2-standard-error interval, asymmetric for log windows and cut at the
    window; correlation (dim, dim) in the order of `names`; at_edge says "low" or "high". All empty where `status` is
    "not available"; `reason` is then why, else a warning or "", and `linearised` is what they were worked out from.
    """

    status: str
    reason: str
    names: tuple[str, ...]
    value: Mapping[str, float]
    standard_error: Mapping[str, float] = field(default_factory=dict)
    interval: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    correlation: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    undetermined: tuple[UndeterminedGroup, ...] = ()
    at_edge: Mapping[str, str] = field(default_factory=dict)
    degrees_of_freedom: Mapping[str, float] = field(default_factory=dict)
    evaluations: int = 0
    linearised: Linearised | None = field(default=None, compare=False, repr=False)

    def summary(self) -> ConfidenceSummary:
        """Return the same for the result of a calibration: None for what is not finite."""
        summary = ConfidenceSummary(
            status=self.status,
            reason=self.reason,
            standard_error=self.standard_error,
            interval=self.interval,
            correlation=CorrelationSummary(self.names, tuple(map(tuple, self.correlation.tolist()))),
            undetermined=self.undetermined,
            at_edge=self.at_edge,
            degrees_of_freedom=self.degrees_of_freedom,
            evaluations=self.evaluations,
        )
        return typed(ConfidenceSummary, plain(summary))


def local(
    evaluate: Evaluate,
    space: Space,
    u: np.ndarray,
    *,
    outcome: Outcome | None = None,
    blocks: np.ndarray | None = None,
    noise_draws: np.ndarray | None = None,
) -> Confidence:
    """Confidence in the values at `u`, from differences of the residuals about it.

    Parameters
    ----------
    evaluate : points (n, dim) in [0, 1] -> n outcomes with .residuals (m,) or None, .status, .kind; called up to four
        times, with at most about 2 dim points each
    space : the searched parameters with their windows
    u : (dim,) the best point [1]
    outcome : what `evaluate` gave there, where it is known
    blocks : (m,) integers, equal for residuals of one term, record, body and channel; in time or phase order inside
        a block. None: one block
    noise_draws : (number, m) changes of the residuals by noise in the measurement
        (`calib.confidence.noise_propagation`); of use where several terms compare one channel

    Raises
    ------
    CalibError
        When `u`, `blocks` or `noise_draws` has the wrong shape.
    """
    u = np.asarray(u, dtype=float)
    values = space.values(u)
    value = {name: values[name] for name in space.names}
    edges = at_edge(space.names, u)
    counted = _Counted(evaluate)
    if outcome is None:
        (outcome,) = counted(u[None])
    missing = why_unusable(outcome, outcome)
    if missing:
        reason = f"the best point itself cannot be used: {missing}"
        return Confidence("not available", reason, space.names, value, at_edge=edges, evaluations=counted.number)
    residuals = np.asarray(outcome.residuals, dtype=float)
    if blocks is not None and np.shape(blocks) != residuals.shape:
        raise CalibError(f"expected one block number per residual, shape {residuals.shape}, got {np.shape(blocks)}")
    if noise_draws is not None and noise_draws.shape[1:] != residuals.shape:
        raise CalibError(f"expected noise_draws of shape (number, {residuals.size}), got {noise_draws.shape}")
    if residuals.size <= space.dim:
        reason = f"{residuals.size} residuals cannot determine {space.dim} parameters; score more features or records"
        return Confidence("not available", reason, space.names, value, at_edge=edges, evaluations=counted.number)
    jacobian, trouble = differentiate(counted, space.names, u, outcome)
    if trouble:
        return Confidence("not available", trouble, space.names, value, at_edge=edges, evaluations=counted.number)
    labels = np.zeros(residuals.size, dtype=int) if blocks is None else np.asarray(blocks)
    covariance, freedom = sandwich(jacobian, residuals, labels, noise_draws)
    free = np.array([name not in edges for name in space.names])
    step = distance_to_minimum(jacobian, residuals, free)
    reason = _unconverged(space.names, step, np.sqrt(np.diag(covariance)))
    groups = undetermined_combinations(space, u, covariance)
    linearised = Linearised(residuals, jacobian, unit_covariance(jacobian), covariance, freedom)
    covariance = covariance + np.diag(step**2)
    found = _assemble(space, u, value, covariance, freedom, edges, reason, groups, counted.number)
    return replace(found, linearised=linearised)


def at_edge(names: Sequence[str], u: np.ndarray) -> dict[str, str]:
    """Name the parameters whose position (dim,) lies at an end of the window, with the end."""
    low = {name: "low" for name, x in zip(names, u, strict=True) if x <= MAX_EDGE_DISTANCE}
    return low | {name: "high" for name, x in zip(names, u, strict=True) if x >= 1.0 - MAX_EDGE_DISTANCE}


def _assemble(
    space: Space,
    u: np.ndarray,
    value: Mapping[str, float],
    covariance: np.ndarray,
    freedom: np.ndarray,
    edges: Mapping[str, str],
    reason: str,
    groups: tuple[UndeterminedGroup, ...],
    evaluations: int,
) -> Confidence:
    """Errors and intervals in the units of the parameters, from a covariance (dim, dim) in the unit cube."""
    error = np.sqrt(np.diag(covariance))
    half = stats.t.ppf(INTERVAL_QUANTILE, freedom) * error
    standard_error, interval = {}, {}
    for k, (name, window) in enumerate(space.windows.items()):
        standard_error[name] = float(error[k] * window.slope(value[name])) if error[k] <= 1.0 else math.inf
        interval[name] = (window.value(u[k] - half[k]), window.value(u[k] + half[k]))
    outer = np.maximum(np.outer(error, error), 1e-300)
    return Confidence(
        OK,
        reason,
        space.names,
        value,
        standard_error,
        interval,
        correlation=covariance / outer,
        undetermined=groups,
        at_edge=edges,
        degrees_of_freedom=dict(zip(space.names, freedom.tolist(), strict=True)),
        evaluations=evaluations,
    )


def _unconverged(names: Sequence[str], step: np.ndarray, error: np.ndarray) -> str:
    """Warn of parameters (dim,) whose step to the minimum exceeds their error; "" where none does."""
    far = [name for name, d, s in zip(names, step, error, strict=True) if abs(d) > max(s, MIN_REPORTED_STEP)]
    if not far:
        return ""
    return (
        f"the search ended before the best value of {', '.join(far)} was reached; "
        "the intervals were widened by the distance to it"
    )


class _Counted:
    """An evaluation that counts its points."""

    def __init__(self, evaluate: Evaluate):
        self.evaluate = evaluate
        self.number = 0

    def __call__(self, points: np.ndarray) -> Sequence[Outcome]:
        self.number += len(points)
        return self.evaluate(points)
