"""The paper's beam, its parameter sets and ways to step it by hand."""

from typing import NamedTuple

import numpy as np

from calib.modelling.laws import BoundLaw
from calib.simulators.delaminated_beam import contact, explicit, layout
from calib.simulators.delaminated_beam.coefficients import Coefficients
from calib.simulators.delaminated_beam.explicit import ExplicitPlan, ExplicitState, ExplicitTrace
from calib.simulators.delaminated_beam.layout import Layout
from calib.simulators.delaminated_beam.mesh import Counts, Geometry, mesh
from calib.simulators.delaminated_beam.plane_stress import Material
from calib.simulators.delaminated_beam.structure import MeshedStructure, assemble

ALUMINIUM = Material(young=70e9, poisson=0.3, density=2700.0)
WIDTH, LAYER = 0.04, 2.5e-3  # m
PAPER = Geometry(length=1.386, delamination=0.56, beam_thickness=7.5e-3, layer_thickness=LAYER, arch=0.0, support=0.373)
FREQUENCY, AMPLITUDE = 26.51, 0.92e-3  # Hz, m
PERIOD = 1.0 / FREQUENCY
WIDE = 1.0  # m; a gap that never closes

# alpha [1/s], beta [1], f [1], C_con [1], step [s], g_max [m], s [m]
FIGURE_12 = (500.0, 0.02, 0.01, 5.0, 3.1e-7, 1e-3, 0.0)
FIGURE_14 = (500.0, 0.02, 0.01, 5.0, 9.38e-8, 0.2e-3, 0.8e-3)


class Beam(NamedTuple):
    """A meshed beam with its kernel arrays and critical step [s]."""

    structure: MeshedStructure
    layout: Layout
    critical: float

    @property
    def nodes(self) -> np.ndarray:
        """Where the nodes stand (n, 2)  [m]."""
        return self.structure.mesh.nodes

    def plan(
        self,
        step: float,
        *,
        alpha: float = 0.0,
        beta: float = 0.0,
        factor: float = 0.01,
        c_con: float = 0.0,
        clearance: float | np.ndarray = WIDE,
        lagged: bool = False,
        clipped: bool = True,
        laws: tuple[BoundLaw, ...] = (),
    ) -> ExplicitPlan:
        """Plan of a run; beta is a fraction of the critical damping of the highest mode."""
        pairs = self.structure.pairs
        stiffness = contact.penalty(pairs, "bulk", factor, ALUMINIUM, WIDTH, LAYER, step)
        coefficients = Coefficients(
            alpha=alpha,
            beta=beta * self.critical,
            clearance=clearance + np.zeros_like(pairs.weight),
            stiffness=stiffness,
            damping=c_con * contact.critical_damping(pairs, stiffness),
            impact_separation=0.01 * PERIOD,
            lagged=lagged,
            clipped=clipped,
            laws=laws,
        )
        limit = 100.0 * AMPLITUDE * 2.0 * np.pi * FREQUENCY
        return layout.plan(self.structure, self.layout, coefficients, step=step, limit=limit)

    def figure(self, alpha, beta, factor, c_con, step, height, shift) -> tuple[ExplicitPlan, ExplicitState, int]:
        """Plan of a set of the paper, its start on the static shape, and the steps to a period."""
        steps = int(np.ceil(PERIOD / step))
        gap = contact.clearance(self.structure.pairs, height, shift)
        plan = self.plan(PERIOD / steps, alpha=alpha, beta=beta, factor=factor, c_con=c_con, clearance=gap)
        shape = self.structure.static_shape()
        return plan, self.begin(plan, AMPLITUDE * shape), steps

    def begin(self, plan: ExplicitPlan, displacement: np.ndarray, velocity: np.ndarray | float = 0.0) -> ExplicitState:
        """State with displacements (n, 2) [m] and velocities half a step before them [m/s]."""
        return layout.begin(plan, self.layout, displacement, velocity + np.zeros_like(displacement))

    def displacement(self, plan: ExplicitPlan, state: ExplicitState) -> np.ndarray:
        """Displacements (n, 2) of a state  [m]."""
        return self.layout.gather(state.w - plan.beta * state.v)

    def velocity(self, state: ExplicitState) -> np.ndarray:
        """Velocities (n, 2) of a state, half a step back  [m/s]."""
        return self.layout.gather(state.v)


def beam(
    geometry: Geometry = PAPER, counts: Counts | None = None, symmetric: bool = True, bilinear: bool = False
) -> Beam:
    """Mesh a beam and work out its matrices."""
    meshed = mesh(geometry, counts or Counts(), symmetric)
    structure = assemble(meshed, ALUMINIUM, WIDTH, bilinear)
    return Beam(structure, Layout(meshed), structure.critical_step())


def cosine(steps: int, periods: float = 1.0, amplitude: float = AMPLITUDE) -> np.ndarray:
    """Where the driven node stands at the ends of the steps of some periods  [m]."""
    return amplitude * np.cos(2.0 * np.pi * np.arange(1, round(periods * steps) + 1) / steps)


def seen(plan: ExplicitPlan, at=(), impacts: int = 64) -> ExplicitTrace:
    """Empty notes, with samples before each of the steps `at`."""
    at = np.asarray(at, dtype=np.int64)
    return ExplicitTrace(
        at=at,
        shift=np.zeros(len(at)),
        samples=np.zeros((len(at), 5)),
        impacts=np.zeros((impacts, 2)),
        central=np.zeros((impacts, 2)),
        closed=np.zeros(len(plan.slave), dtype=np.int64),
        total=np.zeros(5),
        nearest=np.zeros(0),
        passes=np.array([np.inf, np.inf, 0.0]),
    )


def advance(plan: ExplicitPlan, state: ExplicitState, drive: np.ndarray, at=()) -> tuple[int, ExplicitTrace]:
    """Go on by len(drive) steps; return the kernel's code and its notes."""
    notes = seen(plan, at)
    return explicit.advance(plan, state, 0.0, drive, notes), notes
