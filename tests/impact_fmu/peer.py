"""The motion of the FMU of `impact_oscillator.c`, by another integrator."""

import numpy as np
from scipy.integrate import solve_ivp

from calib.records.excitation import Excitation

DRIVE = Excitation("base", "base motion", frequency=9.0, amplitude=5e-4, phase=0.3)
VALUES = {"stiffness": 4000.0, "mass": 1.0, "damping": 20.0, "gap": 4e-4, "stop_stiffness": 4e4}


def rates(t, y, values, base):
    u, du = base(t)
    force = -values["stiffness"] * (y[0] - u) - values["damping"] * (y[1] - du)
    return y[1], (force - values["stop_stiffness"] * max(0.0, y[0] - values["gap"])) / values["mass"]


def moved(t):
    omega = 2.0 * np.pi * DRIVE.frequency
    return DRIVE.amplitude * np.cos(omega * t + 0.3), -omega * DRIVE.amplitude * np.sin(omega * t + 0.3)


def peer(times, start=(0.0, 0.0), base=moved, values=VALUES):
    """Motion (2, n) from time 0 on by another integrator, whose steps are so short that it misses no contact."""
    run = solve_ivp(rates, (0.0, times[-1]), start, "DOP853", times, args=(values, base), rtol=1e-10, atol=1e-13,
                    max_step=1e-3)  # fmt: skip
    return run.y
