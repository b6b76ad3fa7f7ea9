"""Seeded test problems for optimisers: calibrations with a residual vector, multimodal functions without one."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.stats import special_ortho_group


@dataclass(frozen=True)
class Outcome:
    """What an evaluation came to, as an optimiser is told it."""

    cost: float
    residuals: np.ndarray | None = None
    status: str = "ok"
    kind: str | None = None


@dataclass(frozen=True)
class Problem:
    """A bounded problem with a target value.

    `residuals` maps a point x (dim,) to a vector, whose root mean square is the cost; a problem without residuals
    has `cost` instead. A `hurdle`, if any, maps x to (failed, kind penalty).
    """

    name: str
    low: np.ndarray
    high: np.ndarray
    target: float
    cost: Callable | None = None
    residuals: Callable | None = None
    hurdle: Callable | None = None

    @property
    def dim(self):
        return len(self.low)

    def value(self, x):
        """Cost at a point x (dim,) given in the problem's own units."""
        return self.cost(x) if self.residuals is None else root_mean_square(self.residuals(x))

    def outcome(self, u):
        """Outcome at a point u (dim,) of the unit cube."""
        x = self.low + np.asarray(u) * (self.high - self.low)
        failed, penalty = self.hurdle(x) if self.hurdle else (False, 0.0)
        if failed:
            return Outcome(np.inf, None, "diverged")
        if self.residuals is None:
            return Outcome(float(self.cost(x) + penalty))
        residuals = self.residuals(x)
        return Outcome(root_mean_square(residuals) + penalty, residuals, kind="wrong" if penalty else "right")


def root_mean_square(residuals):
    """Root mean square of a vector, as a float."""
    return float(np.sqrt(residuals @ residuals / residuals.size))


# ---------------------------------------------------------------------------- calibrations, with a residual vector
def ring_down(time, amplitude, frequency, log_damping):
    """Sum of damped modes, displacement (time,); frequency [Hz], log_damping is log10 of the damping ratio [1]."""
    omega = 2 * np.pi * np.asarray(frequency)[:, None]
    envelope = np.asarray(amplitude)[:, None] * np.exp(-(10.0 ** np.asarray(log_damping)[:, None]) * omega * time)
    return (envelope * np.sin(omega * time)).sum(axis=0)


def ringdown6(seed):
    """Two damped modes fitted to a noisy ring-down: amplitudes, frequencies [Hz], log10 damping ratios."""
    rng = np.random.default_rng(2000 + seed)
    time = np.linspace(0, 0.5, 300)  # s
    truth = np.array([1.5, 0.8, 22 + 6 * rng.random(), 70 + 20 * rng.random(), -2.0, -1.7])
    measured = ring_down(time, truth[:2], truth[2:4], truth[4:]) + 0.05 * rng.standard_normal(time.size)

    def residuals(x):
        return ring_down(time, x[:2], x[2:4], x[4:]) - measured

    low, high = np.array([0.1, 0.1, 10, 40, -3.5, -3.5]), np.array([3, 3, 40, 120, -0.7, -0.7])
    return Problem("ringdown6", low, high, 1.1 * root_mean_square(residuals(truth)), residuals=residuals)


def ringdown9(seed):
    """Three damped modes, two of them close, fitted to a noisy ring-down: nine parameters."""
    rng = np.random.default_rng(5000 + seed)
    time = np.linspace(0, 0.4, 400)  # s
    frequency = np.array([18 + 6 * rng.random(), 34 + 6 * rng.random(), 75 + 20 * rng.random()])
    truth = np.concatenate([[1.2, 0.9, 0.6], frequency, [-1.8, -1.9, -1.6]])
    measured = ring_down(time, truth[:3], truth[3:6], truth[6:]) + 0.05 * rng.standard_normal(time.size)

    def residuals(x):
        return ring_down(time, x[:3], x[3:6], x[6:]) - measured

    low = np.array([0.1, 0.1, 0.1, 10, 28, 60, -3.0, -3.0, -3.0])
    high = np.array([3, 3, 3, 28, 60, 120, -0.7, -0.7, -0.7])
    return Problem("ringdown9", low, high, 1.1 * root_mean_square(residuals(truth)), residuals=residuals)


def failing6(seed):
    """ringdown6 behind a slab in which the simulation fails, with the truth 2 % of the window from its edge."""
    plain = ringdown6(seed)
    edge = 0.3 - 0.02  # the truth's log10 damping lies at 0.54 and 0.64 of the window

    def hurdle(x):
        u = (x - plain.low) / (plain.high - plain.low)
        return bool(u[4] - 0.2 * u[0] < edge - 0.1 or u[3] + u[5] > 1.55), 0.0

    return Problem("failing6", plain.low, plain.high, plain.target, residuals=plain.residuals, hurdle=hurdle)


def receptance8(seed):
    """Two close modes and two residual terms fitted to the logarithm of a measured receptance."""
    rng = np.random.default_rng(6000 + seed)
    frequency = np.linspace(10, 60, 200)  # Hz
    truth = np.array([24 + 6 * rng.random(), 33 + 4 * rng.random(), -2.0, -1.7, 0.0, -0.3, -2.5, -3.5])

    def model(x):
        total = 10.0 ** x[6] - 10.0 ** x[7] * (10 / frequency) ** 2 + 0j
        for i in range(2):
            ratio = frequency / x[i]
            total += 10.0 ** x[4 + i] / (1 - ratio**2 + 2j * 10.0 ** x[2 + i] * ratio) / 10
        return np.log(np.abs(total) + 1e-6)

    measured = model(truth) + 0.05 * rng.standard_normal(frequency.size)

    def residuals(x):
        return model(x) - measured

    low, high = np.array([15, 28, -3.0, -3.0, -1, -1, -5, -5]), np.array([32, 50, -1, -1, 1, 1, -1, -1.0])
    return Problem("receptance8", low, high, 1.1 * root_mean_square(residuals(truth)), residuals=residuals)


@njit(cache=True)
def stop_acceleration(x, v, t, stiffness, damping, cubic, stop_stiffness, stop_damping, gap, force, omega):
    """Acceleration of a driven mass with a cubic spring, which meets a one-sided stop beyond the gap."""
    contact = 0.0
    if x > gap:
        contact = max(0.0, stop_stiffness * (x - gap) + stop_damping * v)
    return force * np.cos(omega * t) - damping * v - stiffness * x - cubic * x * x * x - contact


@njit(cache=True)
def stop_orbit(omega0, zeta, cubic, stop_stiffness, stop_damping, gap, force, omega, periods, steps, samples):
    """Last of many periods of the stop oscillator by the classical Runge-Kutta rule: displacement, velocity/omega.

    Returns
    -------
    (2, samples) array; filled with 1e3 where the motion diverged
    """
    h = 2 * np.pi / omega / steps
    k, c = omega0 * omega0, 2 * zeta * omega0
    x, v, t = 0.0, 0.0, 0.0
    orbit = np.full((2, samples), 1e3)
    stride = steps // samples
    for i in range(periods * steps):
        phase = i - (periods - 1) * steps
        if phase >= 0 and phase % stride == 0:
            orbit[0, phase // stride] = x
            orbit[1, phase // stride] = v / omega
        a1 = stop_acceleration(x, v, t, k, c, cubic, stop_stiffness, stop_damping, gap, force, omega)
        x2, v2 = x + h / 2 * v, v + h / 2 * a1
        a2 = stop_acceleration(x2, v2, t + h / 2, k, c, cubic, stop_stiffness, stop_damping, gap, force, omega)
        x3, v3 = x + h / 2 * v2, v + h / 2 * a2
        a3 = stop_acceleration(x3, v3, t + h / 2, k, c, cubic, stop_stiffness, stop_damping, gap, force, omega)
        x4, v4 = x + h * v3, v + h * a3
        a4 = stop_acceleration(x4, v4, t + h, k, c, cubic, stop_stiffness, stop_damping, gap, force, omega)
        x += h / 6 * (v + 2 * v2 + 2 * v3 + v4)
        v += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        t += h
        if not abs(x) < 1e3:
            return np.full((2, samples), 1e3)
    return orbit


STOP_LOW = np.array([0.9, -2.5, -2.0, 0.5, -2.0, 0.2])  # omega0, then log10 of zeta, cubic, stop stiffness,
STOP_HIGH = np.array([1.1, -0.7, 0.0, 3.0, 1.0, 1.5])  # stop damping; gap


def phase_curve(x, periods=60):
    """Phase curve (2, 64) of the stop oscillator at parameters x (6,)."""
    return stop_orbit(x[0], *10.0 ** x[1:5], x[5], 0.25, 1.02, periods, 256, 64)


def returns(x, curve):
    """Whether the motion at x comes back after one period."""
    return np.abs(phase_curve(x, 61) - curve).max() < 1e-3


def stop_truth(rng):
    """Parameters away from the centre of their windows whose motion has period one and impacts, with its curve."""
    while True:
        truth = STOP_LOW + (STOP_HIGH - STOP_LOW) * rng.uniform(0.15, 0.85, 6)
        curve = phase_curve(truth)
        centred = np.abs((truth - (STOP_LOW + STOP_HIGH) / 2) / (STOP_HIGH - STOP_LOW)).max() <= 0.25
        if not centred and curve[0].max() > truth[5] and returns(truth, curve):
            return truth, curve


def impact6(seed):
    """Driven oscillator with a one-sided penalty stop fitted on its noisy phase curve; it bifurcates: rough."""
    rng = np.random.default_rng(3000 + seed)
    truth, curve = stop_truth(rng)
    measured = curve + 0.02 * np.abs(curve).max() * rng.standard_normal(curve.shape)

    def residuals(x):
        return ((phase_curve(x) - measured) / np.abs(measured).max()).ravel()

    return Problem("impact6", STOP_LOW, STOP_HIGH, 1.25 * root_mean_square(residuals(truth)), residuals=residuals)


def kinds6(seed):
    """impact6 with the kind of motion first: a motion that does not return after one period is 10 worse."""
    plain = impact6(seed)

    def hurdle(x):
        curve = phase_curve(x)
        return bool(curve[0, 0] == 1e3), 0.0 if returns(x, curve) else 10.0

    return Problem("kinds6", plain.low, plain.high, plain.target, residuals=plain.residuals, hurdle=hurdle)


def creep5(seed):
    """Two exponentials and a constant, the classical ill-conditioned fit: amplitudes, log10 rates, offset."""
    rng = np.random.default_rng(7000 + seed)
    time = np.linspace(0, 5, 120)  # s
    truth = np.append(rng.uniform([0.5, 0.5, -0.6, 0.2], [1.5, 1.5, -0.2, 0.6]), 0.2)

    def model(x):
        return x[0] * np.exp(-(10.0 ** x[2]) * time) + x[1] * np.exp(-(10.0 ** x[3]) * time) + x[4]

    measured = model(truth) + 0.01 * rng.standard_normal(time.size)

    def residuals(x):
        return model(x) - measured

    low, high = np.array([0, 0, -2, -2, -1.0]), np.array([3, 3, 1, 1, 1.0])
    return Problem("creep5", low, high, 1.1 * root_mean_square(residuals(truth)), residuals=residuals)


# ------------------------------------------------------------------------------- functions without a residual vector
HARTMANN_WEIGHT = np.array([1, 1.2, 3, 3.2])  # Hartman (1973); Dixon & Szegoe (1978)
HARTMANN_RATE = np.array(
    [[10, 3, 17, 3.5, 1.7, 8], [0.05, 10, 17, 0.1, 8, 14], [3, 3.5, 1.7, 10, 17, 8], [17, 8, 0.05, 10, 0.1, 14]]
)
HARTMANN_PLACE = 1e-4 * np.array(
    [
        [1312, 1696, 5569, 124, 8283, 5886],
        [2329, 4135, 8307, 3736, 1004, 9991],
        [2348, 1451, 3522, 2883, 3047, 6650],
        [4047, 8828, 8732, 5743, 1091, 381],
    ]
)


def hartmann6(seed):
    """Hartmann's function in six dimensions; its least value is -3.32237. The seed does not enter."""

    def cost(x):
        return -float(HARTMANN_WEIGHT @ np.exp(-(HARTMANN_RATE * (x - HARTMANN_PLACE) ** 2).sum(axis=1)))

    return Problem("hartmann6", np.zeros(6), np.ones(6), -3.31237, cost=cost)


def bumpy_bowl(z):
    """Rastrigin's function at z (dim,): z'z + 10 sum(1 - cos 2 pi z)."""
    return float(10 * z.size + (z * z - 10 * np.cos(2 * np.pi * z)).sum())


def rastrigin6(seed):
    """Shifted Rastrigin: about 10^6 minima; the target lies inside the basin of the least."""
    shift = np.random.default_rng(1000 + seed).uniform(-2.5, 2.5, 6)
    return Problem("rastrigin6", np.full(6, -5.12), np.full(6, 5.12), 0.5, cost=lambda x: bumpy_bowl(x - shift))


def rotated6(seed):
    """The shifted Rastrigin turned by a random rotation about its least point: not separable."""
    shift = np.random.default_rng(1000 + seed).uniform(-2.5, 2.5, 6)
    turn = special_ortho_group.rvs(6, random_state=np.random.default_rng(4000 + seed))
    return Problem("rotated6", np.full(6, -5.12), np.full(6, 5.12), 0.5, cost=lambda x: bumpy_bowl(turn @ (x - shift)))


def ackley6(seed):
    """Shifted Ackley: a narrow hole in a bumpy plain, without a quadratic trend."""
    shift = np.random.default_rng(8000 + seed).uniform(-15, 15, 6)

    def cost(x):
        z = x - shift
        return float(20 + np.e - 20 * np.exp(-0.2 * np.sqrt(z @ z / 6)) - np.exp(np.cos(2 * np.pi * z).mean()))

    return Problem("ackley6", np.full(6, -32.0), np.full(6, 32.0), 0.5, cost=cost)


def double_funnel6(seed):
    """Lunacek's bi-Rastrigin: the wider of two bumpy funnels is the wrong one (Lunacek, Whitley & Sutton 2008)."""
    turn = special_ortho_group.rvs(6, random_state=np.random.default_rng(9000 + seed))
    right, depth = 2.5, 1.0
    scale = 1 - 1 / (2 * np.sqrt(26) - 8.2)
    wrong = -np.sqrt((right**2 - depth) / scale)

    def cost(x):
        funnel = min(((x - right) ** 2).sum(), 6 * depth + scale * ((x - wrong) ** 2).sum())
        return float(funnel + 2 * (1 - np.cos(2 * np.pi * turn @ (x - right))).sum())

    return Problem("double_funnel6", np.full(6, -5.0), np.full(6, 5.0), 0.5, cost=cost)


def rosenbrock6(seed):
    """Rosenbrock's valley, turned and shifted: one curved valley, badly conditioned."""
    rng = np.random.default_rng(9500 + seed)
    turn, shift = special_ortho_group.rvs(6, random_state=rng), rng.uniform(-1, 1, 6)

    def cost(x):
        z = turn @ (x - shift) + 1
        return float((100 * (z[1:] - z[:-1] ** 2) ** 2 + (1 - z[:-1]) ** 2).sum())

    return Problem("rosenbrock6", np.full(6, -2.0), np.full(6, 2.0), 0.1, cost=cost)


FOUR = {f.__name__: f for f in (ringdown6, hartmann6, rastrigin6, impact6)}
FURTHER = {
    f.__name__: f
    for f in (rotated6, ringdown9, failing6, receptance8, kinds6, creep5, ackley6, double_funnel6, rosenbrock6)
}
PROBLEMS = FOUR | FURTHER


def evaluations_to_target(optimiser, problem, budget):
    """Evaluations an ask/tell optimiser needs until a cost reaches the target; inf where the budget ends first."""
    spent = 0
    while spent < budget and not optimiser.stop():
        x = optimiser.ask()
        outcomes = [problem.outcome(u) for u in x]
        for i, outcome in enumerate(outcomes):
            if outcome.cost <= problem.target and spent + i < budget:
                return spent + i + 1
        spent += len(outcomes)
        optimiser.tell(x, outcomes)
    return np.inf
