"""The order in which points lie along a curve."""

import numpy as np
from scipy.spatial import cKDTree

LONGER = 1.4  # times the shortest way found: points that are farther apart than that are not in order
MOST = 3000  # points that are put in order
NEIGHBOURS = 10  # of a point, between which shorter ways are sought


def ordered(points: np.ndarray, closed: bool) -> tuple[np.ndarray, list[str]]:
    """Order (n,) in which points lie along their curve, and a note where it is not the one they came in.

    A curve over time is ordered by time. The points of a closed curve stay as they are where their order is a way
    round; else they are put on a short way through all of them, which crosses itself nowhere.

    Parameters
    ----------
    points : (n, 2)
    """
    if not closed:
        order = np.argsort(points[:, 0], kind="stable")
        return order, []
    size = np.ptp(points, axis=0)
    if len(points) < 4 or len(points) > MOST or not (size > 0.0).all():
        return np.arange(len(points)), []
    places = points / size
    shortest = _short_way(places)
    if _length(places) <= LONGER * _length(places[shortest]):
        return np.arange(len(points)), []
    return shortest, [
        "its points were not in order along the curve, and were put on the shortest way round; look at the picture"
    ]


def _length(places: np.ndarray) -> float:
    return float(np.linalg.norm(places - np.roll(places, -1, axis=0), axis=1).sum())


def _short_way(places: np.ndarray) -> np.ndarray:
    """Way (n,) through all points: from each to the nearest one left, then crossings undone (2-opt)."""
    size = len(places)
    left = np.ones(size, dtype=bool)
    way = [0]
    left[0] = False
    for _ in range(size - 1):
        rest = np.flatnonzero(left)
        way.append(int(rest[np.argmin(((places[rest] - places[way[-1]]) ** 2).sum(axis=1))]))
        left[way[-1]] = False
    way = np.array(way)
    near = np.atleast_2d(cKDTree(places).query(places, k=min(NEIGHBOURS + 1, size))[1])[:, 1:]
    for _ in range(20):
        if not _uncrossed(way, places, near):
            break
    return way


def _uncrossed(way: np.ndarray, places: np.ndarray, near: np.ndarray) -> bool:
    """Turn stretches of a way round where that makes it shorter; whether any was."""
    size, better = len(way), False
    rank = np.empty(size, dtype=int)
    rank[way] = np.arange(size)

    def apart(a, b):
        return float(np.hypot(*(places[a] - places[b])))

    for a in range(size):
        for c in near[a]:
            i, j = sorted((int(rank[a]), int(rank[c])))
            b, d = way[(i + 1) % size], way[(j + 1) % size]
            first, last = way[i], way[j]
            if i == j or b == last:
                continue
            if apart(first, last) + apart(b, d) < apart(first, b) + apart(last, d) - 1e-12:
                way[i + 1 : j + 1] = way[i + 1 : j + 1][::-1]
                rank[way] = np.arange(size)
                better = True
    return better
