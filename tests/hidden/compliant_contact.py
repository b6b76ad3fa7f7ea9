"""Records of the minimal model whose stop is a spring and a damper: python -m hidden.compliant_contact, from tests/.

Integrated by scipy's DOP853, which is stopped at each touch and each parting; only the matrices of the structure are
the simulator's.
"""

from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
from simulators.four_dof_peer import NORMAL, spring_drive

from calib.records import make, write
from calib.simulators.four_dof import FourDof

FOLDER = Path(__file__).parents[2] / "experiments_ref" / "clapping_compliant"
VALUES = {p.name: p.nominal for p in FourDof.parameters} | {"damping": 0.0045, "layer_stiffness": 1.02}
STIFFNESS, DAMPING = 6.4e5, 210.0  # of the contact  [N/m], [N s/m]; it pushes and does not pull
PLANS = {  # record: (amplitude [m], frequency [Hz]) of the drive
    "clapping": (1.50e-3, 26.24),
    "softer": (1.20e-3, 26.24),
    "louder": (1.65e-3, 26.24),
    "slower": (1.50e-3, 25.60),
}
SETTLE, PERIODS, SAMPLES = 250, 6, 400  # the last of a period
SIGMA = {"displacement": 1e-5, "velocity": 3e-3}  # of the noise  [m], [m/s]
BODIES = {"beam": 1, "layer": 2}


def motion(amplitude: float, frequency: float, times: np.ndarray) -> np.ndarray:
    """State (8, n) at increasing `times` [s], from rest at time 0."""
    mass, stiffness, damping, load = spring_drive(VALUES, amplitude)
    inverse, layer, omega = np.linalg.inv(mass), mass[2, 2], 2.0 * np.pi * frequency
    pull = np.array([load, 0.0, 0.0, 0.0])

    def depth(t, x):
        return -(VALUES["gap"] + NORMAL @ x[:4])

    def push(t, x):
        return STIFFNESS * depth(t, x) - DAMPING * (NORMAL @ x[4:])

    def apart(t, x):
        return depth(t, x)

    def free(t, x):
        return np.concatenate([x[4:], inverse @ (pull * np.cos(omega * t) - stiffness @ x[:4] - damping @ x[4:])])

    def pressed(t, x):
        rates = free(t, x)
        rates[6] += push(t, x) / layer
        return rates

    depth.terminal = push.terminal = apart.terminal = True
    depth.direction, push.direction, apart.direction = 1, -1, -1
    out, state, t, contact = np.zeros((8, times.size)), np.zeros(8), 0.0, False
    while t < times[-1]:
        run = solve_ivp(
            pressed if contact else free, (t, times[-1]), state, "DOP853", events=push if contact else depth,
            dense_output=True, rtol=1e-11, atol=1e-14, max_step=(0.002 if contact else 0.02) / frequency,
        )  # fmt: skip
        own = (times >= t) & (times <= run.t[-1])
        if own.any():
            out[:, own] = run.sol(times[own])
        t, state, contact = run.t[-1], run.y[:, -1], not contact
        if not contact and depth(t, state) > 0.0:  # it has parted before the surface is where it was
            run = solve_ivp(
                free, (t, t + 1.0 / frequency), state, "DOP853", events=apart, dense_output=True, rtol=1e-11, atol=1e-14
            )
            own = (times >= t) & (times <= run.t[-1])
            if own.any():
                out[:, own] = run.sol(times[own])
            t, state = run.t[-1], run.y[:, -1]
    return out


def record(name: str):
    """Return the record of a plan, with noise and a trigger that is told nowhere."""
    amplitude, frequency = PLANS[name]
    rng = np.random.default_rng([20, list(PLANS).index(name)])
    time = np.arange(PERIODS * SAMPLES) / (SAMPLES * frequency)
    state = motion(amplitude, frequency, (SETTLE + rng.uniform()) / frequency + time)
    index = list(BODIES.values())
    clean = {"displacement": state[index], "velocity": state[[4 + i for i in index]]}
    channels = {c: rows + SIGMA[c] * rng.standard_normal(rows.shape) for c, rows in clean.items()}
    channels |= {f"{c}_sigma": np.full(len(index), sigma) for c, sigma in SIGMA.items()}
    return make(
        time, list(BODIES), channels, place="end", quantity="displacement", amplitude=amplitude, frequency=frequency,
        source="tests/hidden/compliant_contact.py", warning="not measured: computed with a stated compliant contact",
    )  # fmt: skip


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name in PLANS:
        write(record(name), FOLDER / f"{name}.nc")
