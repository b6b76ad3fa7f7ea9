"""The sweeps of a frequency response whose rows state none.

Rows are in the order measured. Where most frequencies were read at several levels, each level is a sweep. Otherwise one
ends where the stated direction changes, where the level changes while the frequency turns, and where another level is
set at one frequency; readings of one level, which scatter as from one frequency to the next, do not end it.
"""

import numpy as np

MAX_LEVEL_SCATTER = 8.0  # of readings of one level, over the median change between successive frequencies  [1]
MIN_SET_STEP = 0.05  # between levels that are set, relative; readings of one level differ by less  [1]
MIN_SHARE_OF_SEVERAL = 0.5  # of the frequencies, that were read at several levels where each is a sweep  [1]
MAX_STEP_BACK = 2.0  # of a frequency that turns, over the last step onward  [1]
MIN_MEAN_LENGTH = 3.0  # points of a sweep on the average; in random order a run has less than 2.5


def numbered(frequency: np.ndarray, level: np.ndarray, direction: np.ndarray | None) -> np.ndarray | None:
    """Numbers (point,) of the sweeps; None where the rows may be read in several ways.

    Parameters
    ----------
    frequency, level : (point,) in the order measured  [Hz], in any unit
    direction : (point,) 1 (up) or -1 (down), where it is stated
    """
    block = np.cumsum(np.append(0, np.diff(frequency) != 0.0))
    held = _set_levels(frequency, level, block)
    pairs = np.unique(np.column_stack([block, held]), axis=0)
    readings, levels = np.bincount(block), np.bincount(pairs[:, 0])
    if (levels > 1).mean() >= MIN_SHARE_OF_SEVERAL and levels.size > 1:
        way = np.zeros(block.size) if direction is None else np.cumsum(np.append(0, np.diff(direction) != 0.0))
        return _by_first(np.column_stack([way, held]))
    if (readings > 1).mean() >= MIN_SHARE_OF_SEVERAL and levels.size > 1:
        spread = [np.ptp(level[block == one]) / np.mean(level[block == one]) for one in np.flatnonzero(readings > 1)]
        if np.median(spread) > MIN_SET_STEP:
            return None
    number = _in_order(frequency, level, held, direction)
    lengths = np.bincount(number)
    varies = any(np.ptp(level[number == one]) > 0.0 for one in range(lengths.size))
    if direction is None and varies and lengths.size > 1 and lengths.mean() < MIN_MEAN_LENGTH:
        return None
    return number.astype(float)


def _set_levels(frequency: np.ndarray, level: np.ndarray, block: np.ndarray) -> np.ndarray:
    """Numbers (point,) of the levels that were set: gaps between those of one are as small as the level wanders.

    block : (point,) number of the run of rows of one frequency
    """
    if not (level > 0.0).all():
        return np.zeros(block.size, dtype=int)
    size = np.log(level)
    mean = np.bincount(block, weights=size) / np.bincount(block)
    first = np.searchsorted(block, np.arange(mean.size))
    way = np.sign(np.diff(frequency[first]))
    onward = np.append(True, way[1:] == way[:-1])[: way.size]
    wander = float(np.median(np.abs(np.diff(mean))[onward])) if onward.any() else 0.0
    order = np.argsort(size, kind="stable")
    begins = np.diff(size[order]) > max(MAX_LEVEL_SCATTER * wander, MIN_SET_STEP)
    held = np.empty(block.size, dtype=int)
    held[order] = np.cumsum(np.append(0, begins))
    return held


def _by_first(key: np.ndarray) -> np.ndarray:
    """Numbers (point,) of equal rows of a key (point, k), in the order in which they first occur."""
    _, first, place = np.unique(key, axis=0, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[place.ravel()].astype(float)


def _in_order(frequency: np.ndarray, level: np.ndarray, held: np.ndarray, direction: np.ndarray | None) -> np.ndarray:
    """Numbers (point,) of the sweeps of rows that follow one another.

    Where the frequency turns after several readings of it, the later half of them belongs to the way back.
    """
    number, way = np.zeros(frequency.size, dtype=int), 0.0
    for point in range(1, frequency.size):
        step = float(np.sign(frequency[point] - frequency[point - 1]))
        new = direction is not None and direction[point] != direction[point - 1]
        if step == 0.0:
            turns = direction is None and _turns_amid(frequency, point, way)
            new = new or held[point] != held[point - 1] or (turns and level[point] != level[point - 1])
        elif (direction[point] if direction is not None else way or step) != step:
            new = new or level[point] != level[point - 1]
        number[point] = number[point - 1] + new
        way = 0.0 if new else way or step
    return number


def _turns_amid(frequency: np.ndarray, point: int, way: float) -> bool:
    """Whether a point is the middle one of the readings of a frequency at which a way (1 up, -1 down) turns back.

    A return to where a further sweep begins is no way back.
    """
    others = np.flatnonzero(frequency != frequency[point])
    before, after = others[others < point], others[others > point]
    if not before.size or not after.size or point != (before[-1] + 1 + after[0]) // 2:
        return False
    back = way * (frequency[point] - frequency[after[0]])
    return bool(0.0 < back <= MAX_STEP_BACK * abs(frequency[point] - frequency[before[-1]]))
