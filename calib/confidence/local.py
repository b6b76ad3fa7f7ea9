"""Confidence in the values at the best point, from the residuals in its neighbourhood (see `covariance`)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy
from scipy.special import ndtr

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
MIN_REALISED_REDUCTION = 0.5  # of the sum of squares, over that which the linearised problem predicts  [1]; convention
INTERVAL_QUANTILE = float(ndtr(2.0))  # probability below +2 standard errors of a normal variable  [1]


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

    Intervals are about a minimum. Where the linearised problem has its own farther away than the standard error, that
    is simulated: they are widened by the distance where it fits as well as predicted, and there are none where not.

    Parameters
    ----------
    evaluate : points (n, dim) in [0, 1] -> n outcomes with .residuals (m,) or None, .status, .kind; called up to five
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
    counted = _Counted(evaluate)
    if outcome is None:
        (outcome,) = counted(u[None])
    missing = _why_not_analysed(outcome, space.dim)
    if missing:
        return _without_intervals(space, u, missing, counted)
    residuals = np.asarray(outcome.residuals, dtype=float)
    if blocks is not None and np.shape(blocks) != residuals.shape:
        raise CalibError(f"expected one block number per residual, shape {residuals.shape}, got {np.shape(blocks)}")
    if noise_draws is not None and noise_draws.shape[1:] != residuals.shape:
        raise CalibError(f"expected noise_draws of shape (number, {residuals.size}), got {noise_draws.shape}")
    jacobian, trouble = differentiate(counted, space.names, u, outcome)
    if trouble:
        return _without_intervals(space, u, trouble, counted)
    labels = np.zeros(residuals.size, dtype=int) if blocks is None else np.asarray(blocks)
    covariance, freedom = sandwich(jacobian, residuals, labels, noise_draws)
    linearised = Linearised(residuals, jacobian, unit_covariance(jacobian), covariance, freedom)
    step = distance_to_minimum(jacobian, residuals, u)
    reason, misled = _beside_minimum(counted, space.names, u, outcome, linearised, step)
    if misled:
        return replace(_without_intervals(space, u, reason, counted), linearised=linearised)
    groups = undetermined_combinations(space, u, covariance)
    found = _assemble(space, u, covariance + np.diag(step**2), freedom, reason, groups, counted.number)
    return replace(found, linearised=linearised)


def _why_not_analysed(outcome: Outcome, dim: int) -> str:
    """Why nothing can be said about a point with this outcome, of `dim` parameters; "" where it can."""
    missing = why_unusable(outcome, outcome)
    if missing:
        return f"the best point itself cannot be used: {missing}"
    number = np.asarray(outcome.residuals).size
    return (
        "" if number > dim else f"{number} residuals cannot determine {dim} parameters; score more features or records"
    )


def _without_intervals(space: Space, u: np.ndarray, reason: str, counted: "_Counted") -> Confidence:
    return Confidence(
        "not available", reason, space.names, _values(space, u), at_edge=at_edge(space.names, u),
        evaluations=counted.number,
    )  # fmt: skip


def _values(space: Space, u: np.ndarray) -> dict[str, float]:
    values = space.values(u)
    return {name: values[name] for name in space.names}


def at_edge(names: Sequence[str], u: np.ndarray) -> dict[str, str]:
    """Name the parameters whose position (dim,) lies at an end of the window, with the end."""
    low = {name: "low" for name, x in zip(names, u, strict=True) if x <= MAX_EDGE_DISTANCE}
    return low | {name: "high" for name, x in zip(names, u, strict=True) if x >= 1.0 - MAX_EDGE_DISTANCE}


def _assemble(
    space: Space,
    u: np.ndarray,
    covariance: np.ndarray,
    freedom: np.ndarray,
    reason: str,
    groups: tuple[UndeterminedGroup, ...],
    evaluations: int,
) -> Confidence:
    """Errors and intervals in the units of the parameters, from a covariance (dim, dim) in the unit cube."""
    value, error = _values(space, u), np.sqrt(np.diag(covariance))
    half = scipy.stats.t.ppf(INTERVAL_QUANTILE, freedom) * error
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
        at_edge=at_edge(space.names, u),
        degrees_of_freedom=dict(zip(space.names, freedom.tolist(), strict=True)),
        evaluations=evaluations,
    )


def _beside_minimum(
    evaluate: Evaluate, names: Sequence[str], u: np.ndarray, outcome: Outcome, linearised: Linearised, step: np.ndarray
) -> tuple[str, bool]:
    """What to say of a point (dim,) with its outcome that is a step (dim,) from the minimum of the linearised problem.

    Returns
    -------
    a sentence, "" where the step is within the errors; and whether a simulation shows that there is no minimum there
    """
    error = np.sqrt(np.diag(linearised.covariance))
    far = [name for name, d, s in zip(names, step, error, strict=True) if abs(d) > max(s, MIN_REPORTED_STEP)]
    if not far:
        return "", False
    [there] = evaluate((u + step)[None])
    missing = _not_as_predicted(linearised.residuals + linearised.jacobian @ step, outcome, there)
    if not missing:
        return (
            f"the search ended before the best value of {', '.join(far)} was reached; "
            "the intervals were widened by the distance to it"
        ), False
    return (
        f"the search did not end at a minimum: the residuals still fall towards another value of {', '.join(far)}, and "
        f"{missing}; give the search a larger budget, or let calib confidence fit it once more"
    ), True


def _not_as_predicted(predicted: np.ndarray, centre: Outcome, there: Outcome) -> str:
    """Why a simulation does not fall short of the centre as predicted residuals (m,) do; "" where it does."""
    missing = why_unusable(there, centre)
    if missing:
        return f"the simulation that they lead to cannot be compared: {missing}"
    now, least, simulated = (
        float(np.linalg.norm(np.asarray(own, dtype=float))) for own in (centre.residuals, predicted, there.residuals)
    )
    if now**2 - simulated**2 >= MIN_REALISED_REDUCTION * (now**2 - least**2):
        return ""
    return f"there they come to {simulated:.3g}, not to {least:.3g} from {now:.3g} as their slopes say"


class _Counted:
    """An evaluation that counts its points."""

    def __init__(self, evaluate: Evaluate):
        self.evaluate = evaluate
        self.number = 0

    def __call__(self, points: np.ndarray) -> Sequence[Outcome]:
        self.number += len(points)
        return self.evaluate(points)
