"""How sure the values at the best point are, judged from the residuals in its neighbourhood.

The residual vector r(u) is linearised about the best point u of the unit cube, r(u + d) = r + J d, so that noise n in
the residuals moves the best point by d = -J^+ n and the covariance of the estimate is the sandwich
J^+ Sigma J^+^T. Sigma is not assumed to be a multiple of the unit matrix:

1. Each block (one term, record, body, channel) has its own noise level and its own autocovariance, both estimated from
   its residuals (block-wise stationary noise; lag window and its width: Politis 2003).
2. Where Newey and West's estimate (1987; White's, 1980, when the residuals are white), which asks for no stationarity,
   gives a larger standard error, the larger one is taken: misfit that sits where the sensitivity sits counts.
3. Residuals of a fit are smaller than the noise; each block is scaled so that its expected sum of squares is the
   observed one. Few degrees of freedom widen the interval through Student's t (Satterthwaite 1946 over the blocks).
4. Blocks are taken as independent, unless `echoes` show how the noise of one channel sounds in several of them: then
   each variance is corrected by the ratio that they give.
5. The distance from the point to the minimum of the linearised problem is added in quadrature: a search that stopped
   early is not surer than one that ended.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from scipy import stats

from calib.errors import CalibError
from calib.parameter import Space, Window

SHARE = 0.25  # of the window: a direction with a larger standard error has a 2-s.e. interval as wide as the window
STEP = 1e-3  # of the window: first step of the differences
STEPS = (1e-6, 5e-2)  # of the window: bounds of the second step
AGREE = 0.10  # relative difference of two difference quotients that are called equal
ROUGH = 0.50  # relative difference beyond which no derivative is claimed
EDGE = 1e-3  # of the window: nearer than this is at its edge
SMALL_BLOCK = 8  # residuals: shorter blocks have no noise level of their own and share one
INFLATION = 10.0  # a standard error so many times the one with the other parameters known: nearly collinear
WIDE, COLLINEAR = "wider than the window", "nearly collinear"
TAIL = stats.norm.cdf(2.0)  # probability below +2 standard errors of a normal variable
FLOOR = 1e-9  # smallest singular value kept, relative to the largest


class Outcome(Protocol):
    """What is read of an evaluated point."""

    cost: float
    residuals: np.ndarray | None
    status: str
    kind: str | None


Evaluate = Callable[[np.ndarray], Sequence[Outcome]]


@dataclass(frozen=True)
class Group:
    """Parameters of which the measurement determines only a combination.

    `direction` is the change of each member, as a share of its window, that leaves the residuals (nearly) unchanged;
    `reason` is "wider than the window" or "nearly collinear".
    """

    members: tuple[str, ...]
    direction: Mapping[str, float]
    text: str
    reason: str


@dataclass(frozen=True)
class Confidence:
    """Standard errors, intervals and what is not determined, at one point.

    standard_error is in SI (of a log window: value times the standard error of the logarithm; infinite where it exceeds
    the window); interval is (low, high) in SI, the 2-standard-error interval, asymmetric for log windows and cut at the
    window; correlation (dim, dim) in the order of `names`; at_edge says "low" or "high". All empty where `status` is
    "not available"; `reason` then says why, else what to mind.
    """

    status: str
    reason: str
    names: tuple[str, ...]
    value: Mapping[str, float]
    standard_error: Mapping[str, float] = field(default_factory=dict)
    interval: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    correlation: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    undetermined: tuple[Group, ...] = ()
    at_edge: Mapping[str, str] = field(default_factory=dict)
    degrees_of_freedom: Mapping[str, float] = field(default_factory=dict)
    evaluations: int = 0

    def as_dict(self) -> dict:
        """Return the same in lists, numbers and text, None for what is not finite."""
        return {
            "status": self.status,
            "reason": self.reason,
            "standard_error": {name: _finite(x) for name, x in self.standard_error.items()},
            "interval": {name: list(ends) for name, ends in self.interval.items()},
            "correlation": {"names": list(self.names), "matrix": self.correlation.tolist()},
            "undetermined": [
                {"members": list(g.members), "direction": dict(g.direction), "text": g.text, "reason": g.reason}
                for g in self.undetermined
            ],
            "at_edge": dict(self.at_edge),
            "degrees_of_freedom": {name: _finite(x) for name, x in self.degrees_of_freedom.items()},
            "evaluations": self.evaluations,
        }


def local(
    evaluate: Evaluate,
    space: Space,
    u: np.ndarray,
    *,
    outcome: Outcome | None = None,
    blocks: np.ndarray | None = None,
    echoes: np.ndarray | None = None,
    share: float = SHARE,
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
    echoes : (number, m) changes of the residuals by noise in the measurement (`calib.confidence.echoes`); of use where
        several terms look at one channel
    share : a direction whose standard error exceeds this share of the window is called undetermined [1]

    Raises
    ------
    CalibError
        When `u`, `blocks` or `echoes` has the wrong shape.
    """
    u = np.asarray(u, dtype=float)
    values = space.values(u)
    value = {name: values[name] for name in space.names}
    edges = at_edge(space.names, u)
    counted = _Counted(evaluate)
    if outcome is None:
        (outcome,) = counted(u[None])
    missing = _why_unusable(outcome, outcome)
    if missing:
        reason = f"the best point itself cannot be judged: {missing}"
        return Confidence("not available", reason, space.names, value, at_edge=edges, evaluations=counted.number)
    residuals = np.asarray(outcome.residuals, dtype=float)
    if blocks is not None and np.shape(blocks) != residuals.shape:
        raise CalibError(f"expected one block number per residual, shape {residuals.shape}, got {np.shape(blocks)}")
    if echoes is not None and echoes.shape[1:] != residuals.shape:
        raise CalibError(f"expected echoes of shape (number, {residuals.size}), got {echoes.shape}")
    if residuals.size <= space.dim:
        reason = f"{residuals.size} residuals cannot judge {space.dim} parameters; score more features or records"
        return Confidence("not available", reason, space.names, value, at_edge=edges, evaluations=counted.number)

    jacobian, trouble = differentiate(counted, space.names, u, outcome)
    if trouble:
        return Confidence("not available", trouble, space.names, value, at_edge=edges, evaluations=counted.number)
    labels = np.zeros(residuals.size, dtype=int) if blocks is None else np.asarray(blocks)
    covariance, freedom = sandwich(jacobian, residuals, labels, echoes)
    free = np.array([name not in edges for name in space.names])
    step = distance_to_minimum(jacobian, residuals, free)
    reason = _unconverged(space.names, step, np.sqrt(np.diag(covariance)))
    groups = undetermined(space, u, covariance, share)
    covariance = covariance + np.diag(step**2)
    return _assemble(space, u, value, covariance, freedom, edges, reason, groups, counted.number)


# --- derivatives ---------------------------------------------------------------------------------------------------


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
    rough = [
        names[k]
        for k in doubtful
        if not any(_agree(chosen[k], slope, ROUGH, noise) for slope in tried[k] if slope is not chosen[k])
    ]
    if rough:
        return np.empty((0, 0)), (
            "the residuals are too rough about the best point to be differentiated with respect to "
            f"{', '.join(rough)}: two steps give slopes that differ by more than half"
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
        reason = _why_unusable(outcome, centre)
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


def _why_unusable(outcome: Outcome, centre: Outcome) -> str:
    if outcome.status != "ok":
        return f"its simulation ended with status {outcome.status!r}"
    if outcome.residuals is None or not np.all(np.isfinite(outcome.residuals)):
        return "it has no finite residuals"
    if outcome.kind != centre.kind:
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


# --- covariance ----------------------------------------------------------------------------------------------------


def sandwich(
    jacobian: np.ndarray, residuals: np.ndarray, blocks: np.ndarray, echoes: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Robust covariance (dim, dim) of a least-squares estimate and the degrees of freedom (dim,) of its variances.

    jacobian (m, dim) and residuals (m,) at the minimum, blocks (m,): numbers of the blocks, echoes (number, m) or None.
    Sources: module docstring.
    """
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale == 0.0] = FLOOR * max(scale.max(), 1e-300)
    left, singular, right = np.linalg.svd(jacobian / scale, full_matrices=False)
    singular = np.maximum(singular, FLOOR * singular[0])
    turn = (right.T / singular) / scale[:, None]  # estimate = -turn @ left.T @ residuals
    leverage = np.minimum(np.sum(left**2, axis=1), 0.99)

    parts = [np.flatnonzero(members) for members in _members(blocks)]
    models = [_autocovariance(residuals[i]) for i in parts]
    meats = [_toeplitz_form(left[i], gamma) for i, (gamma, _) in zip(parts, models, strict=True)]
    grams = [left[i].T @ left[i] for i in parts]
    factors = np.ones(len(parts))
    for _ in range(3):  # expected against observed sum of squares, block by block; converges at once
        total = sum(c * meat for c, meat in zip(factors, meats, strict=True))
        for b, (i, (gamma, _)) in enumerate(zip(parts, models, strict=True)):
            own = i.size * gamma[0] - 2.0 * np.trace(meats[b])  # tr Sigma - 2 tr (P Sigma), per unit factor
            others = np.trace(grams[b] @ total) - factors[b] * np.trace(grams[b] @ meats[b])  # tr (P Sigma P), theirs
            own += np.trace(grams[b] @ meats[b])
            observed = residuals[i] @ residuals[i]
            factors[b] = max(1.0, (observed - others) / max(own, 0.05 * i.size * gamma[0])) if gamma[0] > 0.0 else 1.0

    spread = np.array([c * np.diag(turn @ meat @ turn.T) for c, meat in zip(factors, meats, strict=True)])
    covariance = turn @ sum(c * meat for c, meat in zip(factors, meats, strict=True)) @ turn.T
    local_form = sum(
        _score_form(left[i] * (residuals[i] / np.sqrt(1.0 - leverage[i]))[:, None], lag)
        for i, (_, lag) in zip(parts, models, strict=True)
    )
    variance = np.maximum(np.diag(covariance), 1e-300)
    widen = np.sqrt(np.maximum(1.0, np.diag(turn @ local_form @ turn.T) / variance))
    if echoes is not None and len(parts) > 1:
        moves = [echoes[:, i] @ left[i] @ turn.T for i in parts]
        apart = sum(np.var(move, axis=0) for move in moves)
        ratio = np.var(sum(moves), axis=0) / np.maximum(apart, 1e-300)
        widen *= np.sqrt(np.clip(ratio, 0.25, len(parts)))
    own_freedom = np.array(
        [
            max(1.0, i.size * gamma[0] ** 2 / max(2.0 * gamma @ gamma - gamma[0] ** 2, 1e-300) - leverage[i].sum())
            for i, (gamma, _) in zip(parts, models, strict=True)
        ]
    )
    total_spread = np.maximum(spread.sum(axis=0), 1e-300)
    freedom = total_spread**2 / np.maximum((spread**2 / own_freedom[:, None]).sum(axis=0), 1e-300)
    return covariance * np.outer(widen, widen), np.maximum(freedom, 1.0)


def _members(blocks: np.ndarray) -> list[np.ndarray]:
    """Masks (m,) of the blocks; those that are too short for a noise level of their own are put together."""
    masks = [blocks == b for b in np.unique(blocks)]
    short = [mask for mask in masks if mask.sum() < SMALL_BLOCK]
    return [mask for mask in masks if mask.sum() >= SMALL_BLOCK] + ([np.any(short, axis=0)] if short else [])


def _autocovariance(residuals: np.ndarray) -> tuple[np.ndarray, int]:
    """Tapered autocovariance (n,) of one block and the last lag that counts, by the flat-top rule of Politis (2003)."""
    n = residuals.size
    size = 1 << (2 * n - 1).bit_length()
    raw = np.fft.irfft(np.abs(np.fft.rfft(residuals, size)) ** 2, size)[:n] / n
    if raw[0] <= 0.0 or n < 2 * SMALL_BLOCK:
        return np.concatenate([raw[:1], np.zeros(n - 1)]), 0
    small = np.abs(raw / raw[0]) < 2.0 * math.sqrt(math.log10(n) / n)
    run = max(5, math.ceil(math.sqrt(math.log10(n))))
    quiet = next((m for m in range(n - run) if small[m + 1 : m + 1 + run].all()), n // 4)
    lag = min(2 * quiet, n // 2)
    taper = np.clip(2.0 - 2.0 * np.arange(n) / lag, 0.0, 1.0) if lag else (np.arange(n) == 0).astype(float)
    return raw * taper, lag


def _toeplitz_form(left: np.ndarray, gamma: np.ndarray) -> np.ndarray:
    """Return left.T @ toeplitz(gamma) @ left, negative spectral densities lifted to a small positive one."""
    n = gamma.size
    size = 1 << (2 * n - 1).bit_length()
    symmetric = np.zeros(size)
    symmetric[:n] = gamma
    symmetric[size - n + 1 :] = gamma[:0:-1]
    density = np.maximum(np.fft.fft(symmetric).real, 1e-3 * gamma[0])
    spectrum = np.fft.fft(left, size, axis=0)
    return np.real(spectrum.conj().T @ (density[:, None] * spectrum)) / size


def _score_form(scores: np.ndarray, lag: int) -> np.ndarray:
    """Sum of the autocovariances of the scores (n, dim) with Bartlett weights up to `lag` (Newey and West 1987)."""
    return _toeplitz_form(scores, np.clip(1.0 - np.arange(len(scores)) / (lag + 1.0), 0.0, 1.0))


def distance_to_minimum(jacobian: np.ndarray, residuals: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Step (dim,) to the minimum of the linearised problem in the `free` (dim, bool) parameters, at most one window."""
    step = np.zeros(free.size)
    if free.any():
        step[free] = -np.linalg.lstsq(jacobian[:, free], residuals, rcond=1e-6)[0]
    return np.clip(step, -1.0, 1.0)


# --- words ---------------------------------------------------------------------------------------------------------


def at_edge(names: Sequence[str], u: np.ndarray) -> dict[str, str]:
    """Name the parameters whose position (dim,) lies at an end of the window, with the end."""
    low = {name: "low" for name, x in zip(names, u, strict=True) if x <= EDGE}
    return low | {name: "high" for name, x in zip(names, u, strict=True) if x >= 1.0 - EDGE}


def undetermined(
    space: Space, u: np.ndarray, covariance: np.ndarray, share: float = SHARE, inflation: float = INFLATION
) -> tuple[Group, ...]:
    """Groups of parameters of which only a combination, or nothing, is determined, by the covariance (dim, dim) at u.

    First the directions whose standard error exceeds `share` of the window. Then those whose standard error is more
    than `inflation` times what it would be if the other parameters were known (the root of the variance inflation of
    Marquardt 1970; 10 means a correlation of 0.99 between two).
    """
    members, found = _wide(covariance, share**2)
    wide = list(zip(members, found, strict=True))
    groups = [_group(space, u, own, directions, WIDE) for own, directions in _merged(wide)]
    named = {name for group in groups for name in group.members}
    eigenvalues, vectors = np.linalg.eigh(covariance)
    precision = vectors**2 @ (1.0 / np.maximum(eigenvalues, 1e-300 + 1e-15 * eigenvalues[-1]))
    alone = 1.0 / np.sqrt(precision)  # standard errors if the others were known
    members, found = _wide(covariance / np.outer(alone, alone), inflation**2)
    near = [
        (own, direction * alone / np.linalg.norm(direction * alone))
        for own, direction in zip(members, found, strict=True)
        if own.size > 1 and not named & {space.names[k] for k in own}
    ]
    return (*groups, *(_group(space, u, own, directions, COLLINEAR) for own, directions in _merged(near)))


def _wide(covariance: np.ndarray, limit: float) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Directions of a variance above `limit`, each with the parameters that owe half of their variance to it."""
    variance = np.maximum(np.diag(covariance), 1e-300)
    members, directions = [], []
    for size, direction in zip(*_eigen(covariance), strict=True):
        if size > limit:
            members.append(np.flatnonzero((size * direction**2 > 0.5 * variance) & (np.abs(direction) > 0.1)))
            directions.append(direction)
    return members, directions


def _eigen(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues (dim,) and, as rows, eigenvectors (dim, dim)."""
    values, vectors = np.linalg.eigh(matrix)
    return values, vectors.T


def _merged(directions: list[tuple[np.ndarray, np.ndarray]]) -> list[tuple[tuple[int, ...], list[np.ndarray]]]:
    """Join directions (members, vector) that share members."""
    groups: list[tuple[set[int], list[np.ndarray]]] = []
    for members, vector in directions:
        own, vectors = set(members.tolist()), [vector]
        for group in [g for g in groups if g[0] & own]:
            own |= group[0]
            vectors = group[1] + vectors
            groups.remove(group)
        if own:
            groups.append((own, vectors))
    return [(tuple(sorted(own)), vectors) for own, vectors in groups]


def _group(space: Space, u: np.ndarray, members: tuple[int, ...], directions: list[np.ndarray], reason: str) -> Group:
    names = tuple(space.names[k] for k in members)
    direction = {name: float(directions[-1][k]) for name, k in zip(names, members, strict=True)}
    if len(names) == 1:
        text = f"{names[0]}: not determined inside its window"
    elif len(names) == 2 and len(directions) == 1:
        windows = [space.windows[name] for name in names]
        relation = combination(names, windows, [u[k] for k in members], list(direction.values()))
        text = f"{' and '.join(names)}: only {relation} is determined"
        if reason == COLLINEAR:
            text = f"{' and '.join(names)}: {relation} is determined much better than either alone"
    else:
        shifts = ", ".join(f"{name} {shift:+.2f}" for name, shift in direction.items())
        text = (
            f"{', '.join(names)}: only combinations are determined; moving them together "
            f"({shifts} of their windows) changes little that is measured"
        )
    return Group(names, direction, text, reason)


def combination(names: Sequence[str], windows: Sequence[Window], u: Sequence[float], shifts: Sequence[float]) -> str:
    """Name what stays the same when two parameters at `u` (2,) move by `shifts` (2,), both as shares of their windows.

    Relative changes (d ln a : d ln b = q) leave a / b^q unchanged; where a value is near zero, a - q b in SI units. A
    power that is no small half or whole number is no law of nature: then the two changes are told instead.
    """
    (a, b), values = names, [w.value(x) for w, x in zip(windows, u, strict=True)]
    moves = [_rate(w, v) * shift for w, v, shift in zip(windows, values, shifts, strict=True)]
    if any(
        w.scale == "linear" and abs(v) < 0.1 * max(abs(w.low), abs(w.high))
        for w, v in zip(windows, values, strict=True)
    ):
        q = moves[0] / moves[1]
        return f"{a} {'-' if q > 0.0 else '+'} {abs(q):.3g} {b} (in SI units)"
    q = (moves[0] / values[0]) / (moves[1] / values[1])
    if abs(q) < 0.9:
        a, b, q = b, a, 1.0 / q
    power = round(2.0 * q) / 2.0
    if abs(q - power) > 0.08 * abs(q) or abs(power) > 4.0:
        return f"a combination (+1 % of {b} makes up for {-q:+.2g} % of {a})"
    exponent = "" if abs(power) == 1.0 else f"^{abs(power):.2g}"
    return f"{a} {'/' if q > 0.0 else '*'} {b}{exponent}"


def _rate(window: Window, value: float) -> float:
    """Slope of the value over the position at `value` [the window's unit]."""
    return value * math.log(window.high / window.low) if window.scale == "log" else window.high - window.low


def _assemble(space, u, value, covariance, freedom, edges, reason, groups, evaluations) -> Confidence:
    error = np.sqrt(np.diag(covariance))
    half = stats.t.ppf(TAIL, freedom) * error
    standard_error, interval = {}, {}
    for k, (name, window) in enumerate(space.windows.items()):
        standard_error[name] = float(error[k] * _rate(window, value[name])) if error[k] <= 1.0 else math.inf
        interval[name] = (window.value(u[k] - half[k]), window.value(u[k] + half[k]))
    outer = np.maximum(np.outer(error, error), 1e-300)
    return Confidence(
        "ok",
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
    far = [name for name, d, s in zip(names, step, error, strict=True) if abs(d) > max(s, 1e-6)]
    if not far:
        return ""
    return (
        f"the search ended before the best value of {', '.join(far)} was reached; "
        "the intervals were widened by the way left"
    )


def _finite(x: float) -> float | None:
    return float(x) if math.isfinite(x) else None


class _Counted:
    """An evaluation that counts its points."""

    def __init__(self, evaluate: Evaluate):
        self.evaluate = evaluate
        self.number = 0

    def __call__(self, points: np.ndarray) -> Sequence[Outcome]:
        self.number += len(points)
        return self.evaluate(points)
