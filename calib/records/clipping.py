"""Samples at the limit of a converter or an amplifier: runs of equal extreme values."""

import numpy as np

MIN_RUN_SAMPLES = 2  # equal ones
MIN_RUNS = 2  # at one extreme value
MIN_CLIPPED_SAMPLES = 5  # of all runs at it: a pair may lie on both sides of a crest
# of the steps of a converter: the fall in as many samples beside a run as half of it. A sinusoid that is rounded falls
# by 10 of them at most, a wave whose crest is flattened to fourth order by 40 from 4 samples on
MIN_FALL_STEPS = 40.0
STEP_QUANTILE = 0.1  # of the differences of neighbouring levels: a step, whether few levels are met or many


def clipped_runs(values: np.ndarray) -> np.ndarray:
    """First sample and the one behind the last (run, 2) of runs of equal extreme values (n,), which are no crests.

    A crest of n samples that a converter rounds to one level is followed by a fall of few of its steps within n / 2
    samples on either side; what a limit cuts off goes on falling as steeply as it rose before.
    """
    found = [_runs(values), _runs(-values)] if np.ptp(values) > 0.0 else []
    kept = [runs for runs in found if len(runs) >= MIN_RUNS and np.diff(runs).sum() >= MIN_CLIPPED_SAMPLES]
    return np.array(sorted(np.concatenate(kept).tolist())) if kept else np.empty((0, 2), dtype=int)


def _runs(values: np.ndarray) -> np.ndarray:
    """Runs (run, 2) of the largest value; one at the end of the record is left out."""
    largest, step = float(values.max()), level_step(values)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], values == largest, [0]])))
    first, last = edges[::2], edges[1::2] - 1
    beside = (last - first + 2) // 2  # samples: half of a run's length, rounded up
    inside = (last - first + 1 >= MIN_RUN_SAMPLES) & (last < values.size - 1)
    first, last, beside = first[inside], last[inside], beside[inside]
    before = np.where(first > 0, values[np.maximum(first - beside, 0)], -np.inf)
    behind = values[np.minimum(last + beside, values.size - 1)]
    steep = largest - np.maximum(before, behind) > MIN_FALL_STEPS * step
    return np.column_stack([first[steep], last[steep] + 1])


def level_step(values: np.ndarray) -> float:
    """Step between the levels of values (n,): that of the converter, or what so many values resolve  [unit]."""
    levels = np.unique(values)
    return float(np.quantile(np.diff(levels), STEP_QUANTILE)) if levels.size > 1 else 0.0
