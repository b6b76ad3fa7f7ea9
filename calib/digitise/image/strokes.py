"""Strokes: the lines of a drawing, thinned, as paths that neither branch nor cross."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import convolve
from skimage.measure import label, regionprops
from skimage.morphology import isotropic_dilation, remove_small_objects, skeletonize

MIN_SPOT_AREA = 0.6  # of the squared line width: a smaller spot is dirt
MAX_SPUR_WIDTHS = 0.9  # line widths: a shorter branch that ends is made by thinning
MAX_BRIDGE_WIDTHS = 4.0  # line widths: a shorter branch between two crossings belongs to both lines
CROSSING_WIDTHS = 0.6  # line widths about a crossing that belong to no stroke
MAX_STROKES = 4000  # strokes: more are no drawing of curves


@dataclass(frozen=True, eq=False)
class Stroke:
    """A path of pixels (n, 2), column and row; `closed` where its end meets its beginning."""

    pixels: np.ndarray
    closed: bool


def strokes(ink: np.ndarray) -> tuple[list[Stroke], float]:
    """Thin a drawing (row, column), True where ink is, into strokes; also its line width [pixels]."""
    if not ink.any():
        return [], 0.0
    thin = skeletonize(ink)
    width = _width(ink, thin)
    large = remove_small_objects(ink, max_size=max(0, int(MIN_SPOT_AREA * width**2) - 1), connectivity=2)
    thin = _pruned(thin & large, width)
    crossings = thin & (_neighbours(thin) > 2)
    around = isotropic_dilation(crossings, max(1.0, CROSSING_WIDTHS * width)) if crossings.any() else crossings
    paths = []
    for region in regionprops(label(thin & ~around, connectivity=2)):
        paths.append(_path(region.coords[:, ::-1]))
        if len(paths) > MAX_STROKES:
            break
    beside = isotropic_dilation(around, 1.5) if crossings.any() else around
    return [stroke for stroke in paths if not _made_by_thinning(stroke, beside, width)], width


def _width(ink: np.ndarray, thin: np.ndarray) -> float:
    """Width of most of the lines [pixels]: a line of length L and width w has the area L w + w^2, a dot w^2."""
    spots = label(ink, connectivity=2)
    area, length = np.bincount(spots.ravel())[1:].astype(float), np.bincount(spots[thin], minlength=spots.max() + 1)[1:]
    length = np.maximum(length - 1.0, 0.0)
    widths = 0.5 * (np.sqrt(length**2 + 4.0 * area) - length)
    order = np.argsort(widths)
    return float(widths[order][np.searchsorted(np.cumsum(area[order]), 0.5 * area.sum())])


def _neighbours(thin: np.ndarray) -> np.ndarray:
    return convolve(thin.astype(np.uint8), np.ones((3, 3), dtype=np.uint8), mode="constant") - thin


def _pruned(thin: np.ndarray, width: float) -> np.ndarray:
    """Thinned lines without the spurs that thinning leaves at blunt ends and corners."""
    crossings = thin & (_neighbours(thin) > 2)
    if not crossings.any():
        return thin
    around = isotropic_dilation(crossings, 1.0)
    ends = thin & (_neighbours(thin) == 1)
    branches = label(thin & ~around, connectivity=2)
    lengths = np.bincount(branches.ravel())
    touching, free = np.zeros(lengths.size, dtype=bool), np.zeros(lengths.size, dtype=bool)
    touching[np.unique(branches[isotropic_dilation(around, 1.5)])] = True
    free[np.unique(branches[ends])] = True
    spurs = touching & free & (lengths < MAX_SPUR_WIDTHS * width)
    spurs[0] = False
    return skeletonize(thin & ~spurs[branches])


def _path(pixels: np.ndarray) -> Stroke:
    """Order the pixels (n, 2) of a thin line."""
    left = {(column, row): None for column, row in pixels.tolist()}
    steps = [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)]

    def beside(p: tuple[int, int]) -> list[tuple[int, int]]:
        return [(p[0] + dx, p[1] + dy) for dx, dy in steps if (p[0] + dx, p[1] + dy) in left]

    start = min(left, key=lambda p: len(beside(p)))
    closed = len(beside(start)) > 1
    path = [start]
    del left[start]
    while following := beside(path[-1]):
        path.append(following[0])
        del left[following[0]]
    ends = np.subtract(path[0], path[-1])
    return Stroke(np.array(path, dtype=float), closed and len(path) > 8 and np.abs(ends).max() <= 2)


def _made_by_thinning(stroke: Stroke, beside: np.ndarray, width: float) -> bool:
    """Whether a stroke is a spur at a crossing, or the bridge that two lines share where they cross."""
    ends = stroke.pixels[[0, -1]].astype(int)
    touching = int(beside[ends[:, 1], ends[:, 0]].sum())
    length = len(stroke.pixels)
    return not stroke.closed and (
        (touching == 1 and length < MAX_SPUR_WIDTHS * width) or (touching == 2 and length < MAX_BRIDGE_WIDTHS * width)
    )
