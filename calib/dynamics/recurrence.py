"""Recurrence of a section: how closely its states return."""

import numpy as np

MAX_LAG_PERIODS = 64  # periods: the longest return that is called periodic by its section alone
RETURN_TOLERANCE = 1e-6  # of the motion's size, within which a periodic motion returns
NEAR_CYCLE_DISTANCE = 1e-2  # of the motion's size: distance to a stable cycle within which a motion may be led to it
SAME_MOTION_DISTANCE = 1e-4  # of the map's scale: distance of a state to a motion that it belongs to
MIN_MOTION_SIZE = 1e-6  # of the map's scale: a smaller motion is at rest, and is measured as if it had this size
SECTION_BLOCKS = 8  # of a section; that the maxima of so many fall one after the other is hardly chance: 1 in 8!
MIN_DRIFT = 0.02  # relative fall or rise of these maxima; those of a torus that is all but filled differ by less


def recurrence_of(section: np.ndarray) -> np.ndarray:
    """Differences (64,) of the states (n, dimension) 1..64 periods apart, the largest, as a share of the size."""
    return np.array([np.abs(section[n:] - section[:-n]).max() for n in range(1, MAX_LAG_PERIODS + 1)]) / size_of(
        section
    )


def returned_after(section: np.ndarray, within: float = RETURN_TOLERANCE) -> int:
    """Smallest n, long ones too, after which the last n states of a section return, 0 where there is none.

    within : tolerance, as a share of the section's extent
    """
    near = within * np.ptp(section, axis=0).max()  # of its spread: a small torus about a cycle is no return to it
    # one state alone comes back by chance, the sooner the longer the section
    for n in np.flatnonzero(largest(section[:-1] - section[-1])[::-1] <= near) + 1:
        if 2 * n <= len(section) and largest(section[-n:] - section[-2 * n : -n]).max() <= near:
            return int(n)
    return 0


def block_maxima(section: np.ndarray, lag: int) -> np.ndarray:
    """Largest differences (8,) of states `lag` periods apart in 8 blocks of the section."""
    count = (len(section) - lag) // SECTION_BLOCKS
    return largest(section[lag:] - section[:-lag])[-count * SECTION_BLOCKS :].reshape(SECTION_BLOCKS, count).max(axis=1)


def likely_period(section: np.ndarray, lag: int, exponent: float) -> int:
    """Period that a drifting motion is settling to, 0 where its returns do not fall at the rate of its exponent.

    Returns after a multiple of the period fall with the exponent; those that are none fall to what they will be.
    """
    maxima = np.maximum([block_maxima(section, n) for n in range(1, lag + 1)], np.finfo(float).tiny)
    fall = np.log(maxima[:, -1] / maxima[:, 0])
    due = exponent * len(section) * (1.0 - 1.0 / SECTION_BLOCKS)
    if not 2.0 * due < fall[-1] < 0.5 * due < 0.0:
        return 0
    return int(np.flatnonzero(fall <= 0.5 * fall[-1])[0]) + 1


def closing_in(section: np.ndarray, back: np.ndarray) -> int:
    """Smallest lag at which a section (n, dimension) returns closely, and ever more so; 0 where it does not.

    back : (n - 1,) difference of the last state from those 1, 2, ... before it, as a share of the motion's size
    """
    near = np.flatnonzero(back[: len(back) // 3] <= NEAR_CYCLE_DISTANCE)
    if not near.size:
        return 0
    lag = int(near[0]) + 1
    returns = largest(section[lag:] - section[:-lag])
    middle = (len(returns) - lag) // 2
    first, second, third = (returns[start : start + lag].max() for start in (0, middle, len(returns) - lag))
    return lag if third < second < first else 0


def approaches(section: np.ndarray, point: np.ndarray, periods: int) -> bool:
    """Whether a section (n, dimension) that begins beside `point` is closer to it after each third of its returns."""
    distance = largest(section[::periods] - point)
    thirds = np.linspace(0, len(distance) - 1, 4).astype(int)
    return len(distance) > 3 and bool((np.diff(distance[thirds]) < 0.0).all())


def largest(differences: np.ndarray) -> np.ndarray:
    """Largest component (n,) of each difference (n, dimension)."""
    return np.abs(differences).max(axis=1)


def size_of(section: np.ndarray) -> float:
    """Size of a motion: the largest component of its section (n, dimension)  [scale of the map]."""
    return max(float(np.abs(section).max()), MIN_MOTION_SIZE)
