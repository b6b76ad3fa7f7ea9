"""The release of a decay: the end of the rest before it."""

import numpy as np

from calib.records.decay.analytic_signal import MIN_DECAY_SAMPLES, dominant_frequency
from calib.records.white_noise import white_noise_std

NOISE_RANGE_STD = 8.0  # range of a rest's noise  [standard deviations]: more in 1 of 100 rests of 1000 samples
MIN_REST_RANGE = 1e-3  # of the range of the values, which a rest may have whatever its noise  [1]
MAX_REST_RANGE = 0.5  # of the amplitude, which a rest may have: one that is drawn out, or shaken  [1]
MAX_FIRST_CROSSINGS = 2  # of the mean on the way to the farthest value: more are a beat that grows from zero  [count]
MIN_REST_SAMPLES = 4  # in a rest  [count]
MAX_RESTS = 50  # one behind the other: of a pull, by a tenth of the amplitude each
MIN_REST_PERIODS = 0.08  # beyond what a crest lasts, of a rest; crests of flattened waves last as long
MAX_CREST_LENGTH = 1.5  # of a free motion's crest over a sinusoid's: 1.41 of a ball that bounces  [1]


def release(time: np.ndarray, values: np.ndarray) -> int:
    """Index of the first sample (n,) of the free motion, 0 where the record begins with it.

    Before its release a structure is held, or waits for the blow. Its values then stay within a range r for longer than
    those of a free motion of amplitude A and period T can, about a crest: arccos(1 - r / A) T / pi. A rest lasts for
    1.5 times that and 0.08 periods more. It is looked for with r from the range of the noise on, doubled up to half the
    amplitude, and again behind each rest, as long as there is one: a hand may not hold quite still, or pull.
    """
    smallest = max(NOISE_RANGE_STD * float(white_noise_std(values)), MIN_REST_RANGE * float(np.ptp(values)))
    first = 0
    for _ in range(MAX_RESTS):
        rest = _rest(time[first:], values[first:], smallest) if smallest > 0.0 else 0
        if not rest:
            break
        first += rest
    return first


def _rest(time: np.ndarray, values: np.ndarray, smallest: float) -> int:
    """Length in samples of the rest that values (n,) begin with, 0 without one; smallest : range of one  [unit]."""
    allowed, farthest = smallest, int(np.argmax(np.abs(values - np.median(values))))  # a pull ends there
    while values.size > MIN_DECAY_SAMPLES:
        count = _within(values, allowed)
        moving = max(count, farthest)
        if values.size - moving < MIN_DECAY_SAMPLES:
            break
        period, amplitude = _motion(time[moving:], values[moving:])
        if allowed > MAX_REST_RANGE * amplitude:
            break
        crest = period * np.arccos(1.0 - allowed / amplitude) / np.pi
        longest = MAX_CREST_LENGTH * crest + MIN_REST_PERIODS * period
        beats = _crossings(values[count : farthest + 1], float(np.median(values))) > MAX_FIRST_CROSSINGS
        if not beats and count >= MIN_REST_SAMPLES and time[count - 1] - time[0] > longest:
            return count
        allowed *= 2.0
    return 0


def _crossings(values: np.ndarray, level: float) -> int:
    """Number of times that values (n,) cross a level."""
    return int(np.count_nonzero(np.diff(values > level)))


def _within(values: np.ndarray, allowed: float) -> int:
    """Number of the first values (n,) whose range is within what is allowed."""
    count = MIN_DECAY_SAMPLES
    while True:
        piece = values[:count]
        beyond = np.flatnonzero(np.maximum.accumulate(piece) - np.minimum.accumulate(piece) > allowed)
        if beyond.size or count >= values.size:
            return int(beyond[0]) if beyond.size else values.size
        count *= 4


def _motion(time: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """Period  [s] and amplitude, over the first period, of values (n,) that begin with a free motion."""
    period = 1.0 / dominant_frequency(time, values)
    return period, 0.5 * float(np.ptp(values[time <= time[0] + period]))
