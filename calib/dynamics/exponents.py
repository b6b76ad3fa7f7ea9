"""Lyapunov exponents: the rates at which small differences grow or shrink along an orbit."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calib.dynamics.tangent import tangent
from calib.modelling.orbit import PeriodMap, Tangent

ALIGNMENT_PERIODS = 50  # in which vectors turn towards the direction that grows most, before growth counts
BLOCK_COUNTS = (10, 20)  # growth of neighbouring periods is correlated; that of blocks hardly is
MIN_PERIODS = 40  # from which a standard error is estimated
Carry = Callable[[PeriodMap, np.ndarray, np.ndarray, int], Tangent]


@dataclass(frozen=True, eq=False)
class Exponent:
    """Largest exponent of an orbit.

    Attributes
    ----------
    value : mean logarithm of the growth, minus infinity where the difference is wiped out, NaN without any period
        [1/period]
    error : standard error of `value`; 0 where that is infinite, NaN for fewer than 40 periods  [1/period]
    logarithms : (n,) of the growth of each period that counts  [1]
    states : (k, dimension) section states of the whole orbit, k = n + 50
    vector : (dimension, 1) the difference at the end, of length 1 in units of the map's scale
    complete : whether the orbit ran as many periods as were asked for
    """

    value: float
    error: float
    logarithms: np.ndarray
    states: np.ndarray
    vector: np.ndarray
    complete: bool


def largest_exponent(map: PeriodMap, state: np.ndarray, periods: int, carry: Carry = tangent) -> Exponent:
    """Largest exponent over `periods` periods, after 50 in which the difference aligns with the fastest growth.

    The mean of ln R_k, with R_k the growth of one difference in period k, made a unit vector after each.

    Parameters
    ----------
    state : (dimension,) to start from, on the attractor
    carry : along which orbit: `calib.dynamics.pseudo_orbit.pseudo_tangent` for one that is the same on all processors

    Source: Benettin et al. (1980), Meccanica 15, 9-20 (theory) and 21-30 (numerical application).
    """
    size = len(state)
    aligned = carry(map, state, _start(size, 1), ALIGNMENT_PERIODS)
    if len(aligned.states) < ALIGNMENT_PERIODS:
        return _exponent(np.zeros(0), aligned.states, aligned.vectors, complete=False)
    return extended(map, _exponent(np.zeros(0), aligned.states, aligned.vectors, complete=True), periods, carry)


def extended(map: PeriodMap, exponent: Exponent, periods: int, carry: Carry = tangent) -> Exponent:
    """Return the exponent of an orbit continued by `periods` periods.

    Parameters
    ----------
    exponent : of a complete orbit
    carry : as in `largest_exponent`
    """
    carried = carry(map, exponent.states[-1], exponent.vector, periods)
    return _exponent(
        np.concatenate([exponent.logarithms, _logarithms(carried.growth)[:, 0]]),
        np.concatenate([exponent.states, carried.states]),
        carried.vectors,
        len(carried.states) == periods,
    )


def spectrum(map: PeriodMap, state: np.ndarray, periods: int) -> np.ndarray:
    """All exponents (dimension,) over `periods` periods, after 50 in which the differences align  [1/period].

    The means of ln R_k[i, i] of J_k V_(k-1) = V_k R_k, in falling order; minus infinity for a direction that is wiped
    out, NaN where the orbit fails on the way.

    Parameters
    ----------
    state : (dimension,) to start from, on the attractor

    Source: Shimada and Nagashima (1979), Progress of Theoretical Physics 61, 1605-1616; Benettin et al. (1980).
    """
    size = len(state)
    aligned = tangent(map, state, _start(size, size), ALIGNMENT_PERIODS)
    if len(aligned.states) < ALIGNMENT_PERIODS:
        return np.full(size, np.nan)
    carried = tangent(map, aligned.states[-1], aligned.vectors, periods)
    if len(carried.states) < periods:
        return np.full(size, np.nan)
    return np.sort(_logarithms(carried.growth).mean(axis=0))[::-1]


def standard_error(values: np.ndarray) -> float:
    """Return the standard error of the mean of a correlated series (n,): the larger one of 10 and of 20 block means."""
    if len(values) < MIN_PERIODS:
        return math.nan
    if not np.isfinite(values).all():
        return 0.0
    return max(
        float(values[len(values) % count :].reshape(count, -1).mean(axis=1).std(ddof=1)) / math.sqrt(count)
        for count in BLOCK_COUNTS
    )


def _start(size: int, count: int) -> np.ndarray:
    """Vectors (size, count) that no direction of a simulator is likely to be at right angles to."""
    return np.ones((size, 1)) if count == 1 else np.ones((size, count)) + np.diag(np.arange(1.0, size + 1.0))


def _exponent(logarithms: np.ndarray, states: np.ndarray, vector: np.ndarray, complete: bool) -> Exponent:
    value = float(logarithms.mean()) if logarithms.size else math.nan
    return Exponent(value, standard_error(logarithms), logarithms, states, vector, complete)


def _logarithms(growth: np.ndarray) -> np.ndarray:
    """Logarithms (n, m) of the diagonals of `growth` (n, m, m)."""
    with np.errstate(divide="ignore"):  # a phase of contact wipes a direction out: zero, whose logarithm is -inf
        return np.log(np.diagonal(growth, axis1=1, axis2=2))
