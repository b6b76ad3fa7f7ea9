"""The order in which points lie along a curve."""

import numpy as np
from scipy.spatial import cKDTree

MAX_TOUR_RATIO = 1.4  # of points in order: length of their polygon over that of the shortest tour through them
MAX_ORDERED_POINTS = 3000  # that are put in order
NEIGHBOURS = 10  # of a point, to which the 2-opt search is limited
MAX_TWO_OPT_ROUNDS = 20  # of the 2-opt search


def ordered(points: np.ndarray, closed: bool) -> tuple[np.ndarray, list[str]]:
    """Order (n,) in which points lie along their curve, and a note where it is not the one they came in.

    A curve over time is ordered by time. The points of a closed curve stay as they are where they lie in order along
    it; else they are put on a short tour through all of them, which crosses itself nowhere.

    Parameters
    ----------
    points : (n, 2)
    """
    if not closed:
        order = np.argsort(points[:, 0], kind="stable")
        return order, []
    size = np.ptp(points, axis=0)
    if len(points) < 4 or len(points) > MAX_ORDERED_POINTS or not (size > 0.0).all():
        return np.arange(len(points)), []
    scaled = points / size
    shortest = _short_tour(scaled)
    if _length(scaled) <= MAX_TOUR_RATIO * _length(scaled[shortest]):
        return np.arange(len(points)), []
    return shortest, [
        "its points were not in order along the curve, and were put on the shortest way round; look at the picture"
    ]


def _length(points: np.ndarray) -> float:
    """Length of the closed polygon through points (n, 2)."""
    return float(np.linalg.norm(points - np.roll(points, -1, axis=0), axis=1).sum())


def _short_tour(points: np.ndarray) -> np.ndarray:
    """Tour (n,) through all points (n, 2): from each to its nearest neighbour not yet visited, then 2-opt."""
    size = len(points)
    open_ = np.ones(size, dtype=bool)
    visited = [0]
    open_[0] = False
    for _ in range(size - 1):
        rest = np.flatnonzero(open_)
        visited.append(int(rest[np.argmin(((points[rest] - points[visited[-1]]) ** 2).sum(axis=1))]))
        open_[visited[-1]] = False
    tour = np.array(visited)
    near = np.atleast_2d(cKDTree(points).query(points, k=min(NEIGHBOURS + 1, size))[1])[:, 1:]
    for _ in range(MAX_TWO_OPT_ROUNDS):
        if not _shortened(tour, points, near):
            break
    return tour


def _shortened(tour: np.ndarray, points: np.ndarray, near: np.ndarray) -> bool:
    """Reverse stretches of a tour where that makes it shorter; whether any was."""
    size, better = len(tour), False
    rank = np.empty(size, dtype=int)
    rank[tour] = np.arange(size)

    def apart(a: int, b: int) -> float:
        return float(np.hypot(*(points[a] - points[b])))

    for a in range(size):
        for c in near[a]:
            i, j = sorted((int(rank[a]), int(rank[c])))
            b, d = tour[(i + 1) % size], tour[(j + 1) % size]
            first, last = tour[i], tour[j]
            if i == j or b == last:
                continue
            if apart(first, last) + apart(b, d) < apart(first, b) + apart(last, d) - 1e-12:
                tour[i + 1 : j + 1] = tour[i + 1 : j + 1][::-1]
                rank[tour] = np.arange(size)
                better = True
    return better
