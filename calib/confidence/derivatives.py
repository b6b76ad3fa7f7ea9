"""How the residuals change with the parameters, by differences that are checked against each other."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from calib.records import OK
from calib.records.cycles import UNDECIDED
from calib.study import Outcome

STEP = 1e-3  # of the window: first step of the differences
STEPS = (1e-6, 5e-2)  # of the window: bounds of the second step
AGREE = 0.10  # relative difference of two difference quotients that are called equal
ROUGH = 0.50  # relative difference beyond which no derivative is claimed

Evaluate = Callable[[np.ndarray], Sequence[Outcome]]


def differentiate(evaluate: Evaluate, names: Sequence[str], u: np.ndarray, centre: Outcome) -> tuple[np.ndarray, str]:
    """Jacobian (m, dim) of the residuals in the unit cube at `u`, with two steps compared; and what went wrong, or "".

    Central differences, one-sided at an edge of the window and where one neighbour has failed or moves in another way
    than the centre. The second step is about a third of the standard error that the first one implies: slopes are
    wanted at the scale of the interval, above the roughness of the simulation.
    """
    residuals = np.asarray(centre.residuals, dtype=float)
    noise = math.sqrt(residuals @ residuals / max(1, residuals.size - u.size)) or 1e-12
    first = np.full(u.size, STEP)
    columns, _ = _columns(evaluate, u, centre, first)
    failed = [k for k in range(u.size) if columns[k] is None]
    sensitivity = np.array([0.0 if column is None else np.linalg.norm(column) for column in columns])
    second = np.clip(0.3 * noise / np.maximum(sensitivity, 1e-300), *STEPS)
    near = (second > first / 3.0) & (second < 3.0 * first)
    second = np.where(near, np.where(second > first, 5.0 * first, first / 5.0), second)
    second[failed] = first[failed] / 30.0  # the motion changes its kind close by: look closer
    others, why = _columns(evaluate, u, centre, second)
    lost = [k for k in failed if others[k] is None]
    if lost:
        return np.empty((0, 0)), (
            f"no neighbour along {names[lost[0]]} can be compared with the best point: {why[lost[0]]}"
        )
    tried = [[c for c in pair if c is not None] for pair in zip(others, columns, strict=True)]
    doubtful = [k for k, pair in enumerate(tried) if len(pair) < 2 or not _agree(*pair, AGREE, noise)]
    if doubtful:
        third = np.where(np.isin(np.arange(u.size), failed), second / 3.0, np.sqrt(first * second))
        again, _ = _columns(evaluate, u, centre, third, only=doubtful)
        tried = [pair if column is None else [*pair, column] for pair, column in zip(tried, again, strict=True)]
    chosen = [_smoothest(slopes) for slopes in tried]
    unresolved = [
        names[k]
        for k in doubtful
        if not any(_agree(chosen[k], slope, ROUGH, noise) for slope in tried[k] if slope is not chosen[k])
    ]
    if unresolved:
        return np.empty((0, 0)), (
            "the residuals are not differentiable about the best point with respect to "
            f"{', '.join(unresolved)}: two steps give slopes that differ by more than half"
        )
    return np.column_stack(chosen), ""


def _columns(evaluate, u, centre, steps, only=None):
    """Difference quotients with `steps` (dim,), a list of (m,) or None, and {axis: what was wrong with a neighbour}."""
    members = range(u.size) if only is None else only
    ends = [(k, min(1.0, max(0.0, u[k] + sign * steps[k]))) for k in members for sign in (-1.0, 1.0)]
    ends = [(k, x) for k, x in ends if x != u[k]]
    points = np.repeat(u[None], len(ends), axis=0)
    points[np.arange(len(ends)), [k for k, _ in ends]] = [x for _, x in ends]
    good: dict[int, list] = {k: [] for k in members}
    why = {}
    for (k, x), outcome in zip(ends, evaluate(points), strict=True):
        reason = why_unusable(outcome, centre)
        if reason:
            why[k] = reason
        else:
            good[k].append((x, np.asarray(outcome.residuals, dtype=float)))
    columns: list = [None] * u.size
    for k in members:
        if len(good[k]) == 1:
            good[k].append((u[k], np.asarray(centre.residuals, dtype=float)))
        if len(good[k]) == 2:
            (a, first), (b, second) = good[k]
            columns[k] = (second - first) / (b - a)
    return columns, why


def why_unusable(outcome: Outcome, centre: Outcome) -> str:
    """Say why an outcome cannot be compared with that of the centre, or return an empty text."""
    if outcome.status != OK:
        return f"its simulation ended with status {outcome.status!r}"
    if outcome.residuals is None or not np.all(np.isfinite(outcome.residuals)):
        return "it has no finite residuals"
    if outcome.kind != centre.kind and UNDECIDED not in f"{outcome.kind} {centre.kind}":  # that is no other kind
        return f"its motion is {outcome.kind}, not {centre.kind}"
    if np.shape(outcome.residuals) != np.shape(centre.residuals):
        return f"it has {np.size(outcome.residuals)} residuals, not {np.size(centre.residuals)}"
    return ""


def _difference(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.linalg.norm(a - b) / max(np.linalg.norm(a), np.linalg.norm(b), 1e-300))


def _agree(a: np.ndarray, b: np.ndarray, tolerance: float, noise: float) -> bool:
    """Two slopes are equal, or both so small that the whole window moves the residuals by less than their noise."""
    return _difference(a, b) <= tolerance or max(np.linalg.norm(a), np.linalg.norm(b)) < noise


def _smoothest(slopes: list[np.ndarray]) -> np.ndarray:
    """Return the first of the slopes (two steps), or one of the two of three that agree best."""
    pairs = [(a, b) for i, a in enumerate(slopes) for b in slopes[i + 1 :]]
    return min(pairs, key=lambda pair: _difference(*pair))[0] if len(pairs) > 1 else slopes[0]
