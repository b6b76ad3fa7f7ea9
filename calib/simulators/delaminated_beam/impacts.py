"""Impacts and near misses, recorded by either kernel while it steps."""

from typing import Protocol

import numpy as np
from numba import njit

from calib.simulators.compilation import INLINED

IMPACTS, CENTRAL_IMPACTS, CONTACT_TIME, MAX_FORCE, MAX_PENETRATION = range(5)  # places in `total`


class ContactTrace(Protocol):
    """What either kernel records of contact, in its own unit of time."""

    @property
    def impacts(self) -> np.ndarray:
        """Instants (k, 2) and closing speeds [m/s] at which contact begins."""
        ...

    @property
    def central(self) -> np.ndarray:
        """The same (k, 2) of the pair in the middle."""
        ...

    @property
    def closed(self) -> np.ndarray:
        """Time (m,) for which each pair was closed."""
        ...

    @property
    def total(self) -> np.ndarray:
        """Impacts, central impacts, time with contact, largest force [N], deepest penetration [m] (5,)."""
        ...

    @property
    def nearest(self) -> np.ndarray:
        """Local minima (k,) of the clearance while nothing is closed [m]; recorded only where it is not empty."""
        ...

    @property
    def passes(self) -> np.ndarray:
        """Smallest clearance one and two steps back [m], number of minima (3,)."""
        ...


@njit(**INLINED)
def record_impact(when: float, speed: float, impacts: np.ndarray, total: np.ndarray, which: int) -> None:
    """Record the step or the time of an impact and its closing speed [m/s], as far as there is room.

    total : written; counts the impacts at `which`
    """
    number = int(total[which])
    if number < len(impacts):
        impacts[number, 0], impacts[number, 1] = when, max(0.0, speed)
    total[which] += 1


@njit(**INLINED)
def record_near_miss(closed: int, nearest: float, trace: ContactTrace) -> None:
    """Record the clearance [m] where it had a local minimum while nothing was closed.

    closed : pairs that are closed
    nearest : smallest clearance of all pairs  [m]
    """
    last, before = trace.passes[0], trace.passes[1]
    if not closed and last < nearest and last <= before and last > 0.0:
        number = int(trace.passes[2])
        if number < len(trace.nearest):
            trace.nearest[number] = last
            trace.passes[2] += 1
    trace.passes[1], trace.passes[0] = last, -1.0 if closed else nearest
