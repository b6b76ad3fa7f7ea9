"""Records of a cantilever that knocks against a stop, from another code than CalculiX: records/*.nc.

Euler-Bernoulli elements with cubic shape functions, reduced to modes, and an explicit integrator of order 8 that
controls its error; the stop's stiffness sets in smoothly. The motion is stationary.
"""

from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import eigh

from calib import Record
from calib.records import write

LENGTH, WIDTH, HEIGHT = 0.3, 0.02, 0.003  # m
DENSITY, TIP_MASS = 7850.0, 0.1  # kg/m^3, kg
YOUNGS, DAMPING = 205e9, 40.0  # Pa, 1/s: damping force per unit mass and velocity
GAP, STIFFNESS, ONSET = 1e-3, 1e4, 2e-5  # m, N/m, m: penetration over which the stiffness of the stop sets in
ELEMENTS, MODES = 20, 6
TOLERANCE = 1e-9  # of the integrator, relative; of displacements, in m
RECORDED, DROPPED, SAMPLES = 2, 12, 50  # periods recorded, periods before them, samples a period
SIGMA = {"displacement": 1e-5, "velocity": 4e-3}  # m, m/s
TESTS = {"knock": (12.0, 4.0), "quick": (15.0, 4.0), "loud": (12.0, 5.0)}  # Hz, N
LAG = 1.5e-3  # s, of the velocity channel in late_*.nc
SEED = 1


def matrices() -> tuple[np.ndarray, np.ndarray]:
    """Stiffness [N/m, N, N m] and mass [kg, kg m, kg m^2] of the free nodes' deflections and rotations."""
    length, mass = LENGTH / ELEMENTS, DENSITY * WIDTH * HEIGHT * LENGTH / ELEMENTS
    scale = np.array([1.0, length, 1.0, length])
    bending = YOUNGS * WIDTH * HEIGHT**3 / 12.0 / length**3
    own_k = bending * np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]])
    own_m = mass / 420.0 * np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]])
    stiffness, inertia = np.zeros((2, 2 * ELEMENTS + 2, 2 * ELEMENTS + 2))
    for element in range(ELEMENTS):
        own = slice(2 * element, 2 * element + 4)
        stiffness[own, own] += own_k * np.outer(scale, scale)
        inertia[own, own] += own_m * np.outer(scale, scale)
    inertia[-2, -2] += TIP_MASS
    return stiffness[2:, 2:], inertia[2:, 2:]  # clamped at the first node


def stop_force(penetration: float) -> float:
    """Force of the stop on the tip [N] at a penetration [m]: its stiffness rises from zero over `ONSET`."""
    p = max(penetration, 0.0)
    return STIFFNESS * (p**2 / (2.0 * ONSET) if p < ONSET else p - 0.5 * ONSET)


def tip_motion(frequency: float, amplitude: float, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Deflection [m] and velocity [m/s] of the tip, (n,) each, of a beam that was at rest at time 0.

    The stop's force has a continuous derivative, so that the integrator controls its error without looking for events.

    Parameters
    ----------
    frequency, amplitude : of the force at the middle, amplitude sin(2 pi frequency t)  [Hz], [N]
    times : (n,) ascending  [s]
    """
    squares, modes = eigh(*matrices(), subset_by_index=[0, MODES - 1])
    tip, middle = modes[-2], modes[ELEMENTS - 2]

    def rate(time: float, state: np.ndarray) -> np.ndarray:
        q, v = np.split(state, 2)
        force = amplitude * np.sin(2.0 * np.pi * frequency * time)
        return np.concatenate([v, middle * force + tip * stop_force(-tip @ q - GAP) - squares * q - DAMPING * v])

    span, rest = (0.0, times[-1]), np.zeros(2 * MODES)
    solved = solve_ivp(rate, span, rest, "DOP853", times, rtol=TOLERANCE, atol=TOLERANCE)
    return tip @ solved.y[:MODES], tip @ solved.y[MODES:]


def records(name: str, rng: np.random.Generator) -> tuple[Record, Record]:
    """Return the record of one test, with noise, and that with a velocity channel that comes late."""
    frequency, amplitude = TESTS[name]
    time = np.arange(RECORDED * SAMPLES) / (SAMPLES * frequency)
    instants = np.unique([time, time - LAG]) + DROPPED / frequency
    displacement, velocity = tip_motion(frequency, amplitude, instants)
    tone = {"place": "middle", "quantity": "force", "frequency": frequency, "amplitude": amplitude, "phase": "-90 deg"}

    def seen(lag: float) -> Record:
        own = {
            "displacement": np.interp(time + DROPPED / frequency, instants, displacement),
            "velocity": np.interp(time + DROPPED / frequency - lag, instants, velocity),
        }
        noisy = [{"tip": own[channel] + rng.normal(0.0, sigma, time.size)} for channel, sigma in SIGMA.items()]
        return Record.from_arrays(time, *noisy, excitation=tone, sigma=SIGMA, name=name)

    return seen(0.0), seen(LAG)


if __name__ == "__main__":
    folder, rng = Path(__file__).parent / "records", np.random.default_rng(SEED)
    for name in TESTS:
        for prefix, record in zip(("", "late_"), records(name, rng), strict=True):
            write(record.dataset, folder / f"{prefix}{name}.nc")
