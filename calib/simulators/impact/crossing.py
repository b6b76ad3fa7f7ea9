"""Motion from where a compliant contact begins, under a force with a power of the penetration that has no series there.

With x = tau / step from d = 0 on, the motion is the double series

    sum over j, i of c_ji x^(i + j (n + 1))

in its branches j, of which each is the response to the force that those before it make: with d = x D the force
k d^n (1 + loss d') is x^n times a double series of the same exponents, and two integrals take x^n x^(i + j (n + 1)) to
x^(i + 1 + (j + 1) (n + 1)). It serves for as long as the force changes little of the velocity;
`fictitious_time` goes on.
"""

import math

import numpy as np
from numba import njit

from calib.simulators.compilation import ENCLOSED, INLINED, WITHIN
from calib.simulators.impact.problem import FREE, Compliance, ImpactState, Problem, Regimes
from calib.simulators.impact.scratch import BRANCHES, TERMS

NEGLIGIBLE_TERM = 1e-13  # terms below that share of the largest are left out
MIN_TERMS = 6  # of the first branch, so that the polynomials of the loads have entered
MAX_FORCE_CHANGE = 0.06  # of the velocity by the force over the step, as a share of it
MAX_OTHER_CHANGE = 0.25  # of the velocity by what acts out of contact
MAX_DAMPED_CHANGE = 0.6  # of the velocity by a damper
# rows of `Scratch.lattice`: penetration, that times its exponent less one, power d^n, force; for differences d^(n - 1),
# the force's derivatives by the penetration and by its rate, difference of the penetration; from `MODAL` on modes
PATH, WEIGHTED, POWERS, PRESSURE, LOWER, PER_DEPTH, PER_RATE, DIFFERENCE, MODAL = range(9)


@njit(**INLINED)
def has_series_at_ends(law: Compliance) -> bool:
    """Whether the power has a series about d = 0 in the root of time, as where n = 1.5."""
    return math.floor(2.0 * law.exponent) == 2.0 * law.exponent


@njit(**WITHIN)
def time_about_crossing(law: Compliance, loss: float, speed: float, acceleration: float) -> float:
    """Time [s] after d = 0 over which the double series may serve; d sets out with this speed and acceleration."""
    if not speed > 0.0:
        return 0.0
    n = law.exponent
    force = law.stiffness * (1.0 + loss * speed) / (n + 1.0) * speed ** (n - 1.0)
    time = (MAX_FORCE_CHANGE / force) ** (1.0 / (n + 1.0))
    if acceleration != 0.0:
        time = min(time, MAX_OTHER_CHANGE * speed / abs(acceleration))
    if law.damping > 0.0:
        time = min(time, MAX_DAMPED_CHANGE / law.damping)
    return time


@njit(**INLINED)
def _products(
    factor: np.ndarray, weighted: np.ndarray, power: np.ndarray, last: np.ndarray, j: int, i: int
) -> tuple[float, float]:
    """Sums over a + b = (j, i), a not (0, 0), of factor[a] power[b] and of weighted[a] power[b]; factor = d / x."""
    plain, by_exponent = 0.0, 0.0
    for ja in range(j + 1):
        jb = j - ja
        low, high = max(0, i - last[jb] + 1), min(i, last[ja] - 1)
        if ja == 0 and low == 0:
            low = 1
        for ia in range(low, high + 1):
            other = power[jb, i - ia]
            plain += factor[ja, ia + 1] * other
            by_exponent += weighted[ja, ia + 1] * other
    return plain, by_exponent


@njit(**ENCLOSED)
def expand_about_crossing(
    regimes: Regimes,
    law: Compliance,
    loss: float,
    omega: float,
    loaded: bool,
    load: np.ndarray,
    added: np.ndarray,
    state: ImpactState,
    time: float,
    step: float,
    lattice: np.ndarray,
    last: np.ndarray,
) -> float:
    """Write the double series over a step from `time` [s] since the whole period, at which d = 0.

    Parameters
    ----------
    loss : factor of the contact at hand  [s/m]
    loaded, load, added : as of `witness.witness`
    lattice, last : of `Scratch`, written

    Returns
    -------
    ratio : of the length over which the series have converged and the penetration grows all along, to the step; 1 at
        most, NaN where they are not finite
    """
    n, exponent = state.y.size, law.exponent
    depth, weighted, power, force = lattice[PATH], lattice[WEIGHTED], lattice[POWERS], lattice[PRESSURE]
    modes = lattice[MODAL:]
    square, turn, per_step = step * step, omega * step, 1.0 / step
    c, s = math.cos(omega * time), math.sin(omega * time)
    wc, ws = regimes.witness[FREE, 0], regimes.witness[FREE, 1]
    drive, drive_next = wc * c + ws * s, (ws * c - wc * s) * turn
    opening, largest = drive_next + (added[1] if loaded else 0.0), 0.0
    for i in range(n):
        modes[i, 0, 0], modes[i, 0, 1] = state.y[i], state.v[i] * step
        opening += regimes.witness_y[FREE, i] * modes[i, 0, 1]
        largest = max(largest, abs(modes[i, 0, 1]))
    speed = -opening
    depth[0, 0], depth[0, 1], weighted[0, 1] = 0.0, speed, 0.0
    if not speed > 0.0:
        return math.nan
    changes, ratio, limit = 0.0, 1.0, TERMS - 1
    branches = BRANCHES
    for j in range(BRANCHES):
        base = j * (exponent + 1.0)
        if j > 0:
            depth[j, 0] = 0.0
            for i in range(n):
                modes[i, j, 0] = 0.0
        before, size, whole, end = math.inf, math.inf, 0.0, limit
        for i in range(2 if j == 0 else 1, limit + 1):
            e = i + base
            per_exponents = 1.0 / (e * (e - 1.0))
            acting = law.damping * per_step * (e - 1.0) * depth[j, i - 1]
            if j > 0:
                acting += force[j - 1, i - 1]
            clearance, before, size = 0.0, size, 0.0
            if j == 0:
                drive, drive_next = drive_next, -turn * turn * per_exponents * drive
                clearance = drive_next
                if loaded and i < 5:
                    clearance += added[i]
            for m in range(n):
                still = -2.0 * step * regimes.rate[FREE, m] * (e - 1.0) * modes[m, j, i - 1]
                if i > 1:
                    still -= square * regimes.stiffness[FREE, m] * modes[m, j, i - 2]
                if loaded and j == 0 and i < 7:
                    still += square * load[m, i - 2]
                clearance += regimes.witness_y[FREE, m] * still * per_exponents
                x = (still + square * law.load[m] * acting) * per_exponents
                modes[m, j, i] = x
                size = max(size, e * abs(x) / largest)
            clearance += square * acting * per_exponents
            depth[j, i], weighted[j, i] = -clearance, -(e - 1.0) * clearance
            change = e * abs(clearance) / speed
            size = max(size, change)
            changes += change
            whole = max(whole, size)
            if size <= NEGLIGIBLE_TERM and before <= NEGLIGIBLE_TERM and (j > 0 or i >= MIN_TERMS):
                end = i
                break
        if size > NEGLIGIBLE_TERM and end == TERMS - 1:
            ratio = min(ratio, 0.9 * (NEGLIGIBLE_TERM / size) ** (1.0 / (TERMS - 2)))
        last[j], limit = end, end
        negligible = j > 0 and whole <= NEGLIGIBLE_TERM
        if negligible or j == BRANCHES - 1:
            if not negligible:
                ratio = min(ratio, 0.9 * (NEGLIGIBLE_TERM / whole) ** (1.0 / base))
            branches = j + 1
            break
        for i in range(end):
            e = i + base
            plain, by_exponent = _products(depth, weighted, power, last, j, i)
            if i == 0 and j == 0:
                power[0, 0] = speed**exponent
            else:  # d p' = n p d'
                power[j, i] = ((exponent + 1.0) * by_exponent - e * plain) / (e * speed)
            whole_product = speed * power[j, i] + plain + by_exponent
            force[j, i] = law.stiffness * (power[j, i] + loss * per_step * whole_product)
    last[BRANCHES] = branches
    if not math.isfinite(changes):
        return math.nan
    return ratio if changes < 1.0 else min(ratio, 0.5)


@njit(**WITHIN)
def rescale_about_crossing(law: Compliance, lattice: np.ndarray, last: np.ndarray, ratio: float) -> None:
    """Let the double series hold for a step that is `ratio` times as long."""
    of_power = ratio**law.exponent
    for j in range(last[BRANCHES]):
        factor = ratio ** (j * (law.exponent + 1.0))
        for i in range(last[j] + 1):
            for row in range(MODAL, lattice.shape[0]):
                lattice[row, j, i] *= factor
            for row in (PATH, WEIGHTED):
                lattice[row, j, i] *= factor
            for row in (POWERS, PRESSURE):
                lattice[row, j, i] *= factor * of_power
            factor *= ratio


@njit(**WITHIN)
def motion_about_crossing(
    law: Compliance, lattice: np.ndarray, last: np.ndarray, step: float, tau: float, y: np.ndarray, v: np.ndarray
) -> None:
    """Write the modal motion at `tau` into the step."""
    x = tau / step
    lower = x**law.exponent if x > 0.0 else 0.0
    upper = lower * x
    for m in range(y.size):
        y[m], v[m] = 0.0, 0.0
    for j in range(last[BRANCHES] - 1, -1, -1):
        for m in range(y.size):
            series = lattice[MODAL + m, j]
            value, slope = series[last[j]], 0.0
            for i in range(last[j] - 1, -1, -1):
                slope = slope * x + value
                value = value * x + series[i]
            # y upper^j, whose rate by x is y' upper^j + j (n + 1) lower upper^(j - 1) y
            v[m] = v[m] * upper + (law.exponent + 1.0) * lower * y[m]
            y[m] *= upper
            v[m] += slope
            y[m] += value
    for m in range(y.size):
        v[m] /= step


@njit(**WITHIN)
def _expand_derivatives(law: Compliance, loss: float, step: float, lattice: np.ndarray, last: np.ndarray) -> None:
    """Write the double series of the force's derivatives by the penetration and by its rate."""
    depth, weighted, power, lower = lattice[PATH], lattice[WEIGHTED], lattice[POWERS], lattice[LOWER]
    n, speed = law.exponent, depth[0, 1]
    for j in range(last[BRANCHES] - 1):
        for i in range(last[j]):
            e = i + j * (n + 1.0)
            plain, by_exponent = _products(depth, weighted, lower, last, j, i)
            if i == 0 and j == 0:
                lower[0, 0] = speed ** (n - 1.0)
            else:
                lower[j, i] = (n * by_exponent - e * plain) / (e * speed)
            product = speed * lower[j, i] + plain + by_exponent
            lattice[PER_DEPTH, j, i] = n * law.stiffness * (lower[j, i] + loss / step * product)
            lattice[PER_RATE, j, i] = law.stiffness * loss * power[j, i]


@njit(**ENCLOSED)
def carry_about_crossing(
    problem: Problem,
    state: ImpactState,
    loss: float,
    loss_slope: float,
    step: float,
    tau: float,
    lattice: np.ndarray,
    last: np.ndarray,
    dy: np.ndarray,
    dv: np.ndarray,
    dspeed: np.ndarray,
) -> None:
    """Carry differences by `tau` into a step from the crossing, as `series.carry_differences` does."""
    regimes, law, n = problem.regimes, problem.compliance, dy.shape[0]
    exponent, square = law.exponent, step * step
    _expand_derivatives(law, loss, step, lattice, last)
    power, force, by_depth, by_rate = lattice[POWERS], lattice[PRESSURE], lattice[PER_DEPTH], lattice[PER_RATE]
    depth, modes = lattice[DIFFERENCE], lattice[MODAL:]
    for column in range(dy.shape[1]):
        for j in range(last[BRANCHES]):
            base = j * (exponent + 1.0)
            for i in range(last[j] + 1):
                if j == 0 and i < 2:
                    depth[0, i] = 0.0
                    for m in range(n):
                        modes[m, 0, i] = dy[m, column] if i == 0 else dv[m, column] * step
                        depth[0, i] -= regimes.witness_y[FREE, m] * modes[m, 0, i]
                    continue
                e = i + base
                acting = law.damping / step * (e - 1.0) * depth[j, i - 1] if i > 0 else 0.0
                if j > 0 and i > 0 and loss > 0.0 and i - 1 < last[j - 1]:
                    by_loss = (force[j - 1, i - 1] - law.stiffness * power[j - 1, i - 1]) / loss
                    acting += by_loss * loss_slope * dspeed[column]
                for jb in range(j):
                    ja = j - 1 - jb
                    for ib in range(max(0, i - last[ja]), min(i, last[jb] - 1) + 1):
                        ia = i - ib
                        rate = (ia + ja * (exponent + 1.0)) / step
                        acting += (by_depth[jb, ib] + by_rate[jb, ib] * rate) * depth[ja, ia]
                depth[j, i] = 0.0
                for m in range(n):
                    f = square * law.load[m] * acting
                    if i > 0:
                        f -= 2.0 * step * regimes.rate[FREE, m] * (e - 1.0) * modes[m, j, i - 1]
                    if i > 1:
                        f -= square * regimes.stiffness[FREE, m] * modes[m, j, i - 2]
                    modes[m, j, i] = f / (e * (e - 1.0))
                    depth[j, i] -= regimes.witness_y[FREE, m] * modes[m, j, i]
        motion_about_crossing(law, lattice, last, step, tau, dy[:, column], dv[:, column])
