"""From a mesh to the full kernel's arrays: lines of nodes one after the other, padded, all x before all y."""

import numpy as np

from calib.simulators.delaminated_beam.coefficients import Coefficients
from calib.simulators.delaminated_beam.explicit.elements import SHAPE_ROW, elastic
from calib.simulators.delaminated_beam.explicit.plan import (
    COEFFICIENT_ROWS,
    FORCE_ROWS,
    ROW_LENGTH,
    VECTOR_LANES,
    ExplicitPlan,
    ExplicitState,
)
from calib.simulators.delaminated_beam.mesh import Mesh
from calib.simulators.delaminated_beam.plane_stress import Elements
from calib.simulators.delaminated_beam.structure import BODIES, MeshedStructure
from calib.simulators.law_calls import acting, addresses

MAX_LINE_NODES = ROW_LENGTH - 2 * VECTOR_LANES  # nodes of a line, its padding at both ends apart
NO_CONTACT_STEP = -(10**15)  # step of the last contact where there was none


class Layout:
    """Where the nodes of a mesh stand in the kernel's arrays.

    Attributes
    ----------
    size : numbers to a component
    starts, lengths : first place and padded length of each line
    place : (n,) of each node, among the x
    """

    def __init__(self, mesh: Mesh) -> None:
        padded = [_padded(len(line)) for line in mesh.lines]
        if max(padded) > MAX_LINE_NODES:
            raise ValueError(f"a line of {max(map(len, mesh.lines))} nodes; at most {MAX_LINE_NODES} can be")
        self.starts = np.concatenate([[0], np.cumsum(np.array(padded) + VECTOR_LANES)])
        self.size = int(self.starts[-1])
        self.lengths = padded
        self.place = np.full(len(mesh.nodes), -1)
        for start, line in zip(self.starts, mesh.lines, strict=False):  # of two names that of the layer's line holds
            self.place[line] = start + np.arange(len(line))
        self._mesh = mesh

    def spread(self, values: np.ndarray) -> np.ndarray:
        """Nodal values (n, 2) in the kernel's order (2 * size,), at every name of a node."""
        out = np.zeros((2, self.size))
        for start, line in zip(self.starts, self._mesh.lines, strict=False):
            out[:, start : start + len(line)] = values[line].T
        return out.ravel()

    def gather(self, flat: np.ndarray) -> np.ndarray:
        """Nodal values (n, 2) from the kernel's order."""
        return flat.reshape(2, self.size)[:, self.place].T

    def shared(self) -> np.ndarray:
        """Stretches (k, 3) of nodes common to the layer's lowest line and to the interface: places, and how many."""
        mesh = self._mesh
        layer, beam = mesh.lines[mesh.interface + 1], mesh.lines[mesh.interface]
        right = len(layer) - mesh.last
        rows = [(mesh.last, len(beam) - right, right)]
        if not mesh.symmetric:
            rows.append((0, 0, mesh.first + 1))
        return np.array(rows)


def plan(
    structure: MeshedStructure, layout: Layout, coefficients: Coefficients, *, step: float, limit: float
) -> ExplicitPlan:
    """Return the constants of a run of the full kernel.

    Parameters
    ----------
    step : [s]
    limit : velocity beyond which the run is unstable  [m/s]

    Raises
    ------
    ValueError : a line of nodes that is too long for the kernel
    """
    mesh, material, pairs, size = structure.mesh, structure.material, structure.pairs, layout.size
    strips = [structure.elements(lower) for lower in mesh.strips]
    interface, below, above = mesh.interface, *mesh.neighbours
    force, force_p, forces = addresses(coefficients.laws, "force")
    contacts, contact_p, number = addresses(coefficients.laws, "contact")
    return ExplicitPlan(
        size=size,
        strips=np.array(
            [[*layout.starts[k : k + 2], _padded(len(e.along) + 1)] for k, e in zip(mesh.strips, strips, strict=True)]
        ),  # the last node's place too, to which common nodes add
        turned=np.array([e.turned for e in strips]),
        factors=np.concatenate([_factors(e) for e in strips]),
        across=np.array([0.5 / e.across for e in strips]),
        shear=material.shear,
        mean=0.5 * material.young / (1.0 - material.poisson),
        lines=np.array([[layout.starts[k], layout.lengths[k], below[k], above[k]] for k in range(len(mesh.lines))]),
        shared=layout.shared(),
        joint=np.array([below[interface], above[interface + 1], interface + 1]),
        inverse_mass=_inverse_mass(structure, layout),
        alpha=float(coefficients.alpha),
        beta=float(coefficients.beta),
        step=float(step),
        slave=size + layout.place[pairs.slave],
        master=size + layout.place[pairs.master],
        following=size + layout.place[pairs.following],
        weight=pairs.weight,
        clearance=np.ascontiguousarray(coefficients.clearance, dtype=float),
        stiffness=coefficients.stiffness,
        damping=coefficients.damping,
        acting=pairs.share > 0.0,
        area=np.where(pairs.share > 0.0, pairs.share, 1.0) * pairs.length * structure.width,
        place=pairs.place,
        lagged=coefficients.lagged,
        clipped=coefficients.clipped,
        centre=int(np.argmin(np.abs(pairs.place))),
        driven=int(size + layout.place[mesh.driven]),
        limit=float(limit),
        merged=max(1, round(coefficients.impact_separation / step)),
        force=force,
        force_p=force_p,
        acts=acting(coefficients.laws, BODIES),
        bodies=_bodies(mesh, layout),
        contact=contacts,
        contact_p=contact_p,
        counts=np.array([forces, number]),
    )


def _padded(count: int) -> int:
    """Round up to whole vectors."""
    return -(-count // VECTOR_LANES) * VECTOR_LANES


def _inverse_mass(structure: MeshedStructure, layout: Layout) -> np.ndarray:
    """Inverse masses (2 * size,), 0 where a node is held, driven, or padding  [1/kg]."""
    inverse = np.zeros((2, layout.size))
    with np.errstate(divide="ignore"):
        inverse[:, layout.place] = 1.0 / structure.mass
    for freedom in (*structure.held, structure.driven):
        inverse[freedom % 2, layout.place[freedom // 2]] = 0.0
    return inverse.ravel()


def _factors(e: Elements) -> np.ndarray:
    """Coefficients (COEFFICIENT_ROWS * ROW_LENGTH,) of a strip's elements; see `explicit.elements.forces_of_strip`."""
    rows = np.zeros((COEFFICIENT_ROWS, ROW_LENGTH))
    tx, ty = e.twist
    for row, values in zip(
        rows,
        (
            0.5 / e.along,
            0.5 * e.across * e.width * np.ones_like(e.along),
            0.5 * e.along * e.width,
            e.bending[0] / 16.0,
            e.bending[1] / 16.0,
            2.0 * e.cosine,
            2.0 * e.sine,
            4.0 * (e.cosine * tx - e.sine * ty),
            4.0 * (e.sine * tx + e.cosine * ty),
            4.0 * tx,
            4.0 * ty,
        ),
        strict=True,
    ):
        row[: len(values)] = values
    rows[SHAPE_ROW, len(e.along) :] = 2.0  # padding is at rest
    return rows.ravel()


def _bodies(mesh: Mesh, layout: Layout) -> np.ndarray:
    """Stretches (k, 3) of y-nodes with the body that they belong to: first place, how many, body."""
    rows = []
    for k, line in enumerate(mesh.lines):
        start = layout.size + layout.starts[k]
        if k <= mesh.interface:
            rows.append((start, len(line), 0))
        else:
            left = mesh.first + (not mesh.symmetric)
            rows += [(start, left, 0), (start + left, mesh.last - left, 1)]
            rows.append((start + mesh.last, len(line) - mesh.last, 0))
    return np.array(rows)


def begin(plan: ExplicitPlan, layout: Layout, displacement: np.ndarray, velocity: np.ndarray) -> ExplicitState:
    """State with nodal displacements (n, 2) [m], and velocities (n, 2) half a step before them [m/s]."""
    pairs, v = len(plan.slave), layout.spread(velocity)
    return ExplicitState(
        w=layout.spread(displacement) + plan.beta * v,
        v=v,
        elastic=np.zeros(len(plan.strips) * FORCE_ROWS * ROW_LENGTH),
        active=np.zeros(pairs, dtype=np.int64),
        gap=np.zeros(pairs),
        rate=np.zeros(pairs),
        push=np.zeros(pairs),
        mobility=np.zeros(pairs),
        pair_weights=np.zeros(2 * layout.size),
        counters=np.array([0, 0, NO_CONTACT_STEP, NO_CONTACT_STEP]),
    )


def internal_force(plan: ExplicitPlan, layout: Layout, displacement: np.ndarray) -> np.ndarray:
    """Nodal forces (n, 2) of the elements at nodal displacements (n, 2)  [N]."""
    out = np.zeros(len(plan.strips) * FORCE_ROWS * ROW_LENGTH)
    elastic(plan, layout.spread(displacement), out)
    rows = out.reshape(
        len(plan.strips), 2, 2, 2, ROW_LENGTH
    )  # strip; lower, upper; x, y; from the right, from the left
    force = np.zeros((2, layout.size))
    for first, count, below, above in plan.lines:
        total = np.zeros((2, count))
        if above >= 0:
            total += rows[above, 0].sum(axis=1)[:, :count]
        if below >= 0:
            total += rows[below, 1].sum(axis=1)[:, :count]
        force[:, first : first + count] = total
    return force[:, layout.place].T
