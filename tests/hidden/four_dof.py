"""The minimal model with the shaker's spring, in the motion that repeats every period."""

from collections.abc import Iterable

import numpy as np
from hidden.flight import Plant
from hidden.system import Plan, System
from simulators.four_dof_peer import NORMAL, spring_drive

from calib.simulators.four_dof import FourDof

NOMINAL = {p.name: p.nominal for p in FourDof.parameters}
TRUTH = {**NOMINAL, "restitution": 0.1, "damping": 0.0045, "layer_stiffness": 1.02}
WINDOWS = {
    "restitution": (0.0, 0.3, "linear"),
    "damping": (0.002, 0.01, "log"),
    "layer_stiffness": (0.9, 1.1, "linear"),
    "layer_mass": (0.9, 1.1, "linear"),
    "gap": (0.9e-3, 1.1e-3, "linear"),
    "amplitude": (0.9, 1.1, "linear"),
}
PLANS = (
    Plan("clapping", "calibrate", "harmonic", 1.5e-3, 26.24),  # one impact a period
    Plan("louder", "calibrate", "harmonic", 2.0e-3, 26.24),  # two
    Plan("quicker", "name", "harmonic", 1.5e-3, 26.6),
    Plan("quiet", "name", "harmonic", 0.25e-3, 26.24),  # without contact
    Plan("softer", "holdout", "harmonic", 1.3e-3, 26.24),
)
EFFECTS = (
    "linear_drag", "quadratic_drag", "coulomb_friction", "presliding", "cubic_stiffness", "quadratic_stiffness",
    "softening", "preload", "support", "glue_bond", "added_mass", "extra_mode", "drive_harmonic_2", "drive_harmonic_3",
    "backlash", "gap_offset", "adhesion", "rate_restitution", "squeeze_film", "channel_gain", "channel_offset",
    "channel_drift", "channel_lag", "velocity_lowpass", "velocity_differencing", "plot_shear", "plot_scale",
    "axis_tilt", "clipping", "quantisation", "outliers",
)  # fmt: skip


def plant(values, plan: Plan) -> Plant:
    """Equations of motion, over the masses; laws on a body act on the layer."""
    mass, stiffness, damping, load = spring_drive(values, plan.amplitude)
    masses = np.diag(mass)
    spring = stiffness[0, 0] * values["drive_stiffness"] / (1.0 + values["drive_stiffness"])  # N/m
    return Plant(
        stiffness=stiffness / masses[:, None],
        damping=damping / masses[:, None],
        load=np.array([spring / masses[0], 0.0, 0.0, 0.0]),
        tones=np.array([[load / spring, 2.0 * np.pi * plan.frequency, 0.0]]),
        harmonic=1,
        normal=NORMAL,
        hit=np.array([0.0, 0.0, 1.0, 0.0]),
        port=np.array([0.0, -masses[2] / masses[1], 1.0, 0.0]),
        gap=values["gap"],
        rest=values["gap"],
        restitution=values["restitution"],
        body=np.array([0, 0, 1, 0]),
        support=np.array([1, 0, 0, 1]),
        length=1e-3,
        speed=0.165,
    )


def system(
    calibrated: Iterable[str] = ("restitution", "damping", "layer_stiffness"),
    steps: float | None = None,
    plans: tuple[Plan, ...] = PLANS,
) -> System:
    """Return the minimal model; `calibrated` are the parameters that the study searches.

    steps : a period, of a study whose model locates no impacts: its "time_step" is what is hidden
    """
    coarse = {"mode": "fixed_step", "steps_per_period": steps}
    return System(
        name="four_dof",
        options={"drive": "spring"} | (coarse if steps else {}),
        truth=TRUTH,
        windows={name: WINDOWS[name] for name in calibrated},
        fixed={name: TRUTH[name] for name in TRUTH if TRUTH[name] != NOMINAL[name] and name not in calibrated},
        plans=plans,
        plant=plant,
        measured={"q2": 1, "q3": 2},
        place="end",
        quantity="displacement",
        feature="phase_curve",
        structure={"bond": "layer_stiffness", "added_mass": "layer_mass"},
        effects=EFFECTS,
        length=1.5e-3,
        omega=2.0 * np.pi * 26.24,
        periods=6,
        samples=200,
        time=np.zeros(0),
        remainders=(*System.remainders, "coupling"),
    )
