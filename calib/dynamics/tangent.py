"""Small differences along an orbit: from the map's own derivative, or from central differences of the map."""

import numpy as np

from calib.modelling.orbit import PeriodMap, Tangent
from calib.records import OK

CENTRAL_DIFFERENCE_STEP = 1e-6  # of the central differences, in units of the scale
NEWTON_STEPS = 5  # that a close return takes to its cycle, about
MAX_NEWTON_COST = 2500  # periods of the map that one attempt to find a cycle may take


def tangent(map: PeriodMap, state: np.ndarray, vectors: np.ndarray, periods: int) -> Tangent:
    """Carry `vectors` (dimension, m), in units of the scale, along the orbit from `state`.

    See `calib.modelling.orbit.Tangent`.

    A map that does not know its derivative is differenced centrally, once a period.
    """
    own = map.tangent(state, vectors, periods)
    return own if own is not None else _by_differences(map, state, vectors, periods)


def knows_derivative(map: PeriodMap, state: np.ndarray) -> bool:
    """Whether the map knows its derivative, rather than being differenced, two runs a component of the state."""
    return map.tangent(state, np.ones((len(state), 1)), 1) is not None


def longest_affordable(map: PeriodMap, state: np.ndarray) -> int:
    """Longest period of a cycle to which Newton's method costs at most 2500 periods of the map."""
    runs = 1 if knows_derivative(map, state) else 1 + 2 * len(state)
    return MAX_NEWTON_COST // (NEWTON_STEPS * runs)


def jacobian(map: PeriodMap, state: np.ndarray, periods: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Return the state after `periods` periods, and its derivative (dimension, dimension) in units of the scale.

    Where the motion fails on the way both are NaN.
    """
    size = len(state)
    carried = tangent(map, state, np.eye(size), periods)
    if len(carried.states) < periods:
        return np.full(size, np.nan), np.full((size, size), np.nan)
    product = carried.vectors
    for growth in carried.growth[::-1]:
        product = product @ growth
    return carried.states[-1], product


def _by_differences(map: PeriodMap, state: np.ndarray, vectors: np.ndarray, periods: int) -> Tangent:
    vectors, _ = _orthonormal(vectors)
    states, growth = [], []
    for _ in range(periods):
        after = map.orbit(state, 1)
        ahead = [map.orbit(state + CENTRAL_DIFFERENCE_STEP * map.scale * vector, 1) for vector in vectors.T]
        behind = [map.orbit(state - CENTRAL_DIFFERENCE_STEP * map.scale * vector, 1) for vector in vectors.T]
        if any(orbit.status != OK for orbit in (after, *ahead, *behind)):
            break
        image = [
            (a.states[0] - b.states[0]) / (2.0 * CENTRAL_DIFFERENCE_STEP * map.scale)
            for a, b in zip(ahead, behind, strict=True)
        ]
        vectors, stretched = _orthonormal(np.array(image).T)
        state = after.states[0]
        states.append(state)
        growth.append(stretched)
    return Tangent(
        np.array(states).reshape(-1, len(state)), vectors, np.array(growth).reshape(-1, *2 * (vectors.shape[1],))
    )


def _orthonormal(vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    q, r = np.linalg.qr(vectors)
    sign = np.where(np.diag(r) < 0.0, -1.0, 1.0)
    return q * sign, sign[:, None] * r
