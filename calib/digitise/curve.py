"""A curve read off a figure."""

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True, eq=False)
class Curve:
    """Points along one curve of a figure, in the units of its axes.

    Attributes
    ----------
    name : of the curve in its file, or of its entry in the figure's description
    points : (n, 2) across and up  [units of the axes]
    sigma : (n, 2) standard uncertainty of each point along both axes, independent from point to point  [the same]
    modes : (k, n, 2) what each independent error of the axes' calibration, one standard deviation large, does to the
        points  [the same]
    lean : (k, n, 2) the same for errors of the trace that reach over a stretch of the curve; empty where unknown
    notes : what its reader should know
    """

    name: str
    points: np.ndarray
    sigma: np.ndarray | None = None
    modes: np.ndarray = field(default_factory=lambda: np.empty((0, 0, 2)))
    lean: np.ndarray = field(default_factory=lambda: np.empty((0, 0, 2)))
    notes: tuple[str, ...] = ()
