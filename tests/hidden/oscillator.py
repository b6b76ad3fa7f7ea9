"""One mass on a spring and a damper: driven harmonically, by a multisine or let go, with a stop or without."""

from collections.abc import Iterable
from typing import Literal

import numpy as np
from hidden.flight import Plant
from hidden.system import Plan, System

TRUTH = {"mass": 1.0, "damping": 2.5, "stiffness": 3950.0, "amplitude": 0.97, "gap": 5e-3, "restitution": 0.3}
WINDOWS = {
    "damping": (0.5, 10.0, "log"),
    "stiffness": (3000.0, 5000.0, "log"),
    "amplitude": (0.8, 1.25, "log"),
    "restitution": (0.0, 0.8, "linear"),
    "gap": (4e-3, 6e-3, "linear"),
}
TONES = np.arange(1.0, 16.5, 0.5)  # Hz, of the multisine
TURNS = 2.0 * np.pi * np.random.default_rng(31).uniform(size=TONES.size)
TIME = np.arange(1500) * 1e-3  # s
EFFECTS = (
    "linear_drag", "quadratic_drag", "coulomb_friction", "presliding", "cubic_stiffness", "quadratic_stiffness",
    "softening", "preload", "added_mass", "detuning_drift", "extra_mode", "drive_harmonic_2", "drive_harmonic_3",
    "backlash", "channel_gain", "channel_offset", "channel_drift", "channel_lag",
    "velocity_lowpass", "velocity_differencing", "plot_shear", "plot_scale", "axis_tilt", "clipping", "quantisation",
    "outliers",
)  # fmt: skip
UNDRAWN = (
    "bouc_wen", "stribeck", "power_law_damping", "magnetic_attraction", "damping_drift", "channel_nonlinearity",
)  # fmt: skip
DRIVEN = ("drive_modulation",)  # of a drive that begins
AT_STOP = ("gap_offset", "adhesion", "rate_restitution", "squeeze_film")


def plant(values, plan: Plan) -> Plant:
    """Equation of motion, over the mass; the stop, where there is one, stands at x = gap."""
    mass = values["mass"]
    size = values["amplitude"] * plan.amplitude
    if plan.kind == "harmonic":
        tones = np.array([[size, 2.0 * np.pi * plan.frequency, 0.0]])
    elif plan.kind == "multisine":
        tones = np.column_stack([np.full(TONES.size, size), 2.0 * np.pi * TONES, TURNS])
    else:
        tones = np.zeros((1, 3))
    gap = values.get("gap", np.inf)
    return Plant(
        stiffness=np.array([[values["stiffness"] / mass]]),
        damping=np.array([[values["damping"] / mass]]),
        load=np.array([1.0 / mass]),
        tones=tones,
        harmonic=int(plan.kind == "harmonic"),
        normal=np.array([-1.0]),
        hit=np.array([-1.0]),
        port=np.array([-1.0]),
        gap=gap,
        rest=gap,
        restitution=values.get("restitution", 0.0),
        body=np.array([1]),
        support=np.array([0]),
        length=5e-3,
        speed=0.3,
    )


def system(
    calibrated: Iterable[str] | None = None,
    transient: Literal["multisine", "decay"] = "multisine",
    stop: bool = False,
    tones: Iterable[Plan] = (),
) -> System:
    """Return the oscillator; `calibrated` are the parameters that the study searches.

    transient : the record that does not repeat, beside two harmonic ones
    tones : harmonic records in the place of all these
    """
    if calibrated is None:
        calibrated = ("damping", "stiffness", "amplitude", *(("restitution",) if stop else ()))
    truth = {name: value for name, value in TRUTH.items() if stop or name not in ("gap", "restitution")}
    size = 0.5 if stop else 1.0  # N, of a tone: two impacts with the stop
    last = {"multisine": Plan("multisine", "name", "multisine", size), "decay": Plan("decay", "name", "decay", 4.5e-3)}
    last = last[transient]
    soft, loud = (10.3, 11.0) if stop else (9.7, 10.3)  # Hz; with the stop, one impact a period
    return System(
        name="oscillator",
        options={"stop": True} if stop else {},
        truth=truth,
        windows={name: WINDOWS[name] for name in calibrated},
        fixed={name: truth[name] for name in truth if name not in calibrated}
        | ({"initial_displacement@decay": last.amplitude} if transient == "decay" else {}),
        plans=tuple(tones)
        or (
            Plan("soft", "calibrate", "harmonic", 2.0, soft),
            Plan("loud", "calibrate", "harmonic", 4.0, loud),
            last,
            Plan("louder", "holdout", "harmonic", 6.0, loud),
        ),
        plant=plant,
        measured={"mass": 0},
        place="mass",
        quantity="force",
        feature="time_history",
        structure={"added_mass": "mass"},
        effects=EFFECTS + (AT_STOP if stop else ()) + (DRIVEN if transient == "multisine" else ()),
        undrawn=UNDRAWN,
        length=5e-3,
        omega=2.0 * np.pi * 10.0,
        periods=8,
        samples=150,
        time=TIME,
    )
