"""Terms beside cubic stiffness, alone and together: fitted to decays 1 and 3, and tried on decay 2.

    python studies/sloshing/further_terms.py

No part of the diagnosis. Values come from decays 1 and 3 alone; which terms study.higher_order.toml has was chosen by
what they predict of decay 2.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from calib.modelling.model import Model
from calib.objective import Objective, Reference
from calib.objective.initial_state import initial_state
from calib.plugins import load as registered
from calib.study_file import StudyFile, load

HERE = Path(__file__).parent
TRAINED, TRIED = ("decay1", "decay3"), "decay2"
DELAYS = 5  # samples of a state in the observable space of SSMLearn's reduced model; a simulation starts from the first
FITTED = {  # start and typical step of each parameter, SI
    "stiffness": (61.2, 0.3), "damping": (0.131, 0.005), "k3": (-3900.0, 1000.0), "c2": (0.03, 0.05),
    "friction": (3e-4, 1e-3), "dahl_force": (1.5e-3, 1e-3), "kx": (-40.0, 40.0), "k2": (0.0, 10.0), "k5": (1e4, 2e5),
    "cx": (10.0, 30.0), "kv": (-50.0, 100.0),
}  # fmt: skip
HELD = {"mass": 1.0, "friction_slip": 0.005, "dahl_distance": 0.0145}  # kg, m/s, m
FIFTH_POWER, DAMPING, INERTIA = (f"higher_order:{name}" for name in ("FIFTH_POWER", "AMPLITUDE_DAMPING", "INERTIA"))
BESIDE: tuple[tuple[str, ...], ...] = (
    (), ("quadratic_drag",), ("coulomb_friction",), ("presliding",), ("softening",), ("quadratic_stiffness",),
    (FIFTH_POWER,), (DAMPING,), (INERTIA,), ("softening", DAMPING), ("softening", FIFTH_POWER), ("softening", INERTIA),
    ("softening", INERTIA, DAMPING), (FIFTH_POWER, DAMPING), (INERTIA, DAMPING), (INERTIA, FIFTH_POWER),
    (INERTIA, DAMPING, FIFTH_POWER),
)  # fmt: skip


@dataclass(frozen=True)
class Fitted:
    """A model fitted to decays: `values` in SI, `error` over the root mean square of the signal  [1]."""

    model: Model
    values: dict[str, float]
    error: float


def started(study: StudyFile, reference: Reference, model: Model, values: dict, samples: int) -> np.ndarray:
    """Displacement (time,) [m] of a model whose initial state is solved for on the first `samples` of a record."""
    head = reference.record.isel(time=slice(samples))
    beginning = replace(reference, record=head, request=replace(reference.request, times=head.time.values))
    objective = study.study.objective.on({reference.name: beginning})
    state = initial_state(objective.released(reference.name, model, values).record)
    return model.run({**values, **state}, reference.excitation, reference.request).displacement.values[0]


def mean_trajectory_error(simulated: np.ndarray, measured: np.ndarray, delays: int = 1) -> float:
    """Mean distance of two trajectories (time,) over the largest norm of the measured one  [1].

    A state is a vector of `delays` successive samples (NMTE: Cenedese et al., Nature Communications 13 (2022) 872).
    """
    states = [np.lib.stride_tricks.sliding_window_view(x, delays) for x in (simulated - measured, measured)]
    error, size = (np.linalg.norm(rows, axis=1) for rows in states)
    return float(error.mean() / size.max())


def predicted(study: StudyFile, model: Model, values: dict, samples: int = DELAYS) -> tuple[float, float]:
    """Mean trajectory errors on decay 2, started from its first samples: in the observable space, of single samples."""
    reference = study.reference(TRIED)
    measured = reference.record.displacement.values[0]
    simulated = started(study, reference, model, values, samples)
    return mean_trajectory_error(simulated, measured, DELAYS), mean_trajectory_error(simulated, measured)


def fitted(study: StudyFile, names: Sequence[str]) -> Fitted:
    """Least squares of the effects `names`, stiffness and damping on decays 1 and 3."""
    effects = [replace(registered("calib.effects", name, HERE), bodies=("mass",)) for name in names]
    model = Model(study.study.model.simulator, effects)
    own = [p.name for effect in effects for p in effect.parameters]
    held = {name: value for name, value in HELD.items() if name in own or name == "mass"}
    free = ["stiffness", "damping", *(name for name in own if name not in held)]
    references = {name: study.reference(name) for name in TRAINED}
    objective = study.study.objective.on(references)
    start, step = np.transpose([FITTED[name] for name in free])

    def residual(x: np.ndarray) -> np.ndarray:
        return _residual(objective, references, model, {**held, **dict(zip(free, x, strict=True))})

    found = least_squares(residual, start, x_scale=step, diff_step=1e-4, max_nfev=12)
    size = np.linalg.norm([np.linalg.norm(r.record.displacement.values) for r in references.values()])
    values = {**held, **{name: float(value) for name, value in zip(free, found.x, strict=True)}}
    return Fitted(model, values, float(np.linalg.norm(found.fun) / size))


def _residual(objective: Objective, references: dict[str, Reference], model: Model, values: dict) -> np.ndarray:
    """Measured less simulated displacement (n,) [m], the initial state of each decay at its best."""
    apart = []
    for name, reference in references.items():
        simulated = objective.released(name, model, values).record.displacement.values[0]
        apart.append(reference.record.displacement.values[0] - simulated)
    return np.concatenate(apart)


def main() -> None:
    """Print the table of the README."""
    study = load(HERE / "study.toml")
    print("beside cubic stiffness | error, decays 1 and 3 | NMTE | of single samples | that, start from all of decay 2")
    for names in BESIDE:
        fit = fitted(study, ("cubic_stiffness", *names))
        observable, single = predicted(study, fit.model, fit.values)
        _, settled = predicted(study, fit.model, fit.values, study.reference(TRIED).record.sizes["time"])
        label = ", ".join(effect.name for effect in fit.model.effects[1:]) or "nothing"
        print(f"{label} | {fit.error:.4f} | {observable:.4f} | {single:.4f} | {settled:.4f}", flush=True)


if __name__ == "__main__":
    main()
