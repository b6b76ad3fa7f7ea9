"""What the fit of a decay says of the samples before it: how long the release still disturbs the motion."""

import numpy as np

from calib.records.decay.oscillation import Oscillation
from calib.records.decay.smoother import SmoothedDecay

FIRST_PERIODS = 2  # of a decay, whose residual is compared with that of the periods behind them  [count]
NEXT_PERIODS = 10  # with which it is compared, and whose noise that of a backcast is taken for  [count]
MIN_FIRST_RESIDUAL = 1.5  # rms residual of the first periods over that of the median one behind them  [1]
BLOCKS_PER_PERIOD = 8  # in which a backcast is compared with the samples
MIN_BLOCK_SAMPLES = 3  # of a block, so that one outlier does not make its median  [count]
MIN_DISTURBED_Z = 8.0  # median over a block of |sample - backcast|: some block of a disturbed motion  [standard errors]
MAX_FREE_Z = 3.0  # the same: every block of the free motion  [standard errors]
MARGIN_PERIODS = 0.5  # behind the last disturbed block: what fades is seen until it is some standard errors  [periods]
MIN_FREE_PERIODS = 1.0  # right before the fit that have to be free: elsewhere the backcast itself fails  [periods]


def first_periods_stand_out(one: Oscillation) -> bool:
    """Whether the residual of the first periods is larger than that of those behind them."""
    turns = (one.basis.matrix(one.time) @ one.phase)[one.used] / (2.0 * np.pi)
    number = np.floor(turns - turns.min()).astype(int)
    square = np.bincount(number, one.residual[one.used] ** 2) / np.maximum(np.bincount(number), 1)
    behind = square[FIRST_PERIODS : FIRST_PERIODS + NEXT_PERIODS]
    return bool(np.mean(square[:FIRST_PERIODS]) > MIN_FIRST_RESIDUAL**2 * np.median(behind))


def disturbed_samples(decay: SmoothedDecay, time: np.ndarray, values: np.ndarray) -> int:
    """Number of the samples (n,) before a decay, up to half a period behind those that its fit does not continue to.

    0 where all follow the backcast, and where those next to the decay do not: then the fit cannot be continued,
    whatever the motion. A block of an eighth of a period is told by the median of its samples' errors over their
    standard errors.

    time, values : (n,)  [s], [unit]
    """
    backcast, sigma = _backcast(decay, time)
    z = np.abs(values - backcast) / sigma
    per_block = time.size / ((time[-1] - time[0]) * decay.dominant * BLOCKS_PER_PERIOD)
    size = max(MIN_BLOCK_SAMPLES, round(per_block))
    ends = np.arange(time.size, 0, -size)
    block_z = np.array([np.median(z[max(end - size, 0) : end]) for end in ends])
    if block_z.max() < MIN_DISTURBED_Z:
        return 0
    last = time[ends[np.argmax(block_z > MAX_FREE_Z)] - 1]
    if time[-1] - last < MIN_FREE_PERIODS / decay.dominant:
        return 0
    return int(np.searchsorted(time, last + MARGIN_PERIODS / decay.dominant))


def _backcast(decay: SmoothedDecay, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values (n,) that the fit gives at instants before it, and the standard error of a sample beside them  [unit].

    The noise is propagated through log amplitude and phase; the spread of the fits with other numbers of splines is
    added.
    """
    one = decay.oscillation
    beside, carrier = _continued(decay, one, time)
    near = one.used & (one.time < one.time[0] + NEXT_PERIODS / decay.dominant)
    noise = max(decay.noise, float(np.sqrt(np.mean(one.residual[near] ** 2))))
    splines = one.basis.matrix(time)
    slopes = np.hstack([carrier.real[:, None] * splines, -carrier.imag[:, None] * splines])
    variance = noise**2 * (1.0 + np.einsum("ij,jk,ik->i", slopes, one.covariance, slopes))
    values = beside + carrier.real
    for other in decay.alternatives:
        variance += other.weight * (sum(_continued(decay, other.oscillation, time)).real - values) ** 2
    return values, np.sqrt(variance)


def _continued(decay: SmoothedDecay, one: Oscillation, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean, harmonics and other modes (n,) as large as at the beginning of the fit, and the carrier exp(p)  [unit]."""
    held, splines = one.basis.matrix(np.maximum(time, one.basis.range[0])), one.basis.matrix(time)
    phase = splines @ one.phase
    beside = held @ one.mean
    angles = [m * phase for m in decay.frame.harmonics]
    angles += [2.0 * np.pi * frequency * time for frequency in decay.frame.companions]
    for angle, (real, imaginary) in zip(angles, [*one.harmonics, *one.companions], strict=True):
        beside = beside + held @ real * np.cos(angle) + held @ imaginary * np.sin(angle)
    return beside, np.exp(splines @ one.log_amplitude + 1j * phase)
