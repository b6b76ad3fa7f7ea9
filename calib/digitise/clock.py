"""Time along a phase curve, which shows none: from dq = v dt."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import Akima1DInterpolator
from scipy.optimize import isotonic_regression, nnls

from calib.errors import CalibError

LOOP_NODES = 2000  # points that a loop is drawn through
MIN_LOOP_POINTS = 8  # of a loop
TURN_SPEED = 0.6  # of the greatest speed: up to it from rest the slowness of a turning point is fitted
MAX_KNOTS = 72  # of the slowness dt / dv over that stretch
DENSE_KNOT_SPEED = 0.25  # of the greatest speed: up to it from rest the knots are dense, beyond ever wider apart
BEND_WEIGHTS = 10.0 ** np.arange(2.0, -10.0, -1.0)  # weights tried on the bends of the slowness
REWEIGHTINGS = 3  # of the bends, by their magnitude
CORRELATED_NODES = 3.0  # that count as one independent node, since their errors are correlated
NOISE_SHARE = 0.2  # of the curve's noise: for a residual below it the slowness needs no further bend
MIN_RESIDUAL = 2e-6  # of the amplitude: the same for a curve without noise
SHARP_BEND = 0.05  # of the mean slowness: from it on a bend counts as a parameter, and may be sharp
MAX_TURN_RESIDUAL = 6e-4  # of the extent of a loop: residual of a polynomial at a smooth turning point
ZERO_FIT_SPEED = 0.4  # of the greatest speed: up to it from rest displacement is fitted to find where it turns
MIN_POINT_DISTANCE = 1e-9  # of the size of a loop: points nearer to each other are one
JUMP_RATIO = 4.0  # of a stretch to its neighbours: from it on the stretch is a straight line of which no point was read
MIN_SPEED = 1e-9  # of the amplitude: below it the body is at rest


@dataclass(frozen=True, eq=False)
class NodeLoop:
    """A closed phase curve, as nodes at equal distances along it.

    Attributes
    ----------
    displacement, velocity : (n,) in the direction of time, the last followed by the first  [m], [m/s]
    position : (n,) of each node along the points that were given, in points; it grows in the direction of time
        where `reversed` is False
    reversed : whether the points were given against the direction of time
    """

    displacement: np.ndarray
    velocity: np.ndarray
    position: np.ndarray
    reversed: bool

    def carried(self, values: np.ndarray) -> np.ndarray:
        """Values (..., point, 2) of the given points at the nodes: (..., node, 2), between points by straight lines."""
        before = np.floor(self.position).astype(int)
        share = (self.position - before)[:, None]
        size = values.shape[-2]
        return (1.0 - share) * values[..., before % size, :] + share * values[..., (before + 1) % size, :]


@dataclass(frozen=True, eq=False)
class Turn:
    """A stretch of nodes through a velocity of zero, and how its slowness dt / dv is found.

    Attributes
    ----------
    first, last : nodes; `last` may lie beyond the end of the loop, which is gone round
    knots : (m,) velocities over the greatest speed, between which the slowness is linear
    penalty : (k, m) bends of the slowness, weighed
    moving : (m,) where the slowness is not zero; it is where the velocity jumps
    """

    first: int
    last: int
    knots: np.ndarray
    penalty: np.ndarray
    moving: np.ndarray


@dataclass(frozen=True, eq=False)
class LoopClock:
    """Time along a loop.

    Attributes
    ----------
    time : (n + 1,) of each node and of the first one again, from 0; never falls  [s]
    turns : the turning points
    drift : displacement that the velocity adds up to over a cycle, which should be none, over the amplitude  [1]
    backwards : time that the curve asks to go back in, over the period  [1]
    zero : velocity at which displacement is greatest and least, which should be none, over the greatest speed; the mean
        of all turning points without a jump, NaN without one  [1]
    """

    time: np.ndarray
    turns: Sequence[Turn]
    drift: float
    backwards: float
    zero: float

    @property
    def period(self) -> float:
        """Time once round [s]."""
        return float(self.time[-1])


def loop(points: np.ndarray, nodes: int = LOOP_NODES) -> NodeLoop:
    """Draw a smooth closed curve through points, and turn it into the direction of time.

    Where velocity is positive displacement grows, so a phase curve is passed clockwise.

    Parameters
    ----------
    points : (n, 2) displacement [m] and velocity [m/s] along the curve; the last is followed by the first

    Raises
    ------
    CalibError : too few points, or a curve that encloses nothing
    """
    points = np.asarray(points, dtype=float)
    size = np.ptp(points, axis=0)
    if len(points) < MIN_LOOP_POINTS or not (size > 0.0).all():
        raise CalibError(
            f"a phase curve needs at least {MIN_LOOP_POINTS} points that differ in displacement and velocity, "
            f"got {len(points)}"
        )
    given, position = len(points), np.arange(len(points))
    away = np.linalg.norm(np.diff(points, axis=0, append=points[:1]) / size, axis=1)
    distinct = away > MIN_POINT_DISTANCE
    points, position, away = points[distinct], position[distinct], away[distinct]
    if len(points) < MIN_LOOP_POINTS:
        raise CalibError(
            f"a phase curve needs at least {MIN_LOOP_POINTS} points at different positions, got {len(points)}"
        )
    points, position = _filled(points, position, away, given)
    away = np.linalg.norm(np.diff(points, axis=0, append=points[:1]) / size, axis=1)
    around = np.sum(0.5 * (points[:, 1] + np.roll(points[:, 1], -1)) * (np.roll(points[:, 0], -1) - points[:, 0]))
    if abs(around) < 1e-4 * np.prod(size):
        raise CalibError("the curve encloses no area, so that it is no phase curve; is it closed, and in order?")
    wrap = 3
    index = np.arange(-wrap, len(points) + wrap + 1)
    along = np.concatenate([[0.0], np.cumsum(away)])
    length = along[-1]
    arc = along[index % len(points)] + length * (index // len(points))
    positions = np.arange(nodes) * length / nodes
    drawn = Akima1DInterpolator(arc, points[index % len(points)], method="makima")(positions)
    at = np.interp(positions, along, np.append(position, position[0] + given))
    if around < 0.0:
        return NodeLoop(drawn[::-1, 0], drawn[::-1, 1], at[::-1], True)
    return NodeLoop(drawn[:, 0], drawn[:, 1], at, False)


def _filled(points: np.ndarray, position: np.ndarray, away: np.ndarray, given: int) -> tuple[np.ndarray, np.ndarray]:
    """Points and their positions with straight lines of points where a stretch is much longer than those about it."""
    size = len(points)
    around = np.arange(-5, 6)
    near = np.median(away[(np.arange(size)[:, None] + around) % size], axis=1)
    parts = np.where(away > JUMP_RATIO * near, np.ceil(away / near), 1).astype(int)
    parts = np.minimum(parts, 200)
    start = np.repeat(np.arange(size), parts)
    share = (np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)) / np.repeat(parts, parts)
    following = np.append(position[1:], position[0] + given)
    ends = points[(start + 1) % size]
    return (
        points[start] + share[:, None] * (ends - points[start]),
        position[start] + share * (following[start] - position[start]),
    )


def clock(loop: NodeLoop, noise: float = 0.0, turns: Sequence[Turn] | None = None) -> LoopClock:
    """Find the time of each node.

    dt = dq / v between nodes. Where v passes through zero this is 0 / 0: there dt = g dv with a slowness g(v) >= 0, the
    inverse of the acceleration, that bends as little as it can while q = q0 + integral of v g dv stays as near to the
    curve as its noise is large. Bends are weighed by their magnitude, so that few sharp ones cost less than many small
    ones: where v jumps while q stays, g is zero up to a corner, and the jump takes no time, as it should.

    Parameters
    ----------
    noise : standard uncertainty of the displacement  [m]
    turns : the turning points of a loop that differs little, to be taken again

    Raises
    ------
    CalibError : velocity has one sign only, or the curve runs against time
    """
    q, v = loop.displacement, loop.velocity
    size, top = q.size, float(np.abs(v).max())
    crossings = np.flatnonzero((v >= 0.0) != (np.roll(v, -1) >= 0.0))
    if crossings.size < 2:
        raise CalibError(
            "the velocity of the phase curve has one sign only, so that the body never returns; "
            "check which axis is velocity, and where its zero is"
        )
    if turns is None:
        turns = _distinct([_turn(q, v / top, int(at), noise) for at in crossings], size)
    speed = v + np.roll(v, -1)
    least = MIN_SPEED * top
    steps = 2.0 * (np.roll(q, -1) - q) / np.where(np.abs(speed) > least, speed, np.inf)
    for turn in turns:
        index = np.arange(turn.first, turn.last + 1) % size
        steps[index[:-1]] = np.diff(_passed(q[index], v[index] / top, turn)) / top
    whole = float(steps.sum())
    if not (np.isfinite(steps).all() and whole > 0.0):
        raise CalibError(
            "the phase curve takes no time or runs against it; where velocity is positive displacement has to grow: "
            "check which axis is which, and their signs"
        )
    raw = np.concatenate([[0.0], np.cumsum(steps)])
    time = np.maximum(np.asarray(isotonic_regression(raw).x), 0.0)
    time = (time - time[0]) * whole / (time[-1] - time[0])
    drift = np.sum(0.5 * speed * np.diff(time)) / (0.5 * np.ptp(q))
    back = float((np.maximum.accumulate(raw) - raw).max()) / whole
    return LoopClock(time, turns, float(drift), back, _zero(q, v / top, turns))


def _zero(q: np.ndarray, v: np.ndarray, turns: Sequence[Turn]) -> float:
    """Mean velocity, over the greatest speed, at which displacement turns."""
    zeros = []
    for turn in turns:
        index = np.arange(turn.first, turn.last + 1) % q.size
        near = index[np.abs(v[index]) < ZERO_FIT_SPEED]
        if near.size < 20 or min(-v[near].min(), v[near].max()) < 0.9 * ZERO_FIT_SPEED:
            continue
        fitted = np.polynomial.Polynomial.fit(v[near], q[near], 4)
        if np.abs(fitted(v[near]) - q[near]).max() > MAX_TURN_RESIDUAL * np.ptp(q):  # a jump
            continue
        roots = fitted.deriv().roots()
        roots = roots[np.isreal(roots)].real
        if roots.size:
            zeros.append(float(roots[np.argmin(np.abs(roots))]))
    return float(np.mean(zeros)) if zeros else float("nan")


def _distinct(turns: Sequence[Turn], size: int) -> list[Turn]:
    """Turning points of which none lies inside another."""
    distinct, taken = [], np.zeros(size, dtype=bool)
    for turn in sorted(turns, key=lambda t: t.first - t.last):
        nodes = np.arange(turn.first, turn.last) % size
        if not taken[nodes].any():
            distinct.append(turn)
            taken[nodes] = True
    return distinct


def _turn(q: np.ndarray, v: np.ndarray, at: int, noise: float) -> Turn:
    """Stretch about the change of sign after node `at`; v is over the greatest speed."""
    size = q.size
    first, last = _side(v, at, -1), _side(v, at + 1, 1)
    index = np.arange(first, last + 1) % size
    span = np.ptp(q)
    q, v = q[index] / (0.5 * span), v[index]
    count = int(np.clip(MAX_KNOTS * np.ptp(v) / (2.0 * TURN_SPEED), 4, MAX_KNOTS))
    ends = np.arcsinh(np.array([v.min(), v.max() + 1e-12]) / DENSE_KNOT_SPEED)
    knots = DENSE_KNOT_SPEED * np.sinh(np.linspace(ends[0], ends[1], count))
    knots[[0, -1]] = v.min(), v.max() + 1e-12
    design, right = _centred(q, v, knots)
    root, right = _reduced(design, right)
    fits: list[tuple[float, Turn]] = []
    independent, enough = len(v) / CORRELATED_NODES, (2.0 * NOISE_SHARE * noise / span) ** 2 + MIN_RESIDUAL**2
    for stiffness in BEND_WEIGHTS:
        slowness, penalty, residual, bends = _fitted_slowness(design, q, root, right, stiffness)
        criterion = independent * np.log(residual**2 + enough) + bends * np.log(independent)  # Schwarz (1978)
        fits.append((criterion, Turn(first, last, knots, penalty, slowness > 0.0)))
    return min(fits, key=lambda fit: fit[0])[1]


def _fitted_slowness(
    design: np.ndarray, q: np.ndarray, root: np.ndarray, right: np.ndarray, stiffness: float
) -> tuple[np.ndarray, np.ndarray, float, int]:
    """Slowness (m,) at the knots, its penalty (k, m), root mean square residual of q, and number of bends."""
    bends = np.diff(np.eye(design.shape[1]), 2, axis=0)
    below = np.concatenate([right, np.zeros(len(bends))])
    weight = np.ones(len(bends))
    for _ in range(REWEIGHTINGS):
        penalty = np.sqrt(stiffness * weight)[:, None] * bends
        slowness = nnls(np.vstack([root, penalty]), below)[0]
        weight = 1.0 / (np.abs(bends @ slowness) / (SHARP_BEND * slowness.mean() + 1e-300) + 1.0)
    sharp = np.abs(bends @ slowness) > SHARP_BEND * slowness.mean()
    return slowness, penalty, float(np.sqrt(np.mean((design @ slowness - (q - q.mean())) ** 2))), 2 + int(sharp.sum())


def _side(v: np.ndarray, start: int, step: int) -> int:
    """Last node from `start` on up to which the speed keeps its sign, grows but for noise, and is below TURN_SPEED."""
    size = v.size
    index = start + step * np.arange(size // 2)
    signed = v[index % size] * (np.sign(v[start % size]) or np.sign(v[(start + step) % size]))
    inside = (signed <= TURN_SPEED) & (signed >= np.maximum.accumulate(signed) - 0.01)
    count = size // 2 if inside.all() else int(np.argmin(inside))
    return int(index[max(count, 1) - 1])


def _integrals(v: np.ndarray, knots: np.ndarray, weighed: bool) -> np.ndarray:
    """Integrals (n, m) from the first knot to v of hat functions, times the velocity where `weighed`."""
    widths = np.diff(knots)
    cell = np.clip(np.searchsorted(knots, v, side="right") - 1, 0, knots.size - 2)

    def inside(cell: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        width = widths[cell]
        low, high = width * (u - u**2 / 2.0), width * u**2 / 2.0
        if not weighed:
            return low, high
        return knots[cell] * low + width**2 * (u**2 / 2.0 - u**3 / 3.0), knots[cell] * high + width**2 * u**3 / 3.0

    whole = np.zeros((knots.size, knots.size))
    cells = np.arange(knots.size - 1)
    low, high = inside(cells, np.ones(cells.size))
    whole[cells + 1, cells] += low
    whole[cells + 1, cells + 1] += high
    integrals = np.cumsum(whole, axis=0)[cell]
    low, high = inside(cell, (v - knots[cell]) / widths[cell])
    rows = np.arange(v.size)
    integrals[rows, cell] += low
    integrals[rows, cell + 1] += high
    return integrals


def _centred(q: np.ndarray, v: np.ndarray, knots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Equations for the slowness, q0 taken out of them; the slowness counts along the direction of passing."""
    design = np.sign(v[-1] - v[0]) * _integrals(v, knots, weighed=True)
    return design - design.mean(axis=0), q - q.mean()


def _reduced(design: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return equations with the same least squares as `design` x = `right`, per node, as few as there are unknowns."""
    turn, root = np.linalg.qr(design)
    return root / np.sqrt(len(right)), turn.T @ right / np.sqrt(len(right))


def _passed(q: np.ndarray, v: np.ndarray, turn: Turn) -> np.ndarray:
    """Time (n,) at nodes of a turning point, times the greatest speed [m]."""
    if v.size < 3:
        return np.zeros(v.size)
    design, right = _centred(q, v, turn.knots)
    root, right = _reduced(design[:, turn.moving], right)
    penalty = turn.penalty[:, turn.moving]
    stacked = np.vstack([root, penalty]), np.concatenate([right, np.zeros(len(penalty))])
    slowness = np.linalg.lstsq(*stacked, rcond=None)[0]
    return np.sign(v[-1] - v[0]) * _integrals(v, turn.knots, weighed=False)[:, turn.moving] @ slowness
