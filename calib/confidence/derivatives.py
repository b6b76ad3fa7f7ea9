"""Derivatives of the residuals by the parameters: difference quotients with two steps that are compared.

Three places difference a simulation whose noise is not known beforehand; they share the comparison of slopes
(`relative_difference`, `MAX_SLOPE_DIFFERENCE`), and choose their steps each by what its derivatives are for:

- Here a standard error is reported, at a minimum: differences are central, and the second step is a share of the
  standard error that the first one implies, with the residuals of the best point as the only measure of noise.
- `calib.diagnosis.signature` tests parameters at the edge of their range, where an effect is absent: differences are
  one-sided, and a step is scaled to a given response of the records in units of their noise, which is known there.
- `calib.optimisers.least_squares` needs a descent direction only, at the scale of its trust region: one step, whose
  quality the next gain ratio shows. Optimisers import only `execution` of this program.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np

from calib.records import OK
from calib.records.cycles import UNDECIDED
from calib.study import Outcome

FIRST_WINDOW_STEP = 1e-3  # of the window  [1]
SECOND_WINDOW_STEP_BOUNDS = (1e-6, 5e-2)  # of the window  [1]
SECOND_STEP_ERRORS = 0.3  # second step, in standard errors of the parameter  [1]
MIN_STEP_RATIO = 3.0  # of the two steps, either way  [1]: nearer steps give no independent slopes
REPLACED_STEP_RATIO = 5.0  # of the two steps where they would be nearer  [1]
MOTION_STEP_REDUCTION = 30.0  # of the first step where it leads to another kind of motion  [1]
MAX_SLOPE_DIFFERENCE = 0.10  # relative, of slopes by two steps that count as equal  [1]; convention
MAX_CLAIMED_DIFFERENCE = 0.50  # relative, beyond which no derivative is claimed  [1]; convention

Evaluate = Callable[[np.ndarray], Sequence[Outcome]]


def differentiate(evaluate: Evaluate, names: Sequence[str], u: np.ndarray, centre: Outcome) -> tuple[np.ndarray, str]:
    """Jacobian (m, dim) of the residuals in the unit cube at `u`; and the reason where there is none, else "".

    Central differences, one-sided at an edge of the window and where one neighbour has failed or moves in another way
    than the centre. The second step is about a third of the standard error that the first one implies: slopes are
    wanted at the scale of the interval, above the numerical noise of the simulation.
    """
    residuals = np.asarray(centre.residuals, dtype=float)
    noise = math.sqrt(residuals @ residuals / max(1, residuals.size - u.size)) or 1e-12
    first = np.full(u.size, FIRST_WINDOW_STEP)
    columns, _ = _quotients(evaluate, u, centre, first)
    failed = [k for k in range(u.size) if columns[k] is None]
    sensitivity = np.array([0.0 if column is None else np.linalg.norm(column) for column in columns])
    second = np.clip(SECOND_STEP_ERRORS * noise / np.maximum(sensitivity, 1e-300), *SECOND_WINDOW_STEP_BOUNDS)
    near = (second > first / MIN_STEP_RATIO) & (second < MIN_STEP_RATIO * first)
    replaced = np.where(second > first, REPLACED_STEP_RATIO * first, first / REPLACED_STEP_RATIO)
    second = np.where(near, replaced, second)
    second[failed] = first[failed] / MOTION_STEP_REDUCTION
    others, reasons = _quotients(evaluate, u, centre, second)
    lost = [k for k in failed if others[k] is None]
    if lost:
        return np.empty((0, 0)), (
            f"no neighbour along {names[lost[0]]} can be compared with the best point: {reasons[lost[0]]}"
        )
    tried = [[c for c in pair if c is not None] for pair in zip(others, columns, strict=True)]
    doubtful = [
        k for k, own in enumerate(tried) if len(own) < 2 or not _agree(own[0], own[1], MAX_SLOPE_DIFFERENCE, noise)
    ]
    if doubtful:
        third = np.where(np.isin(np.arange(u.size), failed), second / MIN_STEP_RATIO, np.sqrt(first * second))
        again, _ = _quotients(evaluate, u, centre, third, only=doubtful)
        tried = [own if column is None else [*own, column] for own, column in zip(tried, again, strict=True)]
    chosen = [_most_consistent(slopes) for slopes in tried]
    unresolved = [
        names[k]
        for k in doubtful
        if not any(
            _agree(chosen[k], slope, MAX_CLAIMED_DIFFERENCE, noise) for slope in tried[k] if slope is not chosen[k]
        )
    ]
    if unresolved:
        return np.empty((0, 0)), (
            "the residuals are not differentiable about the best point with respect to "
            f"{', '.join(unresolved)}: two steps give slopes that differ by more than half"
        )
    return np.column_stack(chosen), ""


def _quotients(
    evaluate: Evaluate, u: np.ndarray, centre: Outcome, steps: np.ndarray, only: Sequence[int] | None = None
) -> tuple[list[np.ndarray | None], dict[int, str]]:
    """Difference quotients (m,) along each axis with `steps` (dim,), None where there is none; {axis: why}.

    only : axes along which they are taken; None: all
    """
    axes = range(u.size) if only is None else only
    ends = [(k, min(1.0, max(0.0, u[k] + sign * steps[k]))) for k in axes for sign in (-1.0, 1.0)]
    ends = [(k, x) for k, x in ends if x != u[k]]
    points = np.repeat(u[None], len(ends), axis=0)
    points[np.arange(len(ends)), [k for k, _ in ends]] = [x for _, x in ends]
    usable: dict[int, list[tuple[float, np.ndarray]]] = {k: [] for k in axes}
    reasons = {}
    for (k, x), outcome in zip(ends, evaluate(points), strict=True):
        reason = why_unusable(outcome, centre)
        if reason:
            reasons[k] = reason
        else:
            usable[k].append((x, np.asarray(outcome.residuals, dtype=float)))
    quotients: list[np.ndarray | None] = [None] * u.size
    for k in axes:
        if len(usable[k]) == 1:
            usable[k].append((u[k], np.asarray(centre.residuals, dtype=float)))
        if len(usable[k]) == 2:
            (low, first), (high, second) = usable[k]
            quotients[k] = (second - first) / (high - low)
    return quotients, reasons


def why_unusable(outcome: Outcome, centre: Outcome) -> str:
    """Why an outcome cannot be compared with that of the centre; "" where it can."""
    if outcome.status != OK:
        return f"its simulation ended with status {outcome.status!r}"
    if outcome.residuals is None or not np.all(np.isfinite(outcome.residuals)):
        return "it has no finite residuals"
    if outcome.kind != centre.kind and UNDECIDED not in f"{outcome.kind} {centre.kind}":  # undecided is no other kind
        return f"its motion is {outcome.kind}, not {centre.kind}"
    expected = np.asarray(centre.residuals)
    if outcome.residuals.shape != expected.shape:
        return f"it has {outcome.residuals.size} residuals, not {expected.size}"
    return ""


def relative_difference(one: np.ndarray, other: np.ndarray) -> float:
    """Norm of the difference of two slopes (m,) over the larger of their norms; 0 where both are zero  [1]."""
    length = max(float(np.linalg.norm(one)), float(np.linalg.norm(other)))
    return float(np.linalg.norm(other - one) / length) if length > 0.0 else 0.0


def _agree(one: np.ndarray, other: np.ndarray, tolerance: float, noise: float) -> bool:
    """Whether two slopes are equal, or both so small that the whole window changes the residuals by less than noise."""
    if relative_difference(one, other) <= tolerance:
        return True
    return max(float(np.linalg.norm(one)), float(np.linalg.norm(other))) < noise


def _most_consistent(slopes: list[np.ndarray]) -> np.ndarray:
    """Return the first of the slopes (two steps), or one of the two of three that agree best."""
    pairs = [(one, other) for i, one in enumerate(slopes) for other in slopes[i + 1 :]]
    return min(pairs, key=lambda pair: relative_difference(*pair))[0] if len(pairs) > 1 else slopes[0]
