"""Stationary autoregressive noise of unit variance: x_t = sum of a_j x_(t-j) + what is new."""

import numpy as np
from scipy.signal import lfilter, lfiltic


def coloured(rng: np.random.Generator, shape: tuple[int, int], memory: np.ndarray) -> np.ndarray:
    """Draw rows (row, n) of Gaussian noise, stationary from the first sample on.

    memory : (p,) coefficients a_1..a_p of the autoregression, none for white noise  [1]
    """
    orders, new = _predictors(memory)
    p = len(memory)
    rows = rng.standard_normal(shape)
    for t in range(min(p, shape[1])):
        rows[:, t] = new[t] * rows[:, t] + rows[:, :t][:, ::-1] @ orders[t]
    if not p or shape[1] <= p:
        return rows
    recursion = np.concatenate([[1.0], -np.asarray(memory)])
    for row in rows:
        begin = lfiltic([1.0], recursion, row[:p][::-1])
        row[p:] = lfilter([1.0], recursion, new[p] * row[p:], zi=begin)[0]
    return rows


def whitened(rows: np.ndarray, memory: np.ndarray) -> np.ndarray:
    """Independent parts (row, n) of rows (row, n) of such noise, each of unit variance: the inverse of `coloured`."""
    orders, new = _predictors(memory)
    p = len(memory)
    white = np.empty_like(rows)
    for t in range(min(p, rows.shape[1])):
        white[:, t] = (rows[:, t] - rows[:, :t][:, ::-1] @ orders[t]) / new[t]
    white[:, p:] = lfilter(np.concatenate([[1.0], -np.asarray(memory)]), [1.0], rows, axis=1)[:, p:] / new[p]
    return white


def _predictors(memory: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
    """Best predictors from the last 0, 1, ..., p samples, and the standard deviations of what they leave (p + 1,).

    Levinson's recursion, downwards: Brockwell & Davis, Time Series (1991), section 5.2.
    """
    orders, reflections = [np.asarray(memory, dtype=float)], []
    while orders[0].size:
        last = orders[0][-1]
        reflections.insert(0, last)
        orders.insert(0, (orders[0][:-1] + last * orders[0][:-1][::-1]) / (1.0 - last**2))
    return orders, np.sqrt(np.cumprod([1.0, *(1.0 - np.array(reflections) ** 2)]))
