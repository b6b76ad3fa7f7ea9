"""Strokes linked into curves: across gaps of dashes, and straight on where lines cross."""

from collections.abc import Sequence
from dataclasses import dataclass

import networkx as nx
import numpy as np
from scipy.spatial import cKDTree

from calib.digitise.image.strokes import Stroke

MAX_GAP_WIDTHS = 12.0  # line widths: the widest gap that is bridged
TURN_COST = 5.0  # what turning back costs, against going straight on
LENGTH_COST = 0.3  # what going from a long stroke to a short one costs: a solid line does not go on in dashes
TANGENT_WIDTHS = 3.0  # line widths at an end from which its direction is taken
MIN_STROKE_WIDTHS = 1.3  # line widths: a shorter stroke is a dot
MAX_PARTNERS = 8  # other ends that an end is tried with


@dataclass(frozen=True, eq=False)
class StrokeChain:
    """Strokes one after the other.

    Attributes
    ----------
    path : (n, 2) column and row, gaps bridged
    inked : (n,) whether there is ink, False in a bridged gap
    closed : whether it returns to its beginning
    gaps : (m,) lengths of the gaps [pixels]
    """

    path: np.ndarray
    inked: np.ndarray
    closed: bool
    gaps: np.ndarray

    @property
    def length(self) -> float:
        """Length of what is inked [pixels]."""
        return float(self.inked.sum())

    @property
    def dashed(self) -> bool:
        """Whether it is drawn in dashes or dots."""
        return self.gaps.size >= 6 and self.gaps.sum() > 0.12 * len(self.path)


def linked(strokes: Sequence[Stroke], width: float) -> list[StrokeChain]:
    """Link strokes so that gaps are short and curves go straight on, as far as the whole drawing allows.

    Each end of a stroke goes to at most one other end. The links are the matching of least cost, (gap + width) times
    1 + `TURN_COST` (bends), with bends 1 - cos of the angles between the two directions and the line that joins the
    ends; strokes of different lengths cost more.

    Parameters
    ----------
    width : of the lines [pixels]
    """
    open_ones = [stroke for stroke in strokes if not stroke.closed]
    chains = [_chain([stroke.pixels], True, width) for stroke in strokes if stroke.closed]
    if not open_ones:
        return chains
    positions, directions = _ends(open_ones, width)
    partner = _matched(positions, directions, [len(s.pixels) for s in open_ones], width)
    visited = set[int]()
    for first in range(len(open_ones)):
        if first in visited:
            continue
        run, closed = _run(first, partner)
        visited.update(stroke for stroke, _ in run)
        chains.append(_chain([open_ones[s].pixels[::step] for s, step in run], closed, width))
    return chains


def _ends(strokes: Sequence[Stroke], width: float) -> tuple[np.ndarray, np.ndarray]:
    """Place (2 n, 2) and outward direction (2 n, 2) of each end: 2 k is the beginning of stroke k, 2 k + 1 its end."""
    middles = np.array([stroke.pixels.mean(axis=0) for stroke in strokes])
    tree = cKDTree(middles)
    positions, directions = [], []
    for number, stroke in enumerate(strokes):
        if len(stroke.pixels) < MIN_STROKE_WIDTHS * width:
            along = _between_neighbours(number, middles, tree, width)
            positions += [middles[number]] * 2
            directions += [-along, along]
            continue
        count = min(len(stroke.pixels), max(3, round(TANGENT_WIDTHS * width)))
        for pixels in (stroke.pixels[:count], stroke.pixels[::-1][:count]):
            positions.append(pixels[0])
            directions.append(_direction(pixels))
    return np.array(positions), np.array(directions)


def _between_neighbours(number: int, middles: np.ndarray, tree: cKDTree, width: float) -> np.ndarray:
    """Direction (2,) of a dot, which shows none: that of two strokes near to it and opposite to each other."""
    near, which = tree.query(
        middles[number], k=min(MAX_PARTNERS, len(middles)), distance_upper_bound=MAX_GAP_WIDTHS * width
    )
    others = [int(j) for d, j in zip(np.atleast_1d(near), np.atleast_1d(which), strict=True) if 0.0 < d < np.inf]
    away = middles[others] - middles[number]
    if len(others) < 2:
        return away[0] / np.linalg.norm(away[0]) if others else np.zeros(2)
    length = np.linalg.norm(away, axis=1)
    opposite = (away @ away.T) / np.outer(length, length)
    cost = (length[:, None] + length[None, :]) * (1.0 + TURN_COST * (1.0 + opposite))
    cost[np.tril_indices(len(others))] = np.inf
    first, second = np.unravel_index(np.argmin(cost), cost.shape)
    across = away[second] - away[first]
    return across / max(float(np.linalg.norm(across)), 1e-12)


def _matched(positions: np.ndarray, directions: np.ndarray, lengths: Sequence[int], width: float) -> dict[int, int]:
    """Partner of each end that has one."""
    farthest = MAX_GAP_WIDTHS * width
    near, which = cKDTree(positions).query(
        positions, k=min(MAX_PARTNERS + 2, len(positions)), distance_upper_bound=farthest
    )
    highest = (farthest + width) * (1.0 + 0.5 * TURN_COST)
    graph = nx.Graph()
    for i in range(len(positions)):
        for gap, j in zip(near[i], which[i], strict=True):
            if not np.isfinite(gap) or j == i or (j == i ^ 1 and lengths[i // 2] < 4.0 * max(gap, width)):
                continue
            cost = _cost(positions[j] - positions[i], directions[i], directions[j], gap, width)
            cost *= 1.0 + LENGTH_COST * abs(np.log(lengths[i // 2] / lengths[j // 2]))
            if cost < highest:
                graph.add_edge(int(i), int(j), weight=highest - cost)
    pairs = nx.max_weight_matching(graph)
    return {a: b for pair in pairs for a, b in (pair, pair[::-1])}


def _cost(across: np.ndarray, one: np.ndarray, other: np.ndarray, gap: float, width: float) -> float:
    joined = across / gap if gap > 0.0 else np.zeros(2)
    sure = gap / (gap + 2.0 * width)  # of the line that joins two ends near to each other
    bends = (1.0 + one @ other) + sure * ((1.0 - one @ joined) + (1.0 + other @ joined))
    return (gap + width) * (1.0 + TURN_COST * bends)


def _run(first: int, partner: dict[int, int]) -> tuple[list[tuple[int, int]], bool]:
    """Strokes from `first` on, both ways, with the sense in which each is passed, and whether they close."""
    forward = [(first, 1)]
    end = 2 * first + 1
    while end in partner:
        end = partner[end]
        if end // 2 == first:
            return forward, True
        forward.append((end // 2, 1 if end % 2 == 0 else -1))
        end ^= 1
    backward = []
    end = 2 * first
    while end in partner:
        end = partner[end]
        backward.append((end // 2, -1 if end % 2 == 0 else 1))
        end ^= 1
    return backward[::-1] + forward, False


def _chain(paths: Sequence[np.ndarray], closed: bool, width: float) -> StrokeChain:
    pieces, inked, gaps = [], [], []
    count = len(paths)
    for k, path in enumerate(paths):
        pieces.append(path)
        inked.append(np.ones(len(path), dtype=bool))
        if k + 1 < count or closed:
            bridge = _bridge(path, paths[(k + 1) % count], width)
            gaps.append(np.linalg.norm(paths[(k + 1) % count][0] - path[-1]))
            pieces.append(bridge)
            inked.append(np.zeros(len(bridge), dtype=bool))
    lengths = np.array([gap for gap in gaps if gap > 1.5])
    return StrokeChain(np.concatenate(pieces), np.concatenate(inked), closed, lengths)


def _bridge(path: np.ndarray, following: np.ndarray, width: float) -> np.ndarray:
    """Points of a cubic from the end of a path to the beginning of the following one, in their directions."""
    start, end = path[-1], following[0]
    gap = np.linalg.norm(end - start)
    count = int(gap) - 1
    if count < 1:
        return np.empty((0, 2))
    reach = max(3, round(TANGENT_WIDTHS * width))
    out, into = _direction(path[::-1][:reach]), -_direction(following[:reach])
    joined = (end - start) / gap
    # a direction that does not lead there is that of a short dash, or ends at a corner
    out, into = (d if d @ joined > 0.5 else joined for d in (out, into))
    u = (np.arange(1, count + 1) / (count + 1))[:, None]
    return (
        (2 * u**3 - 3 * u**2 + 1) * start
        + (u**3 - 2 * u**2 + u) * gap * out
        + (3 * u**2 - 2 * u**3) * end
        + (u**3 - u**2) * gap * into
    )


def _direction(pixels: np.ndarray) -> np.ndarray:
    """Unit vector out of the first of some pixels (n, 2), away from the others."""
    away = pixels[0] - pixels.mean(axis=0)
    length = np.linalg.norm(away)
    return away / length if length > 0.0 else np.zeros(2)
