"""How far parameters may vary inside a window: alone, and together in a box or an ellipsoid."""

from dataclasses import dataclass

import numpy as np
import scipy

from calib.confidence.window.region import Region

LINE_POINTS = 401  # along an axis
INSIDE_PROBABILITY = 0.95  # of being admissible, which every point of a box or an ellipsoid inside has  [1]
BOX_TEST_POINTS = 256  # quasi-random ones beside the corners
GROWTH = 1.2  # of a face's distance in a step of the first round  [1]
MAX_GROWTH_ROUNDS = 60  # over all faces
MIN_GROWTH = 1.004  # at which the growth of a box ends  [1]
START_HALF_WIDTH = 0.002  # edges of the cube
MAX_CORNER_DIM = 10  # up to which all corners of a box are tested
SURFACE_DIRECTIONS = 512  # on an ellipsoid
RADIUS_HALVINGS = 20  # of the search for its radius
MAX_RADIUS = 4.0  # standard deviations of the window
RING_SHARES = (0.5, 0.8, 1.0)  # of the radius, at which points of an ellipsoid are tested  [1]


@dataclass(frozen=True, eq=False)
class InscribedEllipsoid:
    """Points centre + radius * root @ w with |w| <= 1 that are inside the window.

    Attributes
    ----------
    centre : (dim,)
    root : (dim, dim) Cholesky factor of the second moments of the window
    radius : in these standard deviations, 0 where not even the centre is certain
    """

    centre: np.ndarray
    root: np.ndarray
    radius: float


def extent_along_axes(region: Region, centre: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest value (dim,) of each coordinate alone, the others at the centre, that is admissible."""
    low, high = centre.copy(), centre.copy()
    for axis in range(centre.size):
        line = np.unique(np.append(np.linspace(0.0, 1.0, LINE_POINTS), centre[axis]))
        points = np.tile(centre, (line.size, 1))
        points[:, axis] = line
        inside = region.probability(points) >= 0.5
        here = int(np.searchsorted(line, centre[axis]))
        inside[here] = True
        left, right = here, here
        while left > 0 and inside[left - 1]:
            left -= 1
        while right < line.size - 1 and inside[right + 1]:
            right += 1
        low[axis], high[axis] = line[left], line[right]
    return low, high


def largest_box(region: Region, centre: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Corners (dim,) and (dim,) of a box about the centre that is inside and as large as its faces can be pushed.

    A face is pushed out by a factor as long as all corners of the box and `BOX_TEST_POINTS` points in it stay inside,
    the face that brings most volume first; the factor falls as no face moves any more. None where the centre is not
    inside.
    """
    dim = centre.size
    unit = scipy.stats.qmc.Sobol(dim, seed=0).random(BOX_TEST_POINTS)
    if dim <= MAX_CORNER_DIM:
        corners = np.array(np.meshgrid(*[[0.0, 1.0]] * dim)).reshape(dim, -1).T
        unit = np.vstack([unit, corners])

    def is_inside(low: np.ndarray, high: np.ndarray) -> bool:
        return bool((region.probability(low + (high - low) * unit) >= INSIDE_PROBABILITY).all())

    low, high = np.maximum(centre - START_HALF_WIDTH, 0.0), np.minimum(centre + START_HALF_WIDTH, 1.0)
    if not is_inside(low, high):
        return None
    factor = GROWTH**4
    for _ in range(MAX_GROWTH_ROUNDS):
        moved = False
        for axis in np.argsort(high - low):
            for side in (0, 1):
                trial_low, trial_high = low.copy(), high.copy()
                step = (factor - 1.0) * (high[axis] - low[axis])
                if side:
                    trial_high[axis] = min(1.0, high[axis] + step)
                else:
                    trial_low[axis] = max(0.0, low[axis] - step)
                if (trial_high - trial_low)[axis] > (high - low)[axis] and is_inside(trial_low, trial_high):
                    low, high, moved = trial_low, trial_high, True
        if not moved:
            factor = 1.0 + 0.5 * (factor - 1.0)
            if factor < MIN_GROWTH:
                break
    return low, high


def inscribed_ellipsoid(region: Region, inside: np.ndarray) -> InscribedEllipsoid:
    """Largest ellipsoid inside, and in the box that is searched, with the shape of the window's second moments.

    Its centre is their mean.

    Parameters
    ----------
    inside : (k, dim) points that are spread evenly over the window
    """
    centre, dim = inside.mean(axis=0), inside.shape[1]
    root = np.linalg.cholesky(np.cov(inside, rowvar=False) + 1e-12 * np.eye(dim))
    direction = np.random.default_rng(0).standard_normal((SURFACE_DIRECTIONS, dim))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    shell = np.vstack([share * direction for share in RING_SHARES])

    def is_inside(radius: float) -> bool:
        points = centre + radius * shell @ root.T
        searched = (points >= 0.0).all() and (points <= 1.0).all()
        return bool(searched and (region.probability(points) >= INSIDE_PROBABILITY).all())

    least, most = 0.0, MAX_RADIUS
    for _ in range(RADIUS_HALVINGS):
        middle = 0.5 * (least + most)
        least, most = (middle, most) if is_inside(middle) else (least, middle)
    return InscribedEllipsoid(centre, root, least)
