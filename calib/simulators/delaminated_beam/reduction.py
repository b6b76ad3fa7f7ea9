"""From a structure and its modes to the constants of the reduced kernel."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from calib.simulators.delaminated_beam.coefficients import Coefficients
from calib.simulators.delaminated_beam.modes import Modes
from calib.simulators.delaminated_beam.reduced.plan import Drift, ReducedPlan
from calib.simulators.delaminated_beam.structure import BODIES, MeshedStructure
from calib.simulators.law_calls import acting, addresses

MAX_GUARD = 2e-6  # m, clearance that counts as near
GUARD_SHARE = 0.1  # of the clearance at rest, below which it counts as near: at the tips, where it is small  [1]
MAX_HALF_ANGLE = 1.2  # rad, omega h / 2 of the fastest modes whose stretch a step h follows
CHECK_SPACING = 4  # pairs from one that is checked in flight to the next; of the last ones at the tips each is
PLACES_PER_HALF = 1e4  # distinct places of nodes along half the delamination, to rounding


@dataclass(frozen=True)
class Fineness:
    """How finely the reduced kernel works.

    Attributes
    ----------
    modes : of the structure
    steps : a period, in flight
    parts : of a step, near contact
    every : of so many contact pairs one is taken, for all of them
    """

    modes: int
    steps: int
    parts: int
    every: int = 1


def drift(omega: np.ndarray, decay: np.ndarray, inertia: np.ndarray, time: float) -> Drift:
    """Exact motion of modes over a time [s].

    Parameters
    ----------
    omega, decay, inertia : (n,) of q'' + decay q' + omega^2 q = -inertia f
    """
    rates = np.zeros((len(omega), 4, 4))
    rates[:, 0, 1] = rates[:, 2, 3] = 1.0
    rates[:, 1, 0], rates[:, 1, 1], rates[:, 1, 2] = -(omega**2), -decay, -inertia
    flow = expm(rates * time)
    half = 0.5 * omega * time
    slope = flow[:, :2, 3] / time
    start = flow[:, :2, 2] - slope
    return Drift(
        *(np.ascontiguousarray(row) for row in (
            flow[:, 0, 0], flow[:, 0, 1], start[:, 0], slope[:, 0],
            flow[:, 1, 0], flow[:, 1, 1], start[:, 1], slope[:, 1], np.sinc(half / np.pi),
        ))
    )  # fmt: skip


def plan(
    structure: MeshedStructure,
    basis: Modes,
    fineness: Fineness,
    coefficients: Coefficients,
    period: float,
    limit: float,
) -> ReducedPlan:
    """Return the constants of a run of the reduced kernel.

    period : of the drive  [s]
    limit : displacement beyond which the motion diverges  [m]
    """
    pairs, step = structure.pairs, period / fineness.steps
    taken = np.arange(0, len(pairs.place), fineness.every)
    decay = coefficients.alpha + coefficients.beta * basis.omega**2
    force, force_p, forces = addresses(coefficients.laws, "force")
    contacts, contact_p, number = addresses(coefficients.laws, "contact")
    tension, stretch, kappa = _stretch(basis, step)
    points = _force_points(structure, basis, forces > 0)
    opening = np.ascontiguousarray(basis.across[taken])
    share, place = pairs.share[taken], pairs.place[taken]
    centre = int(np.argmin(np.abs(place)))
    near = drift(basis.omega, decay, basis.inertia, step / fineness.parts)
    return ReducedPlan(
        step=step,
        parts=fineness.parts,
        flight=drift(basis.omega, decay, basis.inertia, step),
        near=near,
        along=_along(basis.omega, near, step / fineness.parts),
        quadratic=np.ascontiguousarray(basis.quadratic),
        tension=tension,
        stretch=stretch,
        kappa=kappa,
        opening=opening,
        watched=_watched(place, share, fineness.every),
        clearance=np.ascontiguousarray(coefficients.clearance[taken], dtype=float),
        stiffness=fineness.every * coefficients.stiffness[taken],
        damping=fineness.every * coefficients.damping[taken],
        mobility=opening[:, :-1] @ opening[:, :-1].T,
        compliance=np.ascontiguousarray(basis.compliance[np.ix_(taken, taken)]),
        clipped=coefficients.clipped,
        area=np.where(share > 0.0, share, 1.0) * fineness.every * pairs.length[taken] * structure.width,
        place=place,
        centre=centre,
        layer=basis.shape[2 * pairs.slave[taken[centre]] + 1].copy(),
        guard=np.clip(GUARD_SHARE * coefficients.clearance[taken], 0.0, MAX_GUARD),
        limit=float(limit),
        merged=float(coefficients.impact_separation),
        force=force,
        force_p=force_p,
        acts=acting(coefficients.laws, BODIES),
        columns=points.columns,
        masses=points.masses,
        bodies=points.bodies,
        contact=contacts,
        contact_p=contact_p,
        counts=np.array([forces, number]),
    )


def _watched(place: np.ndarray, share: np.ndarray, every: int) -> np.ndarray:
    """Pairs that are checked in flight, of those taken, every so many of all."""
    near_tip = np.abs(place) > 1.0 - CHECK_SPACING * np.diff(place).max()  # where the gap may be as small as one likes
    watched = near_tip | (np.arange(len(place)) % max(1, CHECK_SPACING // every) == 0)
    return np.flatnonzero(watched & (share > 0.0))


def _along(omega: np.ndarray, near: Drift, part: float) -> np.ndarray:
    """Displacement that goes with a change of rate by a contact force which is steady over a part  [s].

    A mode that such a force holds at rest off its place falls back over the part, by 1 - qq, and gathers the rate vq:
    the force has to undo both. Without damping that is tan(omega h / 2) / omega, half a part where omega h is small. A
    mode that goes through its place within the part, by more than a quarter of a turn, cannot be held so; from there on
    it is sin(omega h) / omega, and nothing beyond half a turn, so that none ever grows in a closed contact.
    """
    turn = omega * part
    fast = np.where(turn < np.pi, np.maximum(-near.vq, 0.0) / omega**2, 0.0)
    return np.where(turn < 0.5 * np.pi, (near.qq - 1.0) / near.vq, fast)


def _stretch(basis: Modes, step: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Tension per coordinate, its weight in kicks, and stiffness kappa (see `modes`) for a step  [s].

    Kicks of a steady force f that come h apart let a mode stand at f / omega^2 x / tan(x), x = omega h / 2, when it is
    sampled; the modes that stretch the layer follow its bending nearly at rest, so that they are kicked by tan(x) / x
    as much. Those too fast for the step, near the pole, are taken at rest, in kappa.
    """
    half = 0.5 * basis.omega * step
    fast = half >= MAX_HALF_ANGLE
    tension = np.where(np.append(fast, False), 0.0, basis.tension)
    yielding = basis.tension[:-1][fast] / basis.omega[fast]
    slow = np.minimum(half, MAX_HALF_ANGLE)
    return tension, tension[:-1] * np.tan(slow) / slow / np.sinc(slow / np.pi), basis.kappa - float(yielding @ yielding)


class ForcePoints(NamedTuple):
    """Points at which force laws act.

    Attributes
    ----------
    columns : (j, n + 1) their displacements, per modal coordinate and per displacement of the driven node
    masses : (j,)  [kg]
    bodies : (j,) 0 beam, 1 layer
    """

    columns: np.ndarray
    masses: np.ndarray
    bodies: np.ndarray


def _force_points(structure: MeshedStructure, basis: Modes, present: bool) -> ForcePoints:
    """Nodes above one another of a body, with their mass; none where there are no force laws."""
    if not present:
        return ForcePoints(np.zeros((0, len(basis.omega) + 1)), np.zeros(0), np.zeros(0, dtype=np.int64))
    mesh = structure.mesh
    layer = np.isin(np.arange(len(mesh.nodes)), mesh.layer)
    key = np.round(mesh.nodes[:, 0] / mesh.half_delamination * PLACES_PER_HALF).astype(np.int64) * 2 + layer
    columns, masses, bodies = [], [], []
    for name in np.unique(key):
        nodes = np.flatnonzero(key == name)
        weight = structure.mass[nodes]
        columns.append(weight @ basis.shape[2 * nodes + 1] / weight.sum())
        masses.append(weight.sum())
        bodies.append(name % 2)
    return ForcePoints(np.ascontiguousarray(columns), np.array(masses), np.array(bodies, dtype=np.int64))
