"""From a structure, its drive and laws to a problem for the kernel; from a problem to a motion."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from calib.modelling.laws import STATES, BoundLaw, at_site
from calib.records import OK, SECTION
from calib.simulators.impact import kernel
from calib.simulators.impact.coordinates import to_coordinates
from calib.simulators.impact.flow import REACH
from calib.simulators.impact.modes import LinearStructure, regimes
from calib.simulators.impact.problem import (
    AT_PERIOD,
    CONTACT,
    HIT,
    IMPACTS,
    PORT,
    REGIME,
    RELEASED,
    SECTIONS,
    STEPS,
    TOUCH,
    ImpactState,
    Problem,
)  # fmt: skip
from calib.simulators.impact.scratch import scratch
from calib.simulators.impact.shooting import shoot
from calib.simulators.slots import acting, fill

GRID = 48  # steps per period where loads are collocated, of order 8; fewer do not resolve the laws between nodes
SETTLED = 1e-10  # relative change of the section
CAP = 1000  # periods after which a motion that has not settled is taken as it is
STUCK = 1e-12  # share of the gap below which a rebound sticks
DIVERGED = 1e6  # times its scale
STATUS = {kernel.DIVERGED: "diverged", kernel.SPENT: "step budget"}


@dataclass(frozen=True, eq=False)
class ImpactDrive:
    """What moves the structure: U(t) = Re(amplitude exp(i omega t)) + the table + the laws of the excitation.

    Attributes
    ----------
    period : of the drive, or the duration of a run without a period  [s]
    omega : [rad/s]; 0 without a harmonic
    amplitude : complex, U = |amplitude| cos(omega t + phase)
    knots, table : (k + 1,) [s] and (k, 4): U = c0 + c1 s + c2 s^2 + c3 s^3, s [s] since the piece's first knot
    """

    period: float
    omega: float = 0.0
    amplitude: complex = 0.0
    knots: np.ndarray = field(default_factory=lambda: np.zeros(0))
    table: np.ndarray = field(default_factory=lambda: np.zeros((0, 4)))


class SimulatedMotion(NamedTuple):
    """What a run gives.

    Attributes
    ----------
    status, reason : "ok", "diverged" or "step budget"
    settled : periods dropped before the recorded ones
    samples : (k, 2 n + 2) q [m], q' [m/s], U, U' at the asked times; U without its harmonic part
    sections : (SECTION or more, 2 n + 2) the same at the end of each of the last periods
    impacts : (k, 2 + 2 n) of the recorded periods: time since their start [s], closing speed [m/s], (q, q') before
    contact : share of the recorded time in permanent contact  [1]
    steps : spent
    inner : (SLOTS * n * STATES,) internal states of the force laws at the end, (0,) where the laws have none
    """

    status: str
    reason: str
    settled: int
    samples: np.ndarray
    sections: np.ndarray
    impacts: np.ndarray
    contact: float
    steps: int
    inner: np.ndarray


def assemble(
    structure: LinearStructure,
    drive: ImpactDrive,
    laws: Sequence[BoundLaw] = (),
    coordinates: Sequence[str] = (),
    length: float = 1e-3,
    step: float | None = None,
    fixed_step: bool = False,
    onto_surface: bool = False,
    shorter: float = 1.0,
    sharper: float = 1.0,
) -> Problem:
    """Put together what the kernel is told.

    Parameters
    ----------
    coordinates : names of the coordinates, for the bodies of the force laws; those of the body `PORT` act at the stop
    length : scale of the motion  [m]
    step : length of the steps [s]; None for a 48th of the period, or less where the structure asks for it. It matters
        where loads are collocated or events are not located
    fixed_step : whether impacts are taken at the ends of steps
    shorter : by which the steps are divided
    sharper : by which the tolerance of located events and the height of sticking are divided
    """
    force, force_p, forces = fill(laws, "force")
    excitation, excitation_p, excitations = fill(laws, "excitation")
    restitution, restitution_p, restitutions = fill(laws, "restitution")
    states = sum(law.states for law in at_site(laws, "force"))

    both = regimes(structure, drive.amplitude, drive.omega)
    collocated = bool(forces or excitations or drive.knots.size or both.load_constant.any())
    fastest = max(drive.omega, np.sqrt(np.abs(both.stiffness).max()), 2.0 * np.abs(both.rate).max(), 1.0 / drive.period)
    if step is None:
        step = drive.period / GRID if drive.omega else np.inf
    if collocated:
        step = min(step, REACH / fastest)
    elif not fixed_step:
        step = np.inf
    resolution = 1e-11 / fastest
    resolution = max(resolution / sharper, min(resolution, np.spacing(drive.period)))
    stop = structure.stop
    acts = acting(laws, coordinates or [""] * len(structure.mass), [PORT])
    acts[:, -1] &= stop is not None
    return Problem(
        regimes=both,
        stop=stop is not None,
        hit=np.array(stop.hit, dtype=float) if stop else np.zeros(len(structure.mass)),
        restitution=float(stop.restitution) if stop else 0.0,
        height=STUCK * length / sharper,
        period=float(drive.period),
        omega=float(drive.omega),
        amplitude=float(abs(drive.amplitude)),
        phase=float(np.angle(drive.amplitude)),
        exact=not fixed_step,
        onto_surface=onto_surface,
        step=float(step / shorter),
        collocated=collocated,
        resolution=float(resolution),
        lift=float(2.5e-4 / fastest),
        limit=float(DIVERGED * length * max(1.0, fastest)),
        knots=np.ascontiguousarray(drive.knots, dtype=float),
        table=np.ascontiguousarray(drive.table, dtype=float),
        force=force,
        excitation=excitation,
        restitution_laws=restitution,
        force_p=force_p,
        excitation_p=excitation_p,
        restitution_p=restitution_p,
        counts=np.array([forces, excitations, restitutions, states, acts[:, -1].sum()]),
        acts=acts,
        push=_push(structure),
    )


def _push(structure: LinearStructure) -> np.ndarray:
    """Accelerations (n,) by a force between the two that meet, per unit mass of the body that an impact turns round."""
    stop, mass = structure.stop, structure.mass
    if stop is None:
        return np.zeros(len(mass))
    return (stop.hit @ mass @ stop.hit) * np.linalg.solve(mass, stop.normal)


def start(problem: Problem, q: np.ndarray, dq: np.ndarray) -> ImpactState:
    """Return the state at phase zero with coordinates q [m] and velocities dq [m/s] (n,).

    Where the stop would be penetrated, or is touched and not being left, the run starts in contact.
    """
    both, omega = problem.regimes, problem.omega
    u, du = problem.table[0, :2] if len(problem.table) else (0.0, 0.0)

    def modal(r, q, dq):
        y = both.project[r] @ (q - both.motion[r] @ [1.0, 0.0, 1.0] - both.motion_input[r] * u)
        return y, both.project[r] @ (dq - both.motion[r] @ [0.0, omega, 0.0] - both.motion_input[r] * du)

    y, v = modal(0, q, dq)
    touch = regime = 0
    if problem.stop:
        acceleration = -2.0 * both.rate[0] * v - both.stiffness[0] * y
        clearance = both.witness_y[0] @ y + both.witness[0] @ [1.0, 0.0, 1.0] + both.witness_input[0, 0] * u
        rate = both.witness_y[0] @ v + both.witness[0] @ [0.0, omega, 0.0] + both.witness_input[0, 0] * du
        opening = both.witness_y[0] @ acceleration - both.witness[0, 0] * omega**2
        # a state from within a contact lies beside the surface by rounding
        at_rest = abs(clearance) <= problem.height and abs(rate) * problem.lift <= problem.height and opening < 0.0
        if clearance <= 0.0 or at_rest:
            q = q - clearance * problem.hit
            regime = CONTACT if rate < 0.0 or at_rest else 0
            touch = 0 if regime == CONTACT else (HIT if rate > 0.0 else RELEASED)
            y, v = modal(regime, q, dq - rate * problem.hit if regime == CONTACT else dq)
    state = ImpactState(y, v, np.zeros((*problem.acts.shape, STATES)), np.zeros(2), np.zeros(7, dtype=np.int64))
    state.count[REGIME], state.count[TOUCH] = regime, touch
    return state


def _coordinates(problem: Problem, state: ImpactState) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates [m] and velocities [m/s] (n,) of a state at phase zero."""
    n, w = len(state.y), scratch(len(state.y))
    u, du = problem.table[0, :2] if len(problem.table) else (0.0, 0.0)
    to_coordinates(
        problem.regimes, state.count[REGIME], state.y, state.v, problem.omega, state.clock[0], u, du, w.q, w.dq
    )
    return w.q[:n], w.dq[:n]


def with_inner(state: ImpactState, inner: np.ndarray) -> ImpactState:
    """Return the state with the internal states of the force laws that a motion ended with, where the sizes agree."""
    if inner.size == state.z.size:
        state.z[:] = inner.reshape(state.z.shape)
    return state


def simulate(
    problem: Problem,
    state: ImpactState,
    times: np.ndarray,
    periods: int = 1,
    settle: int | None = None,
    sections: int = SECTION,
    budget: int = 50_000_000,
    capacity: int = 4096,
    near: bool = False,
) -> SimulatedMotion:
    """Settle, then record `periods` periods.

    Parameters
    ----------
    state : from `start`; written
    times : (k,) when to sample, since the recorded periods' start  [s]
    settle : periods to drop; None: until the section changes by less than 1e-10 (of its largest displacement, velocity)
        against one of the 16 sections before, at most 1000 periods, and on until with the recorded periods there are
        `sections` of them
    sections : that the motion gives at least; where `settle` is given, the run goes on after the recorded periods for
        those that are missing
    capacity : impacts that are kept
    near : whether the state lies near a motion that returns after one period: where shooting finds that motion, one
        period of it stands for all, whose `times` are alike, and there are no more sections than recorded periods
    """
    n = len(state.y)
    if near and problem.exact:
        returning = shoot(problem, start, *_coordinates(problem, state), state.z, scratch(n), budget)
        if returning is not None:
            first = times[: len(times) // periods]
            one = simulate(problem, returning, first, 1, 0, 1, budget, capacity)
            return _repeated(one, periods, problem.period)
    none = np.zeros((0, 2 * n + 2))
    no_impacts, no_times = np.zeros((0, 2 + 2 * n)), np.zeros(0)
    samples = np.zeros((len(times), 2 * n + 2))
    dropped, w = [none], scratch(n)

    def advance(periods, tolerance=0.0, times=no_times, samples=none, impacts=no_impacts):
        rows = np.zeros((periods, 2 * n + 2))
        before = int(state.count[SECTIONS])
        code = kernel.advance(problem, state, w, periods, tolerance, budget, rows, times, samples, impacts)
        return code, rows[: int(state.count[SECTIONS]) - before]

    code = kernel.DONE
    if settle is None:
        code, rows = advance(CAP, SETTLED)
        dropped.append(rows)
        more = max(0, sections - periods)
        if code == kernel.SETTLED and more:
            code, rows = advance(more)
            dropped.append(rows)
    elif settle > 0:
        code, rows = advance(settle)
        dropped.append(rows)
    dropped = np.concatenate(dropped)
    recorded, impacts, contact, origin = none, no_impacts, 0.0, 0.0
    if code in (kernel.DONE, kernel.SETTLED):
        impacts = np.zeros((capacity, 2 + 2 * n))
        origin = int(state.count[SECTIONS]) * problem.period
        before, state.count[IMPACTS] = state.clock[1], 0
        times = np.ascontiguousarray(times, dtype=float)
        code, recorded = advance(periods, times=times, samples=samples, impacts=impacts)
        contact = (state.clock[1] - before) / (periods * problem.period)
        impacts = impacts[: min(capacity, int(state.count[IMPACTS]))]
        impacts[:, 0] -= origin
    missing = sections - len(dropped) - len(recorded)
    after = none
    if code == kernel.DONE and missing > 0:
        code, after = advance(missing)
    status = STATUS.get(code, OK)
    reasons = {
        "diverged": f"the motion grew beyond bounds in period {int(state.count[AT_PERIOD])}",
        "step budget": f"{budget} steps were spent by period {int(state.count[AT_PERIOD])}",
    }
    return SimulatedMotion(
        status, reasons.get(status, ""), len(dropped), samples,
        np.concatenate([dropped, recorded, after])[-max(sections, periods, 1) :],
        impacts, contact, int(state.count[STEPS]), state.z.ravel() if problem.counts[3] else np.zeros(0),
    )  # fmt: skip


def _repeated(one: SimulatedMotion, periods: int, period: float) -> SimulatedMotion:
    """Return the motion of so many periods that a motion of one makes when it returns."""
    impacts = np.tile(one.impacts, (periods, 1))
    impacts[:, 0] += np.repeat(np.arange(periods) * period, len(one.impacts))
    samples, sections = np.tile(one.samples, (periods, 1)), np.tile(one.sections, (periods, 1))
    return one._replace(samples=samples, sections=sections, impacts=impacts)
