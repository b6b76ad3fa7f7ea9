"""What bounds a window at each of its faces."""

from collections import Counter
from dataclasses import dataclass

import numpy as np

from calib.confidence.window.document import WINDOW_END
from calib.confidence.window.region import Region
from calib.confidence.window.sampling import RegionSample

RAYS = 400  # from points of the window along the axes
RAY_POINTS = 80  # along a ray to the end of the cube, the nearer the denser


@dataclass(frozen=True)
class Face:
    """One side of the window: what is met by going from inside along a parameter.

    Attributes
    ----------
    parameter : its position; -1 for all
    side : "low" or "high"; "" for all
    mechanisms : what bounds the window there -> share of the rays that end there, the most frequent first
    """

    parameter: int
    side: str
    mechanisms: dict[str, float]


def faces(region: Region, sample: RegionSample, seed: int) -> tuple[Face, ...]:
    """Mechanisms at which rays along the axes, from points spread evenly over the window, leave it.

    The first face is that of all rays. There are none where no point of the sample is inside.
    """
    rng = np.random.default_rng(seed)
    inside = sample.points[sample.probability >= 0.5]
    if not len(inside):
        return ()
    dim = inside.shape[1]
    starts = inside[rng.integers(len(inside), size=RAYS)]
    axes, up = rng.integers(dim, size=RAYS), rng.integers(2, size=RAYS).astype(bool)
    ends = np.where(up, 1.0, 0.0)
    begin = starts[np.arange(RAYS), axes]
    along = np.linspace(0.0, 1.0, RAY_POINTS) ** 2
    points = np.repeat(starts[:, None, :], RAY_POINTS, axis=1)
    points[np.arange(RAYS)[:, None], np.arange(RAY_POINTS)[None, :], axes[:, None]] = (
        begin[:, None] + (ends - begin)[:, None] * along
    )
    met = region.met(points.reshape(-1, dim)).reshape(RAYS, RAY_POINTS, -1)
    out = met.prod(axis=2) < 0.5
    first = np.where(out.any(axis=1), out.argmax(axis=1), -1)
    causes = [
        WINDOW_END if at < 0 else region.labels[int(np.argmin(own[at]))] for at, own in zip(first, met, strict=True)
    ]
    found = [Face(-1, "", _shares(causes))]
    for axis in range(dim):
        for high in (False, True):
            own = [cause for cause, a, u in zip(causes, axes, up, strict=True) if a == axis and u == high]
            if own:
                found.append(Face(axis, "high" if high else "low", _shares(own)))
    return tuple(found)


def _shares(causes: list[str]) -> dict[str, float]:
    return {cause: count / len(causes) for cause, count in Counter(causes).most_common()}
