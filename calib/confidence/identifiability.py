"""Parameters of which the measurement determines only a combination, and that combination in words."""

from collections.abc import Mapping, Sequence

import numpy as np

from calib.modelling.parameter import Space, Window
from calib.study import UndeterminedGroup

MAX_WINDOW_SHARE = 0.25  # standard error over the window  [1]: beyond it the 2-s.e. interval is as wide as the window
MAX_ERROR_INFLATION = 4.0  # standard error over the one with the others known  [1]: beyond it nearly collinear
MIN_VARIANCE_SHARE = 0.5  # of a parameter's variance by one direction, of which it is a member  [1]
MIN_COMPONENT = 0.1  # of a unit direction, of which a parameter is a member  [1]
MIN_RELATIVE_VALUE = 0.1  # of the larger end of a linear window: relative changes of a smaller value mean little  [1]
MAX_POWER_ERROR, MAX_POWER = 0.08, 4.0  # of a half or whole number: its relative error, and its size  [1]
MIN_UNSWAPPED_POWER = 0.9  # of a combination  [1]: one below is written with its parameters swapped
WIDE, COLLINEAR = "wider than the window", "nearly collinear"


def undetermined_combinations(space: Space, u: np.ndarray, covariance: np.ndarray) -> tuple[UndeterminedGroup, ...]:
    """Groups of parameters of which only a combination, or nothing, is determined, by the covariance (dim, dim) at u.

    First the directions whose standard error exceeds MAX_WINDOW_SHARE of the window, and what parameters of such a
    standard error these leave. Then those whose standard error is more than MAX_ERROR_INFLATION times what it would be
    if the other parameters were known (the root of the variance inflation of Marquardt 1970; 10 means a correlation of
    0.99 between two).
    """
    wide = _wide(covariance, MAX_WINDOW_SHARE**2)
    groups = [_group(space, u, covariance, own, directions, WIDE) for own, directions in _merged(wide)]
    named = {name for group in groups for name in group.members}
    # what moves with a direction that is another parameter's nearly alone is no member of its group
    beyond = [k for k, variance in enumerate(np.diag(covariance)) if variance > MAX_WINDOW_SHARE**2]
    axes = np.eye(len(space.names))
    groups += [_group(space, u, covariance, (k,), [axes[k]], WIDE) for k in beyond if space.names[k] not in named]
    named |= {space.names[k] for k in beyond}
    eigenvalues, vectors = np.linalg.eigh(covariance)
    precision = vectors**2 @ (1.0 / np.maximum(eigenvalues, 1e-300 + 1e-15 * eigenvalues[-1]))
    alone = 1.0 / np.sqrt(precision)  # standard errors if the others were known
    near = [
        (own, direction * alone / np.linalg.norm(direction * alone))
        for own, direction in _wide(covariance / np.outer(alone, alone), MAX_ERROR_INFLATION**2)
        if own.size > 1 and not named & {space.names[k] for k in own}
    ]
    collinear = (_group(space, u, covariance, own, directions, COLLINEAR) for own, directions in _merged(near))
    return (*groups, *collinear)


def _wide(covariance: np.ndarray, limit: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Directions of a variance above `limit`, each after the parameters that owe half of their variance to it."""
    variance = np.maximum(np.diag(covariance), 1e-300)
    wide = []
    values, vectors = np.linalg.eigh(covariance)
    for size, direction in zip(values, vectors.T, strict=True):
        if size > limit:
            members = np.flatnonzero(
                (size * direction**2 > MIN_VARIANCE_SHARE * variance) & (np.abs(direction) > MIN_COMPONENT)
            )
            wide.append((members, direction))
    return wide


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


def _group(
    space: Space,
    u: np.ndarray,
    covariance: np.ndarray,
    members: tuple[int, ...],
    directions: list[np.ndarray],
    reason: str,
) -> UndeterminedGroup:
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
        text = f"{', '.join(names)}: {_correlated(names, covariance[np.ix_(members, members)], direction, reason)}"
    return UndeterminedGroup(names, direction, text, reason)


def _correlated(names: Sequence[str], covariance: np.ndarray, direction: Mapping[str, float], reason: str) -> str:
    """Say of several parameters which two are correlated most, and how much better they are known together."""
    shifts = ", ".join(f"{name} {shift:+.2f}" for name, shift in direction.items())
    together = f"moving them together as {shifts} (shares of their windows) changes little that is measured"
    errors = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlation = np.clip(covariance / np.outer(errors, errors), -1.0, 1.0)
    i, j = divmod(int(np.argmax(np.abs(np.triu(correlation, 1)))), len(names))
    pair = f"their estimates are correlated ({names[i]} with {names[j]} by {correlation[i, j]:+.3f})"
    if reason == COLLINEAR:
        return f"{pair}; each is determined within its interval, combinations of them much better: {together}"
    return f"{pair}; only combinations of them are well determined: {together}"


def combination(names: Sequence[str], windows: Sequence[Window], u: Sequence[float], shifts: Sequence[float]) -> str:
    """Name what stays the same when two parameters at `u` (2,) move by `shifts` (2,), both as shares of their windows.

    Relative changes (d ln a : d ln b = q) leave a / b^q unchanged; where a value is near zero, a - q b in SI units. A
    power that is no small half or whole number is no law of nature: then the two changes are stated instead.
    """
    (a, b), values = names, [w.value(x) for w, x in zip(windows, u, strict=True)]
    moves = [w.slope(v) * shift for w, v, shift in zip(windows, values, shifts, strict=True)]
    if any(
        w.scale == "linear" and abs(v) < MIN_RELATIVE_VALUE * max(abs(w.low), abs(w.high))
        for w, v in zip(windows, values, strict=True)
    ):
        q = moves[0] / moves[1]
        return f"{a} {'-' if q > 0.0 else '+'} {abs(q):.3g} {b} (in SI units)"
    q = (moves[0] / values[0]) / (moves[1] / values[1])
    if abs(q) < MIN_UNSWAPPED_POWER:
        a, b, q = b, a, 1.0 / q
    power = round(2.0 * q) / 2.0
    if abs(q - power) > MAX_POWER_ERROR * abs(q) or abs(power) > MAX_POWER:
        return f"a combination (+1 % of {b} makes up for {-q:+.2g} % of {a})"
    exponent = "" if abs(power) == 1.0 else f"^{abs(power):.2g}"
    return f"{a} {'/' if q > 0.0 else '*'} {b}{exponent}"
