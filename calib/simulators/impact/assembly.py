"""From a structure, its drive and laws to a problem for the kernel."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from calib.modelling.laws import BoundLaw, at_site
from calib.simulators.impact.contact_laws import ContactLaw
from calib.simulators.impact.flow import MAX_SERIES_ARGUMENT
from calib.simulators.impact.modes import LinearStructure, Stop, regimes
from calib.simulators.impact.problem import PORT, RIGID, UNLOADED, Compliance, Loads, Problem, Regimes
from calib.simulators.impact.refinement import UNREFINED, Refinement
from calib.simulators.law_calls import acting, addresses

STEPS_PER_PERIOD = 48  # where loads are collocated, of order 8; fewer do not resolve the laws between nodes
EVENT_TOLERANCE = 1e-11  # of the time of an event, over the highest angular frequency  [1]
LIFT_TIME = 2.5e-4  # flight after a release without event search, over the highest angular frequency  [1]
STICKING_HEIGHT = 1e-12  # share of the motion's scale below which a rebound sticks
MIN_STICKING_HEIGHT = 1e-15  # the same, of the largest displacement: rounding hides lower rebounds  [1]
MAX_LINEAR_ANGLE, MAX_ANGLE = 3.0, 1.0  # of the highest frequency over a step: in contact; where n = 1 with loss [rad]
MIN_SPEED_SHARE = 1e-3  # of the motion's scale of speed: slower impacts count as that in a loss over their speed  [1]
EXTENT_OF_LAWS = 1.0  # of a motion under force laws, whose own lengths are not known  [m]


@dataclass(frozen=True, eq=False)
class ImpactDrive:
    """What moves the structure: U(t) = Re(amplitude exp(i omega t)) + the table + the laws of the excitation.

    Attributes
    ----------
    period : of the drive, or the time at which a run without a period ends  [s]
    omega : [rad/s]; 0 without a harmonic
    amplitude : complex, U = |amplitude| cos(omega t + phase)
    knots, table : (k + 1,) [s] and (k, 4): U = c0 + c1 s + c2 s^2 + c3 s^3, s [s] since the piece's first knot
    """

    period: float
    omega: float = 0.0
    amplitude: complex = 0.0
    knots: np.ndarray = field(default_factory=lambda: np.zeros(0))
    table: np.ndarray = field(default_factory=lambda: np.zeros((0, 4)))

    @property
    def duration(self) -> float:
        """Scale of time: the period, what a table lasts, or how far from 0 the end of a run is  [s]."""
        return float(np.ptp(self.knots)) if self.knots.size else abs(self.period)


class _CalledLaws(NamedTuple):
    """The laws as `Problem` holds them."""

    force: np.ndarray
    excitation: np.ndarray
    restitution_laws: np.ndarray
    force_p: np.ndarray
    excitation_p: np.ndarray
    restitution_p: np.ndarray
    counts: np.ndarray
    acts: np.ndarray


def assemble(
    structure: LinearStructure,
    drive: ImpactDrive,
    laws: Sequence[BoundLaw] = (),
    coordinates: Sequence[str] = (),
    length: float = 1e-3,
    step: float | None = None,
    fixed_step: bool = False,
    onto_surface: bool = False,
    refinement: Refinement = UNREFINED,
    contact: ContactLaw | None = None,
) -> Problem:
    """Put together what the kernel takes.

    Parameters
    ----------
    coordinates : names of the coordinates, for the bodies of the force laws; those of the body `PORT` act at the stop
    length : scale of the motion  [m]
    step : length of the steps [s]; None for a 48th of the period, or less where the structure asks for it. It matters
        where loads are collocated or events are not located
    fixed_step : whether impacts are taken at the ends of steps
    contact : law of a compliant stop; None where it is rigid
    """
    stop, both = structure.stop, regimes(structure, drive.amplitude, drive.omega)
    called = _called_laws(structure, laws, coordinates)
    collocated = bool(called.counts[:2].any() or drive.knots.size or both.load_constant.any())
    fastest = _highest_frequency(both, drive)
    static = _static_displacement(both, drive, stop, length)
    return Problem(
        regimes=both,
        stop=stop is not None,
        hit=np.array(stop.hit, dtype=float) if stop else np.zeros(len(structure.mass)),
        restitution=float(stop.restitution) if stop else 0.0,
        height=max(STICKING_HEIGHT * length / refinement.event_tolerance, MIN_STICKING_HEIGHT * static),
        period=float(drive.period),
        omega=float(drive.omega),
        amplitude=float(abs(drive.amplitude)),
        phase=float(np.angle(drive.amplitude)),
        exact=not fixed_step,
        onto_surface=onto_surface,
        step=float(_longest_step(drive, step, collocated, fixed_step, fastest) / refinement.time_step),
        resolution=_event_resolution(fastest, drive.period, refinement),
        lift=float(LIFT_TIME / max(fastest, contact.highest_frequency if contact else 0.0)),
        extent=float(max(static, np.abs(both.motion).max(), EXTENT_OF_LAWS if called.counts[:2].any() else 0.0)),
        fastest=float(fastest),
        knots=_own(drive.knots),
        table=_own(drive.table),
        push=_push(structure),
        loads=Loads(bool(both.load_input[:, :, 1:].any() or both.motion_input.any())) if collocated else UNLOADED,
        compliance=_compliance(contact, stop, both, drive, length, fastest, refinement),
        **called._asdict(),
    )


def _own(values: np.ndarray) -> np.ndarray:
    """Copy an array that may be read-only: for such a type the whole kernel would be compiled anew."""
    return np.array(values, dtype=float, order="C")


def _called_laws(structure: LinearStructure, laws: Sequence[BoundLaw], coordinates: Sequence[str]) -> _CalledLaws:
    """Return the laws as the kernel calls them; a law at the port acts only where there is a stop."""
    force, force_p, forces = addresses(laws, "force")
    excitation, excitation_p, excitations = addresses(laws, "excitation")
    restitution, restitution_p, restitutions = addresses(laws, "restitution")
    states = sum(law.states for law in at_site(laws, "force"))
    acts = acting(laws, coordinates or [""] * len(structure.mass), [PORT])
    acts[:, -1] &= structure.stop is not None
    counts = np.array([forces, excitations, restitutions, states, acts[:, -1].sum()])
    return _CalledLaws(force, excitation, restitution, force_p, excitation_p, restitution_p, counts, acts)


def _highest_frequency(both: Regimes, drive: ImpactDrive) -> float:
    """Highest angular frequency or rate of decay in the motion  [rad/s]."""
    return max(drive.omega, np.sqrt(np.abs(both.stiffness).max()), 2.0 * np.abs(both.rate).max(), 1.0 / drive.duration)


def _static_displacement(both: Regimes, drive: ImpactDrive, stop: Stop | None, length: float) -> float:
    """Largest of the gap, the static response to drive and loads, and the scale of the motion  [m]."""
    largest_input = np.abs(drive.table[:, 0]).max(initial=abs(drive.amplitude))
    loads = np.abs(both.load_input[:, :, 0]) * largest_input + np.abs(both.load_constant)
    response = np.abs(both.shape) @ (loads / np.maximum(np.abs(both.stiffness), drive.duration**-2.0))[:, :, None]
    carried = np.abs(both.motion_input) * largest_input
    return float(max(length, abs(stop.gap) if stop else 0.0, carried.max(), response.max()))


def _longest_step(drive: ImpactDrive, step: float | None, collocated: bool, fixed_step: bool, fastest: float) -> float:
    """Length of the steps [s], infinite where closed forms reach as far as they like."""
    if step is None:
        step = drive.period / STEPS_PER_PERIOD if drive.omega else np.inf
    if collocated:
        return min(step, MAX_SERIES_ARGUMENT / fastest)
    return step if fixed_step else np.inf


def _event_resolution(fastest: float, period: float, refinement: Refinement) -> float:
    """Tolerance of the times of events [s]: refined, but not below what a time within the period can show."""
    resolution = EVENT_TOLERANCE / fastest
    return float(max(resolution / refinement.event_tolerance, min(resolution, np.spacing(abs(period)))))


def _compliance(
    contact: ContactLaw | None,
    stop: Stop | None,
    both: Regimes,
    drive: ImpactDrive,
    length: float,
    fastest: float,
    refinement: Refinement,
) -> Compliance:
    """Return the contact as the kernel takes it, its force along the jump of the velocities at a rigid impact."""
    if contact is None or stop is None:
        return RIGID
    lossy = contact.exponent == 1.0 and contact.loss != 0.0
    reach = MAX_ANGLE if lossy else MAX_LINEAR_ANGLE
    return Compliance(
        stiffness=contact.stiffness,
        exponent=contact.exponent,
        damping=contact.damping,
        loss=contact.loss,
        by_speed=contact.by_speed,
        slowest=MIN_SPEED_SHARE * length * max(drive.omega, np.sqrt(np.abs(both.stiffness[0]).min())),
        step=float(reach / max(fastest, contact.highest_frequency) / refinement.time_step),
        free_step=float(MAX_LINEAR_ANGLE / fastest / refinement.time_step),
        load=both.project[0] @ np.asarray(stop.hit, dtype=float),
    )


def _push(structure: LinearStructure) -> np.ndarray:
    """Accelerations (n,) by a force between the two that meet, per unit mass of the body that an impact turns round."""
    stop, mass = structure.stop, structure.mass
    if stop is None:
        return np.zeros(len(mass))
    return (stop.hit @ mass @ stop.hit) * np.linalg.solve(mass, stop.normal)
