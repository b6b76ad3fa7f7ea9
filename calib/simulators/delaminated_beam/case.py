"""One beam with its numbers, ready to be run by either kernel."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from calib.errors import CalibError
from calib.simulators.delaminated_beam import layout, reduction
from calib.simulators.delaminated_beam.coefficients import Coefficients
from calib.simulators.delaminated_beam.drive import BeamDrive
from calib.simulators.delaminated_beam.explicit.engine import FullEngine
from calib.simulators.delaminated_beam.layout import Layout
from calib.simulators.delaminated_beam.mesh import Counts, Geometry, mesh
from calib.simulators.delaminated_beam.modes import Modes, modes
from calib.simulators.delaminated_beam.plane_stress import Material
from calib.simulators.delaminated_beam.reduced.engine import ReducedEngine
from calib.simulators.delaminated_beam.reduction import Fineness
from calib.simulators.delaminated_beam.structure import MeshedStructure, assemble

MAX_VELOCITY_RATIO = 100.0  # of a velocity over the drive's, beyond which the full kernel's step is unstable  [1]
MAX_DISPLACEMENT_RATIO = 100.0  # of a displacement over the drive's, beyond which the reduced motion diverges  [1]


@dataclass(frozen=True, eq=False)
class BeamCase:
    """One beam with its numbers, ready to be run by either kernel.

    Attributes
    ----------
    structure : mesh and matrices
    coefficients : damping and contact
    critical, stable : longest stable step without and with beta  [s]
    step, count : [s], and steps a period
    drive : of the middle
    """

    structure: MeshedStructure
    coefficients: Coefficients
    critical: float
    stable: float
    step: float
    count: int
    drive: BeamDrive

    @property
    def force_factor(self) -> float:
        """Ratio of forces of the whole beam over those of the model  [1]."""
        return 2.0 if self.structure.mesh.symmetric else 1.0

    def why_unstable(self) -> str:
        """Message that states the limit of the step."""
        return (
            f"a step of {self.step:.4g} s is above the stable one of {self.stable:.4g} s "
            f"(critical step {self.critical:.4g} s, beta {self.coefficients.beta / self.critical:.3g} of critical); "
            "lower dt, f_dt or beta"
        )

    def steps(self) -> dict[str, float]:
        """Attributes of a record that concern the step."""
        return {"step": self.step, "critical_step": self.critical, "stable_step": self.stable}

    def contact_places(self, closed: np.ndarray) -> np.ndarray:
        """Places (k,) along the delamination of the contact pairs whose shares `closed` (k,) are given  [1]."""
        place = self.structure.pairs.place
        return place[:: max(1, round((len(place) - 1) / max(1, len(closed) - 1)))]

    def full(self, state: np.ndarray | None, budget: int) -> FullEngine:
        """Return the full kernel, at rest on the static shape unless a state is given."""
        built, drive = self.structure, self.drive
        places = Layout(built.mesh)
        limit = MAX_VELOCITY_RATIO * drive.speed
        plan = layout.plan(built, places, self.coefficients, step=self.step, limit=limit)
        free, shape = built.free, built.static_shape().ravel()
        x, v = drive.at_start()
        still = x * shape, v * shape
        displacement, velocity = still[0].copy(), still[1].copy()
        if state is not None:
            if np.size(state) != 2 * len(free):
                raise CalibError(f"the state of the full beam has {2 * len(free)} numbers, got {np.size(state)}")
            more = np.split(np.asarray(state, dtype=float), 2)
            displacement[free] += more[0]
            velocity[free] += more[1]
        start = layout.begin(plan, places, displacement.reshape(-1, 2), velocity.reshape(-1, 2))
        return FullEngine(
            plan, start, places.gather, free, still, drive.period, self.count, drive.displacements, budget
        )

    def reduced(self, fineness: Fineness, state: np.ndarray | None, budget: int) -> ReducedEngine:
        """Return the reduced kernel, at rest on the static shape unless a state is given."""
        built, drive = self.structure, self.drive
        if fineness.modes >= len(built.free):
            raise CalibError(
                f"{fineness.modes} modes of a mesh with {len(built.free)} freedoms; take fewer modes or a finer mesh"
            )
        basis = modes_of(built, fineness.modes)
        limit = MAX_DISPLACEMENT_RATIO * drive.length
        plan = reduction.plan(built, basis, fineness, self.coefficients, period=drive.period, limit=limit)
        if state is None:
            state = np.zeros(2 * fineness.modes)
        size, parts = 2 * fineness.modes, fineness.steps * fineness.parts
        if np.size(state) != size:
            raise CalibError(f"the state of {fineness.modes} modes has {size} numbers, got {np.size(state)}")
        return ReducedEngine(plan, drive.period, lambda period: drive.table(period, parts), state, budget)


@lru_cache(maxsize=8)
def structure_of(shape: tuple[tuple[str, float], ...], arch: float, counts: Counts, symmetric: bool) -> MeshedStructure:
    """Mesh of a beam with its matrices."""
    v = dict(shape)
    if not v["poisson_ratio"] < 0.5:
        raise ValueError("a Poisson's ratio of 0.5 has no bulk modulus; take less")
    for name in ("young_modulus", "density", "width", "beam_thickness", "layer_thickness"):
        if not v[name] > 0.0:
            raise ValueError(f"{name} is {v[name]:g}; give it a positive value")
    geometry = Geometry(v["length"], v["delamination"], v["beam_thickness"], v["layer_thickness"], arch, v["support"])
    material = Material(v["young_modulus"], v["poisson_ratio"], v["density"])
    return assemble(mesh(geometry, counts, symmetric), material, v["width"])


@lru_cache(maxsize=8)
def critical_step_of(built: MeshedStructure) -> float:
    """Longest stable step without damping [s]; cached, as the structure is."""
    return built.critical_step()


@lru_cache(maxsize=16)
def modes_of(built: MeshedStructure, count: int) -> Modes:
    """Modes of a structure; cached, since most evaluations of a search share them."""
    return modes(built, count)
