"""The simulator `four_dof`."""

import copy
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline
from scipy.linalg import LinAlgError

from calib.errors import CalibError, nearest
from calib.modelling.effect import Interface
from calib.modelling.laws import BoundLaw, at_site
from calib.modelling.parameter import Parameter
from calib.modelling.simulator import Request
from calib.records import MIN_SECTION_PERIODS, OK, STATE, failed, make, prescription
from calib.records.excitation import Excitation
from calib.simulators.four_dof.drives import BEAM, BODIES, DRIVES, LAYER, DriveName, structure
from calib.simulators.four_dof.lumped import lumped
from calib.simulators.impact.assembly import STEPS_PER_PERIOD, ImpactDrive, assemble
from calib.simulators.impact.contact_laws import COMPLIANT, CONTACTS, ContactName, stop_law, with_contact
from calib.simulators.impact.initial_state import start, with_memory
from calib.simulators.impact.modes import modal, steady_motion
from calib.simulators.impact.output_times import output_times
from calib.simulators.impact.period_map import ImpactMap, impact_map, shifted
from calib.simulators.impact.problem import PORT, ImpactState, Problem
from calib.simulators.impact.refinement import UNREFINED
from calib.simulators.impact.run import SimulatedMotion, simulate

PARAMETERS = (
    Parameter("restitution", "1", 0.05, "Newton's coefficient of restitution, beam and layer", low=0.0, high=1.0),
    Parameter("gap", "m", 1.0e-3, "clearance between beam and layer at rest"),
    Parameter("amplitude", "1", 1.0, "scale on the excitation's amplitude", null=1.0),
    Parameter("damping", "1", 0.004, "damping ratio of every mode, out of contact and in contact", low=0.0),
    Parameter("layer_stiffness", "1", 1.0, "factor on the layer's bending stiffness", null=1.0, low=0.0),
    Parameter("layer_mass", "1", 1.0, "factor on the layer's mass per length", null=1.0, low=0.0),
    Parameter("length", "m", 1.053, "length of the beam", low=0.0),
    Parameter("delamination", "m", 0.353, "length of the delamination", low=0.0),
    Parameter("beam_thickness", "m", 5.0e-3, "thickness of the remaining beam", low=0.0),
    Parameter("layer_thickness", "m", 1.1e-3, "thickness of the layer", low=0.0),
    Parameter("width", "m", 0.040, "width of the beam", low=0.0),
    Parameter("young_modulus", "Pa", 70.0e9, "Young's modulus of both", low=0.0),
    Parameter("density", "kg/m^3", 2700.0, "density of both", low=0.0),
    Parameter("stiffness_factor", "1", 1.001089, "factor on both bending stiffnesses: f1 = 26.24 Hz", low=0.0),
    Parameter("node_position", "1", 0.224, "suspension, from the beam's end, as a share of its length", low=0.0),
    Parameter("drive_stiffness", "1", 10.0, "stiffness of the shaker's spring over K11 (drive 'spring')", low=0.0),
    Parameter("reference_frequency", "Hz", 26.24, "where q1 has the excitation's amplitude (linear)", low=0.0),
)  # fmt: skip


class FourDof:
    """A minimal model of a clapping beam with a delaminated layer.

    Source ("the paper"): section 3 of Parameter estimation for finite element analyses of stationary oscillations of a
    vibro-impacting system (Fig. 3, eqs. (1), (2)).

    Three states: free flight, impact (Newton, the beam infinitely heavy), permanent contact. The flow between events
    is exact; events are located to 1e-11 over the highest angular frequency and none is passed over. Force laws, laws
    of the excitation and recorded inputs go through collocation of order 8 (see `impact.collocation`).

    Parameters
    ----------
    drive : "spring" (default), "rigid", "symmetric", "force" or "centre", see `drives.DRIVES`. With "spring" the
        excitation's amplitude is that of q1 in the linear motion at `reference_frequency`; a law of the excitation
        sees and changes the displacement behind the spring
    mode : "exact", or "fixed_step": impacts are taken at the end of the step that shows penetration
    steps_per_period : of the fixed step (default 250.37: where it divides the period, the error locks to the grid and
        the band of the phase curve disappears), or of the collocation (default 48); it need not be whole
    onto_surface : whether an impact at the end of a fixed step also puts the layer back on the surface
    contact : "rigid" (default: Newton's law of impact), or the law of a compliant contact, by which the layer is pushed
        off the beam at a penetration d [m] and its rate d' [m/s], per unit mass of the layer  [m/s^2]:

        "kelvin_voigt" by max(0, k d^n + c d'); "hunt_crossley" by max(0, k d^n (1 + hunt_crossley d')) (Hunt and
        Crossley 1975); "lankarani_nikravesh" by max(0, k d^n (1 + 3 (1 - e^2) d' / (4 v0))), v0 the closing speed of
        the impact at hand, e its restitution (Lankarani and Nikravesh 1990); "gonthier" by
        max(0, k d^n (1 + a d' / v0)), a such that e is the restitution (2004). n is contact_exponent; k follows from
        contact_time, how long a loss-free impact at 1 m/s lasts, c from the restitution of a layer that flies freely.
        At a contact_time of 0 the stop is rigid. The force acts on the layer alone, as an impact does (paper, eq. (2));
        see `impact.contact_laws`

    Notes
    -----
    The motion settles until its stroboscopic section repeats to 1e-10 after 1 to 16 periods, at most for 1000 periods;
    `Request.settle` counts periods instead. A run with a recorded input starts from the initial state at the first
    sample of the input, which may lie before time 0. `Request.initial_state` is (q1..q4, q1'..q4') in [m], [m/s], and
    where the state of a record goes on, the internal states of the force laws and, with contact "lankarani_nikravesh"
    or "gonthier", the speed at which a present contact began.
    """

    name = "four_dof"
    bodies = BODIES
    parameters: tuple[Parameter, ...] = PARAMETERS
    sites = frozenset({"force", "gap", "restitution", "excitation"})

    def __init__(
        self,
        drive: DriveName = "spring",
        mode: Literal["exact", "fixed_step"] = "exact",
        steps_per_period: float | None = None,
        onto_surface: bool = False,
        contact: ContactName = "rigid",
    ) -> None:
        if drive not in DRIVES:
            raise CalibError(f"unknown drive {drive!r}; four_dof has {', '.join(DRIVES)}{nearest(drive, DRIVES)}")
        if mode not in ("exact", "fixed_step"):
            raise CalibError(f"unknown mode {mode!r}; four_dof has exact, fixed_step")
        if steps_per_period is None:
            steps_per_period = STEPS_PER_PERIOD if mode == "exact" else 250.37
        if not steps_per_period >= 2.0:
            raise CalibError(f"steps_per_period must be at least 2, got {steps_per_period}")
        self.drive = drive
        self.mode = mode
        self.steps_per_period = float(steps_per_period)
        self.onto_surface = bool(onto_surface)
        if contact not in CONTACTS:
            raise CalibError(
                f"unknown contact {contact!r}; four_dof has {', '.join(CONTACTS)}{nearest(contact, CONTACTS)}"
            )
        if contact != "rigid" and mode == "fixed_step":
            raise CalibError(
                f"mode 'fixed_step' takes impacts at the ends of steps, which contact {contact!r} does not have; "
                "take mode 'exact'"
            )
        self.contact = contact
        if contact != "rigid":
            self.parameters = with_contact(PARAMETERS, contact)
            self.sites = frozenset({"force", "gap", "excitation"})
        self.refinement = UNREFINED

    @property
    def numerics(self) -> frozenset[str]:
        """What `finer` refines: a fixed step locates no events."""
        return frozenset({"time_step"} if self.mode == "fixed_step" else {"time_step", "event_tolerance"})

    def finer(self, what: str, factor: float) -> "FourDof":
        """Return the same with steps, or the tolerance of events and the height of sticking, divided by `factor`."""
        other = copy.copy(self)
        other.refinement = self.refinement.times(what, factor)
        return other

    @property
    def contacts(self) -> frozenset[str]:
        """Laws of a compliant contact by which `compliant` replaces the rigid stop."""
        return COMPLIANT if self.contact == "rigid" and self.mode == "exact" else frozenset()

    def compliant(self, contact: ContactName) -> "FourDof":
        """Return the same with a compliant contact in the place of the rigid stop."""
        other = FourDof(self.drive, self.mode, self.steps_per_period, self.onto_surface, contact)
        other.refinement = self.refinement
        return other

    @property
    def places(self) -> dict[str, tuple[str, ...]]:
        """Bodies at each place where effects act: where the drive prescribes both ends, there is no support."""
        ends = tuple(BODIES[i] for i in (0, 3) if i in DRIVES[self.drive].coordinates)
        return {"body": (BODIES[LAYER],), **({"support": ends} if ends else {}), "interface": (PORT,)}

    @property
    def interfaces(self) -> dict[str, Interface]:
        """Clearance between layer and beam."""
        factors = {BODIES[LAYER]: 1.0, BODIES[BEAM]: -1.0}
        return {PORT: Interface("gap", factors, self.contact != "rigid")}

    @property
    def excitations(self) -> frozenset[tuple[str, str]]:
        """Pairs of quantity and place that this drive takes."""
        kind = DRIVES[self.drive]
        return frozenset({(kind.quantity, kind.place), ("free decay", kind.place)})

    def run(
        self, values: Mapping[str, float], excitation: Excitation, laws: Sequence[BoundLaw], request: Request
    ) -> xr.Dataset:
        """Simulate; see `calib.modelling.simulator`.

        Raises
        ------
        CalibError : an excitation that this drive cannot take, an initial state of the wrong size
        """
        self._check(excitation, request)
        attrs = self._attrs(excitation, values)
        harmonic = excitation.harmonic
        times, begins = _periodic_times(excitation, request) if harmonic else output_times(excitation, request)
        try:
            problem = self._checked_problem(values, excitation, laws, None if harmonic else times[-1])
        except ValueError as error:
            return failed(BODIES, "diverged", str(error), **attrs)
        state = self._start(problem, request)
        state.clock[0] = begins
        motion = simulate(
            problem,
            state,
            times,
            periods=request.periods if harmonic else 1,
            settle=request.settle if harmonic else 0,
            sections=MIN_SECTION_PERIODS if harmonic else 0,
            budget=request.step_budget,
            near=harmonic and request.near,
        )
        if motion.status != OK:
            return failed(BODIES, motion.status, motion.reason, **attrs)
        return self._record(times, problem, motion, attrs, harmonic)

    def period_map(
        self, values: Mapping[str, float], excitation: Excitation, laws: Sequence[BoundLaw], phase: float = 0.0
    ) -> ImpactMap:
        """Map of a period from `phase` on; see `calib.modelling.orbit.PeriodMap`.

        Raises
        ------
        CalibError : an excitation that this drive cannot take or that is no harmonic; mode "fixed_step"
        ValueError : these values give no structure that moves
        """
        self._check_drive(excitation)
        if self.mode == "fixed_step":
            raise CalibError("a fixed step that does not divide the period has no period map; take mode 'exact'")
        problem = self._checked_problem(values, shifted(excitation, phase), laws)
        kind = DRIVES[self.drive]
        return impact_map(
            problem,
            BODIES,
            kind.coordinates,
            laws,
            length=_length(values["gap"]),
            channels=lambda rows, times: self._bodies(rows, times, problem),
        )

    def _checked_problem(
        self,
        values: Mapping[str, float],
        excitation: Excitation,
        laws: Sequence[BoundLaw],
        end: float | None = None,
    ) -> Problem:
        """Put the problem together.

        Raises
        ------
        ValueError : a value is not finite, or the values make no structure that moves
        """
        for name, value in values.items():
            if not np.isfinite(value):
                raise ValueError(f"parameter {name} is {value}")
        try:
            return self.problem(values, excitation, laws, end)
        except (LinAlgError, ValueError, ZeroDivisionError) as error:
            raise ValueError(f"these values give no structure that moves: {error}") from error

    def problem(
        self,
        values: Mapping[str, float],
        excitation: Excitation,
        laws: Sequence[BoundLaw] = (),
        end: float | None = None,
    ) -> Problem:
        """Put together what the kernel runs; the run's `end` [s] where the excitation is no harmonic."""
        kind = DRIVES[self.drive]
        gap = values["gap"] + sum(law.function(0.0, law.p) for law in at_site(laws, "gap"))
        contact, restitution, laws = stop_law(self.contact, values, laws)
        free = structure(kind, lumped(values), modal(values["damping"]), gap, restitution)
        scale = values["amplitude"]
        if kind.spring:
            unit = steady_motion(free, 1.0, 2.0 * np.pi * values["reference_frequency"])
            answer = np.hypot(unit[0, 0], unit[0, 1])
            if not answer > 0.0:
                raise ValueError("the shaker does not move q1")
            scale /= answer
        if end is None:
            tone = excitation.as_harmonic
            drive = ImpactDrive(
                period=tone.period,
                omega=2.0 * np.pi * tone.frequency,
                amplitude=scale * tone.amplitude * np.exp(1j * tone.phase),
            )
        elif excitation.recorded:
            time, value = excitation.as_samples
            spline = CubicSpline(time, scale * value)
            drive = ImpactDrive(period=end, knots=spline.x, table=spline.c[::-1].T)
        else:
            drive = ImpactDrive(period=end)
        return assemble(
            free,
            drive,
            laws,
            coordinates=[BODIES[i] for i in kind.coordinates],
            length=_length(gap),
            step=drive.period / self.steps_per_period if end is None else None,
            fixed_step=self.mode == "fixed_step",
            onto_surface=self.onto_surface,
            refinement=self.refinement,
            contact=contact,
        )

    def _check_drive(self, excitation: Excitation) -> None:
        if (excitation.quantity, excitation.place) not in self.excitations:
            takes = " or ".join(f"{quantity} at {place!r}" for quantity, place in sorted(self.excitations))
            raise CalibError(
                f"four_dof with drive {self.drive!r} takes {takes}, got {excitation.quantity} at "
                f"{excitation.place!r}; choose another drive: "
                + "; ".join(f"{name!r} ({kind.quantity} at {kind.place!r})" for name, kind in DRIVES.items())
            )

    def _check(self, excitation: Excitation, request: Request) -> None:
        self._check_drive(excitation)
        if excitation.harmonic and request.times is not None:
            raise CalibError("output times are for excitations without a period; ask for periods and samples instead")
        if self.mode == "fixed_step" and not excitation.harmonic:
            raise CalibError("mode 'fixed_step' has its step from the period of a harmonic excitation; take 'exact'")
        if request.initial_state is not None and np.size(request.initial_state) < 2 * len(BODIES):
            raise CalibError(
                f"the initial state of four_dof is (q1..q4, q1'..q4'), 8 numbers; got {np.size(request.initial_state)}"
            )

    def _start(self, problem: Problem, request: Request) -> ImpactState:
        free, n = list(DRIVES[self.drive].coordinates), len(BODIES)
        initial = np.zeros(2 * n) if request.initial_state is None else np.asarray(request.initial_state, dtype=float)
        return with_memory(problem, start(problem, initial[:n][free], initial[n : 2 * n][free]), initial[2 * n :])

    def _state(self, motion: SimulatedMotion) -> np.ndarray:
        """State at phase zero after the recorded periods, as `Request.initial_state` takes it."""
        free = list(DRIVES[self.drive].coordinates)
        state = np.zeros((2, len(BODIES)))
        state[:, free] = motion.sections[-1, : 2 * len(free)].reshape(2, len(free))
        return np.concatenate([state.ravel(), motion.memory])

    def _attrs(self, excitation: Excitation, values: Mapping[str, float]) -> dict[str, Any]:
        attrs = {
            "source": f"four_dof, drive {self.drive}, {self.mode}",
            "place": excitation.place,
            "quantity": excitation.quantity,
            "phase": excitation.phase,
            "prescribed": prescription([BODIES[i] for i in DRIVES[self.drive].prescribed]),
        }
        if excitation.frequency is not None:
            attrs["frequency"] = excitation.frequency
        if excitation.amplitude is not None:
            attrs["amplitude"] = excitation.amplitude * values["amplitude"]
        return attrs

    def _record(
        self, times: np.ndarray, problem: Problem, motion: SimulatedMotion, attrs: dict[str, Any], harmonic: bool
    ) -> xr.Dataset:
        stationary: dict[str, Any] = {}
        if harmonic:
            at_phase_zero = np.zeros(len(motion.sections))
            section = dict(zip(STATE, self._bodies(motion.sections, at_phase_zero, problem), strict=True))
            stationary = {"section": section, "state": self._state(motion)}
        inside = motion.impacts[motion.impacts[:, 0] >= times[0]]
        if len(inside) == len(motion.impacts):  # else the share is of the time before the record, too
            stationary["contact_fraction"] = motion.contact
        return make(
            times,
            BODIES,
            dict(zip(STATE, self._bodies(motion.samples, times, problem), strict=True)),
            impacts=(inside[:, 0], inside[:, 1]),
            reason="",
            settled_periods=motion.settled,
            steps=motion.steps,
            **stationary,
            **attrs,
        )

    def _bodies(self, rows: np.ndarray, times: np.ndarray, problem: Problem) -> tuple[np.ndarray, np.ndarray]:
        """Displacement and velocity (4, k) of all bodies: those free to move, and those that are the drive's."""
        kind = DRIVES[self.drive]
        free, n = list(kind.coordinates), len(kind.coordinates)
        angle = problem.omega * times + problem.phase
        displacement = np.tile(problem.amplitude * np.cos(angle) + rows[:, 2 * n], (len(BODIES), 1))
        velocity = np.tile(-problem.omega * problem.amplitude * np.sin(angle) + rows[:, 2 * n + 1], (len(BODIES), 1))
        displacement[free], velocity[free] = rows[:, :n].T, rows[:, n : 2 * n].T
        return displacement, velocity


def _length(gap: float) -> float:
    """Scale of the motion [m]."""
    return max(abs(gap), 1e-9)


def _periodic_times(excitation: Excitation, request: Request) -> tuple[np.ndarray, float]:
    """Output times (n,) since phase zero, at which the run begins  [s]."""
    count = request.periods * request.samples
    return np.arange(count) * (excitation.as_harmonic.period / request.samples), 0.0
