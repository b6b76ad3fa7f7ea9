"""Impacts and near misses, noted by either kernel while it steps."""

from numba import njit

from calib.simulators.compilation import INLINED


@njit(**INLINED)
def note_impact(when, speed, impacts, total, which):
    """Note the step or the time of an impact and its closing speed [m/s], as far as there is room."""
    number = int(total[which])
    if number < len(impacts):
        impacts[number, 0], impacts[number, 1] = when, max(0.0, speed)
    total[which] += 1


@njit(**INLINED)
def note_pass(closed, nearest, seen):
    """Note the clearance where it was smallest between two phases of contact."""
    last, before = seen.passes[0], seen.passes[1]
    if not closed and last < nearest and last <= before and last > 0.0:
        number = int(seen.passes[2])
        if number < len(seen.nearest):
            seen.nearest[number] = last
            seen.passes[2] += 1
    seen.passes[1], seen.passes[0] = last, -1.0 if closed else nearest
