"""Sweeps of an excitation: the steps of a stepped sine, and the windows of a swept one, in the order measured.

A sweep goes on in one direction: its rate may change, it may wait, and it goes on over windows that are missing. It
ends where the frequency turns or jumps, and where the excitation stops until the motion is at rest.
"""

import math
from collections.abc import Sequence, Set
from dataclasses import replace
from itertools import pairwise
from statistics import median_low

import numpy as np

from calib.records.order_tracking_windows import TrackedWindow

MAX_RATE_CHANGE = 3.0  # of a sweep over windows that are missing, over the larger of those beside them  [1]
MIN_SWEEP_POINTS = 4  # of a sweep, or of a series of steps in one direction  [count]
MAX_RANGES_APART = 0.5  # of frequencies or levels of two parts of a step, over the wider one  [1]
MIN_SETTLED_WINDOWS = 3  # of the second half of a step whose scatter is taken  [count]
MIN_SLOW_VARIANCE_RATIO = 4.0  # of a scatter or a drift in a step, over that by noise, above which it is one  [1]


def steps(windows: Sequence[TrackedWindow]) -> list[TrackedWindow]:
    """Last window of each step, where the motion has settled longest, with the scatter over the second half of it.

    A window is of a step where it is like the window before. Where beating with a hum parts a step, the windows of
    either part differ as much.
    """
    steady = [after for before, after in pairwise(windows) if _is_same_step(before, after)]
    parts: list[list[TrackedWindow]] = []
    for one in steady:
        if not parts or not _is_same_step(parts[-1][-1], one):
            parts.append([])
        parts[-1].append(one)
    whole = parts[:1]
    for before, part in pairwise(parts):
        whole = [*whole[:-1], whole[-1] + part] if _is_near(before, part) else [*whole, part]
    return [_with_scatter(step) for step in whole]


def _is_same_step(before: TrackedWindow, after: TrackedWindow) -> bool:
    return before.start == after.start and not before.step_to(after) and before.has_level_of(after)


def _is_near(before: Sequence[TrackedWindow], after: Sequence[TrackedWindow]) -> bool:
    """Whether two parts of a record, with no stop between, are as near in frequency and level as windows of either."""
    one, other = (np.array([[w.frequency, w.level] for w in part]) for part in (before, after))
    apart = np.maximum(one.min(axis=0) - other.max(axis=0), other.min(axis=0) - one.max(axis=0))
    near = apart <= MAX_RANGES_APART * np.maximum(np.ptp(one, axis=0), np.ptp(other, axis=0))
    return before[0].start == after[0].start and bool(near.all())


def _with_scatter(step: Sequence[TrackedWindow]) -> TrackedWindow:
    """Last window of a step, with the scatter of its second half: each window shows the same steady motion."""
    settled, last = step[len(step) // 2 :], step[-1]
    if len(settled) < MIN_SETTLED_WINDOWS:
        return last
    values = np.array([[one.level, *(one.response * last.level / one.level)] for one in settled])
    spread = float(np.var([one.frequency for one in settled], ddof=1))
    by_noise = float(np.mean([one.frequency_sigma**2 for one in settled]))
    sigma = math.sqrt(spread) if spread > MIN_SLOW_VARIANCE_RATIO * by_noise else last.frequency_sigma
    harmonics = tuple(
        replace(own, scatter=np.var([one.harmonics[k].response for one in settled], axis=0, ddof=1))
        for k, own in enumerate(last.harmonics)
    )
    return replace(last, scatter=np.var(values, axis=0, ddof=1), frequency_sigma=sigma, harmonics=harmonics)


def _by_frequency(own_steps: Sequence[TrackedWindow]) -> list[list[TrackedWindow]]:
    """Steps at one frequency after the other."""
    found: list[list[TrackedWindow]] = []
    for one in own_steps:
        if not found or found[-1][-1].step_to(one):
            found.append([])
        found[-1].append(one)
    return found


def rests_between_steps(own_steps: Sequence[TrackedWindow]) -> bool:
    """Whether the excitation stops so often that fewer frequencies lie between two stops than in a sweep."""
    starts = len({one.start for one in own_steps})
    return starts > 1 and len(_by_frequency(own_steps)) < MIN_SWEEP_POINTS * starts


def series_of_steps(own_steps: Sequence[TrackedWindow]) -> list[list[TrackedWindow]]:
    """Series of steps in one direction; several levels at each frequency are as many series.

    The levels are those of the nearest frequency that has as many as most have, and a step belongs to the nearest.
    """
    at_one_frequency = _by_frequency(own_steps)
    levels = [_distinct_levels(own) for own in at_one_frequency]
    count = median_low([own.size for own in levels]) if levels else 0
    complete = [place for place, own in enumerate(levels) if own.size == count]
    of_level: list[list[TrackedWindow]] = [[] for _ in range(count)]
    for place, own in enumerate(at_one_frequency):
        known = levels[min(complete, key=lambda other: abs(other - place))]
        for one in own:
            of_level[int(np.argmin(np.abs(known - math.log(one.level))))].append(one)
    return [run for own in of_level for run in _one_way(own)]


def _distinct_levels(own_steps: Sequence[TrackedWindow]) -> np.ndarray:
    """Logarithms (level,) of the levels of steps, of which several may have one."""
    ascending = sorted(own_steps, key=lambda one: one.level)
    return np.log(
        [
            ascending[0].level,
            *(after.level for before, after in pairwise(ascending) if not before.has_level_of(after)),
        ]
    )


def _one_way(own_steps: Sequence[TrackedWindow]) -> list[list[TrackedWindow]]:
    """Runs of steps whose frequency goes on in one direction; at a turn what was repeated begins the next one."""
    runs, way = [list(own_steps[:1])], 0.0
    for before, one in pairwise(own_steps):
        step = before.step_to(one)
        if before.start != one.start:
            runs.append([])
            step = way = 0.0
        elif step and step == -way:
            repeated = [other for other in runs[-1] if not other.step_to(before)][1:]
            runs[-1] = runs[-1][: len(runs[-1]) - len(repeated)]
            runs.append(repeated)
            step, way = step if repeated else 0.0, 0.0
        runs[-1].append(one)
        way = step or way
    return [run for run in runs if len(run) >= MIN_SWEEP_POINTS and run[0].step_to(run[-1])]


def sweeps_of_windows(windows: Sequence[TrackedWindow]) -> list[list[TrackedWindow]]:
    """Sweeps of a swept sine, without the windows where the excitation waits, or turns."""
    runs, last_rate = list[list[TrackedWindow]](), 0.0
    for k, one in enumerate(windows):
        before, after = windows[max(k - 1, 0)], windows[min(k + 1, len(windows) - 1)]
        before = before if one.number - before.number == 1 else one
        after = after if after.number - one.number == 1 else one
        if not before.step_to(after):
            continue
        rate = (after.frequency - before.frequency) / (after.time - before.time)
        if not runs or _is_cut(runs[-1][-1], last_rate, one, rate):
            runs.append([])
        runs[-1].append(one)
        last_rate = rate
    waiting = {one.number for one in windows} - {one.number for run in runs for one in run}
    return [run for run in runs if len(run) >= MIN_SWEEP_POINTS * (1 + _waits(run, waiting))]


def _waits(run: Sequence[TrackedWindow], waiting: Set[int]) -> int:
    """How often a sweep waits, for two windows or more: between steps it does so every few windows."""
    return sum(
        all(number in waiting for number in (before.number + 1, before.number + 2))
        for before, after in pairwise(run)
        if after.number - before.number > 2
    )


def _is_cut(before: TrackedWindow, rate_before: float, after: TrackedWindow, rate_after: float) -> bool:
    """Whether a sweep ends between two windows with these rates [Hz/s]: at a turn, a stop, a return or a jump."""
    if rate_before * rate_after < 0.0 or before.start != after.start:
        return True
    fastest = math.copysign(max(abs(rate_before), abs(rate_after)), rate_after)
    ratio = (after.frequency - before.frequency) / (after.time - before.time) / fastest
    is_back = ratio < 0.0 and bool(before.step_to(after))
    return after.number - before.number > 1 and (is_back or ratio > MAX_RATE_CHANGE)
