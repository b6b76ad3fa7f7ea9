"""Propagation of the errors of reading a figure to the record."""

import numpy as np

from calib.digitise.clock import LoopClock, NodeLoop, clock

STRETCHES_PER_CURVE = 24  # stretches along a curve within each of which an error of the trace is taken as one
ASSUMED_SIGMA_SHARE = 1e-3  # of a curve's extent: standard uncertainty of points of which nothing is known


def hats(size: int, closed: bool, number: int = STRETCHES_PER_CURVE) -> np.ndarray:
    """Weights (number, size) of points in overlapping stretches; squares sum to 1 at each point."""
    number = max(1, min(number, size // 2))
    position = np.arange(size) / size * number
    away = np.abs(position[None] - np.arange(number)[:, None])
    if closed:
        away = np.minimum(away, number - away)
    weight = np.clip(1.0 - away, 0.0, None)
    return weight / np.maximum(np.sqrt((weight**2).sum(axis=0)), 1e-12)


def leaning(sigma: np.ndarray, closed: bool) -> np.ndarray:
    """Modes (2 k, n, 2) over stretches of the curve, to which independent errors of n points add up.

    sigma : (n, 2) standard uncertainty of each point
    """
    weight = hats(len(sigma), closed)
    shrunk = np.sqrt(len(weight) / len(sigma))  # the mean of many independent errors
    modes = np.zeros((2 * len(weight), len(sigma), 2))
    for channel in (0, 1):
        modes[channel * len(weight) : (channel + 1) * len(weight), :, channel] = shrunk * weight * sigma[:, channel]
    return modes


def propagated(
    loop: NodeLoop, timed: LoopClock, modes: np.ndarray, period: float, step: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """Standard uncertainty of displacement and velocity at each node at its time, and of the time once round.

    Each mode displaces the nodes by one standard deviation of one independent error. It moves the nodes, and it
    changes the time at which they are passed, by which displacement changes as v dt and velocity as a dt. The instant
    at which the record starts is free, so that a shift of the whole record in time is no error.

    Parameters
    ----------
    modes : (k, node, 2)  [m], [m/s]
    period : that the time once round is stretched to  [s]
    step : time between samples of the record, over which the acceleration is taken; longer where time is not sure  [s]

    Returns
    -------
    displacement (node,) [m], velocity (node,) [m/s], time once round [1, as a share of it]
    """
    q, v = loop.displacement, loop.velocity
    time = timed.time * (period / timed.period)
    weight = np.diff(time)
    late, lasting = np.zeros((len(modes), q.size)), 0.0
    for k, mode in enumerate(modes):
        other = clock(NodeLoop(q + mode[:, 0], v + mode[:, 1], loop.position, loop.reversed), turns=timed.turns)
        late[k] = other.time[:-1] * (period / other.period) - time[:-1]
        start = np.sum(weight * (mode[:, 0] - v * late[k]) * v) / np.sum(weight * v**2)
        late[k] += start
        lasting += (other.period / timed.period - 1.0) ** 2
    rate = acceleration(time, v, np.maximum(step, 2.0 * np.sqrt((late**2).sum(axis=0))))
    displaced = modes[:, :, 0] - v * late
    quickened = modes[:, :, 1] - rate * late
    return np.sqrt((displaced**2).sum(axis=0)), np.sqrt((quickened**2).sum(axis=0)), float(np.sqrt(lasting))


def acceleration(time: np.ndarray, velocity: np.ndarray, step: np.ndarray | float) -> np.ndarray:
    """Change of velocity (node,) over a step of time (node,) [s] on either side  [m/s^2].

    Parameters
    ----------
    time : (node + 1,) of the nodes and of the first one again  [s]
    velocity : (node,)  [m/s]
    """
    period = time[-1]
    closed = np.append(velocity, velocity[0])
    ahead = np.interp((time[:-1] + step) % period, time, closed)
    behind = np.interp((time[:-1] - step) % period, time, closed)
    return (ahead - behind) / (2.0 * step)
