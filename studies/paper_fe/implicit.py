"""How much faster the explicit kernel is than an implicit one, over a period of the motion of Fig. 14.

    python studies/paper_fe/implicit.py

The implicit method is Newmark's with average acceleration: the same mesh, internal forces, damping and contact law. A
step is solved by Newton's method with the linear stiffness, factorised once per step size, and with that of the
pairs that push. Both begin at the same state of the stationary motion; the explicit phase curve is the reference.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import splu

from calib.dynamics.setting import Setting
from calib.modelling.model import Model
from calib.modelling.orbit import PeriodMap
from calib.simulators.delaminated_beam import DelaminatedBeam, layout
from calib.simulators.delaminated_beam.explicit import ExplicitPlan
from calib.simulators.delaminated_beam.explicit.engine import FullEngine
from calib.simulators.delaminated_beam.layout import Layout
from calib.simulators.delaminated_beam.mesh import Geometry, mesh
from calib.simulators.delaminated_beam.period_map import BeamMap
from calib.simulators.delaminated_beam.plane_stress import Material
from calib.simulators.delaminated_beam.structure import MeshedStructure, assemble
from calib.study_file import load

HERE = Path(__file__).parent
BEAM = DelaminatedBeam(fidelity="full")
BUDGET = 10**9  # steps
SETTLE = 6  # periods: at alpha 500 1/s the state returns within 1e-7 after five
STEPS = (9.38e-8, 3.10e-7)  # s, explicit; the first is that of Fig. 14 and of the reference
COUNTS = (200, 400, 800, 1600, 3200, 6400, 12800, 25600)  # implicit steps a period
WITHIN = (0.05, 0.01)  # distances of phase curves that count as agreement
SOLVED = 1e-6  # largest residual force of a step, as a share of the largest internal force
MOST = 40  # iterations a step


@dataclass(frozen=True, eq=False)
class Run:
    """One period of a motion.

    Attributes
    ----------
    curve : (n, 2) displacement [m] and velocity [m/s] of the layer's middle
    seconds : of CPU
    steps, evaluations : of all elements' forces, unsolved : steps that took MOST iterations
    """

    curve: np.ndarray
    seconds: float
    steps: int
    evaluations: int
    unsolved: int = 0


def setting(step: float) -> Setting:
    """The set of Fig. 14 in full fidelity, with a step [s]."""
    held = load(HERE / "fig14.toml").setting({"dt": step})
    return Setting(Model(BEAM), held.excitation, held.values)


def structure(held: Setting) -> MeshedStructure:
    """Return the half beam that the simulator makes of these values."""
    v = {**held.model.nominal, **held.values}
    shape = Geometry(v["length"], v["delamination"], v["beam_thickness"], v["layer_thickness"], 0.0, v["support"])
    material = Material(v["young_modulus"], v["poisson_ratio"], v["density"])
    return assemble(mesh(shape, BEAM.counts, True), material, v["width"])


def kernel(map: PeriodMap, state: np.ndarray) -> FullEngine:
    """Return the explicit kernel of a map, at a state."""
    engine = map.engine(state, BUDGET) if isinstance(map, BeamMap) else None
    if not isinstance(engine, FullEngine):
        raise TypeError(f"expected the map of a beam in full fidelity, got {type(map).__name__}")
    return engine


def explicit(step: float, state: np.ndarray) -> Run:
    """Go on by one period from a state, with the explicit kernel."""
    engine = kernel(setting(step).map(), state)
    began = time.process_time()
    period = engine.period(COUNTS[-1])
    seconds = time.process_time() - began
    steps = int(engine.now.counters[0])
    return Run(period.samples[:, [1, 3]], seconds, steps, steps)


class Newmark:
    """The half beam, ready to be stepped implicitly.

    Parameters
    ----------
    built, plan : of the explicit kernel, whose forces, damping and contact are taken
    period : of the drive  [s]
    amplitude : of its cosine  [m]
    count : steps a period
    """

    def __init__(self, built: MeshedStructure, plan: ExplicitPlan, period: float, amplitude: float, count: int):
        pairs = built.pairs
        self.plan, self.places, self.layer = plan, Layout(built.mesh), 2 * int(pairs.slave[plan.centre]) + 1
        self.free, self.driven, self.step, self.count = built.free, built.driven, period / count, count
        self.omega, self.amplitude = 2.0 * np.pi / period, amplitude
        self.mass = np.repeat(built.mass, 2)
        opening = np.zeros((len(pairs.slave), len(self.mass)))
        rows = np.arange(len(opening))
        for nodes, part in ((pairs.slave, 1.0), (pairs.master, pairs.weight - 1.0), (pairs.following, -pairs.weight)):
            opening[rows, 2 * nodes + 1] += part
        opening[pairs.share == 0.0] = 0.0
        self.opening = csr_array(opening)
        h, inner = self.step, built.stiffness[self.free][:, self.free]
        inertia = (4.0 / h**2 + 2.0 * plan.alpha / h) * self.mass[self.free]
        self.solve = splu((diags_array(inertia) + (1.0 + 2.0 * plan.beta / h) * inner).tocsc()).solve
        inside = np.ascontiguousarray(opening[:, self.free].T)
        self.yields = self.solve(inside)  # (free, m) to unit forces of the pairs
        self.between = inside.T @ self.yields
        self.evaluations = self.unsolved = 0

    def forces(self, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Internal less contact forces (n,) [N], and the numbers of the pairs that push."""
        self.evaluations += 1
        plan = self.plan
        forces = layout.internal_force(plan, self.places, (u + plan.beta * v).reshape(-1, 2)).ravel()
        gap = plan.clearance + self.opening @ u
        push = -plan.stiffness * gap - plan.damping * (self.opening @ v)
        pushing = np.flatnonzero((gap < 0.0) & (push > 0.0))
        if len(pushing):
            forces = forces - self.opening.T @ np.where((gap < 0.0) & (push > 0.0), push, 0.0)
        return forces, pushing

    def correction(self, residual: np.ndarray, pushing: np.ndarray) -> np.ndarray:
        """Displacements (free,) that take a residual (free,) [N] away to first order, with so many pairs pushing."""
        change = self.solve(residual)
        if len(pushing):
            stiff = self.plan.stiffness[pushing] + 2.0 * self.plan.damping[pushing] / self.step
            seen = self.opening[pushing][:, self.free] @ change
            small = np.diag(1.0 / stiff) + self.between[np.ix_(pushing, pushing)]
            change = change - self.yields[:, pushing] @ np.linalg.solve(small, seen)
        return change

    def stepped(
        self, u: np.ndarray, v: np.ndarray, a: np.ndarray, time: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Displacements, velocities and accelerations (n,) a step on, at `time` [s]."""
        h, free, alpha = self.step, self.free, self.plan.alpha
        base = u + h * v + 0.25 * h**2 * a  # u+ = base + h^2/4 a+
        later, rate, after = base + 0.25 * h**2 * a, v.copy(), a.copy()
        later[self.driven] = self.amplitude * np.cos(self.omega * time)
        rate[self.driven] = -self.omega * self.amplitude * np.sin(self.omega * time)
        for _ in range(MOST):
            after[free] = 4.0 / h**2 * (later - base)[free]
            rate[free] = v[free] + 0.5 * h * (a + after)[free]
            forces, pushing = self.forces(later, rate)
            residual = (-self.mass * (after + alpha * rate) - forces)[free]
            if np.abs(residual).max() < SOLVED * np.abs(forces).max():
                return later, rate, after
            later[free] += self.correction(residual, pushing)
        self.unsolved += 1
        return later, rate, after

    def period(self, u: np.ndarray, v: np.ndarray) -> Run:
        """Go on by one period from displacements [m] and velocities [m/s] (n,)."""
        began = time.process_time()
        forces, _ = self.forces(u, v)
        a = np.zeros_like(u)
        a[self.free] = (-forces / self.mass - self.plan.alpha * v)[self.free]
        curve = np.zeros((self.count, 2))
        for n in range(self.count):
            curve[n] = u[self.layer], v[self.layer]
            u, v, a = self.stepped(u, v, a, (n + 1) * self.step)
        return Run(curve, time.process_time() - began, self.count, self.evaluations, self.unsolved)


def distance(one: Run, reference: Run) -> float:
    """Distance of phase curves as the feature phase_curve has it: rms, each channel over the reference's  [1]."""
    wanted = reference.curve[:: len(reference.curve) // len(one.curve)]
    return float(np.sqrt((((one.curve - wanted) / reference.curve.std(axis=0)) ** 2).mean()))


def compared(steps: Sequence[float], counts: Sequence[int]) -> dict[float | int, Run]:
    """One period from the same state: explicit with `steps` [s], then implicit with so many steps a period."""
    held = setting(steps[0])
    map, built = held.map(), structure(held)
    state = map.orbit(map.initial, SETTLE).states[-1]
    amplitude = held.excitation.as_harmonic.amplitude
    displacement = amplitude * built.static_shape().ravel()
    displacement[built.free] += state[: len(built.free)]
    velocity = np.zeros_like(displacement)
    velocity[built.free] += state[len(built.free) :]
    runs = {step: explicit(step, state) for step in steps}
    for count in counts:
        newmark = Newmark(built, kernel(map, state).plan, map.period, amplitude, count)
        runs[count] = newmark.period(displacement, velocity)
    return runs


def main() -> None:
    """Print steps, seconds and distances of both, and the ratios."""
    runs = compared(STEPS, COUNTS)
    reference = runs[STEPS[0]]
    print("| method | steps a period | evaluations of all elements | s of CPU | distance |\n" + "|---" * 5 + "|")
    for key, run in runs.items():
        print(_row(f"explicit, {key:.3g} s" if key in STEPS else f"implicit, T/{key}", run, reference))
    for within in WITHIN:
        enough = [n for n in COUNTS if distance(runs[n], reference) < within]
        if not enough:
            print(f"no implicit step of these comes within {100 * within:g} %")
            continue
        run = runs[enough[0]]
        for step in STEPS:
            other = runs[step]
            print(
                f"within {100 * within:g} % (T/{enough[0]}) against explicit at {step:.3g} s: "
                f"CPU {run.seconds / other.seconds:.2f}, steps {run.steps / other.steps:.4f}, "
                f"evaluations {run.evaluations / other.evaluations:.4f} of the explicit ones"
            )


def _row(name: str, run: Run, reference: Run) -> str:
    unsolved = f", {run.unsolved} not solved" if run.unsolved else ""
    off = f"{100 * distance(run, reference):.2f} %"
    return f"| {name} | {run.steps}{unsolved} | {run.evaluations} | {run.seconds:.2f} | {off} |"


if __name__ == "__main__":
    main()
