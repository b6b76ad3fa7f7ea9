"""The simulator `oscillator`: m x'' + c x' + k x = excitation + load + laws, with a stop at x = gap."""

import cmath
import copy
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from calib import records
from calib.errors import CalibError, nearest
from calib.modelling.effect import Interface
from calib.modelling.laws import BoundLaw, at_site
from calib.modelling.parameter import Parameter
from calib.modelling.simulator import Request
from calib.records.excitation import Excitation, Samples
from calib.simulators.impact.assembly import ImpactDrive, assemble
from calib.simulators.impact.contact_laws import COMPLIANT, CONTACTS, ContactName, stop_law, with_contact
from calib.simulators.impact.initial_state import start, with_memory
from calib.simulators.impact.modes import LinearStructure, Stop, viscous
from calib.simulators.impact.output_times import output_times
from calib.simulators.impact.period_map import ImpactMap, impact_map, shifted
from calib.simulators.impact.problem import PORT
from calib.simulators.impact.refinement import UNREFINED
from calib.simulators.impact.run import SimulatedMotion, simulate
from calib.simulators.oscillator.prescribed import law_accelerations, prescribed_motion

BODY = "mass"
PLACES = {
    "force": "mass",
    "base motion": "base",
    "servo reference": "mass",
    "displacement": "mass",
    "free decay": "mass",
}
HOLDS = ("cubic", "linear", "zero order")
MIN_STEPS = 256  # least steps of a run without a period: where laws act, the loads are polynomials over each
PARAMETERS = (
    Parameter("mass", "kg", 1.0, "moving mass", low=0.0),
    Parameter("damping", "N s/m", 1.0, "viscous damping", null=0.0, low=0.0),
    Parameter("stiffness", "N/m", 1000.0, "stiffness of the spring; 0 for a free mass", null=0.0),
    Parameter("load", "N", 0.0, "constant force", null=0.0),
    Parameter("initial_displacement", "m", 0.0, "displacement at the start of the run", null=0.0),
    Parameter("initial_velocity", "m/s", 0.0, "velocity at the start of the run", null=0.0),
    Parameter("amplitude", "1", 1.0, "factor on the excitation", null=1.0),
    Parameter("position_gain", "1/s", 0.0, "kp of the servo", null=0.0),
    Parameter("velocity_gain", "V s/m", 0.0, "kv of the servo", null=0.0),
    Parameter("drive_constant", "N/V", 0.0, "G of the servo's drive", null=0.0),
)
STOP_PARAMETERS = (
    Parameter("gap", "m", 1e-3, "displacement at which the mass meets the stop"),
    Parameter("restitution", "1", 0.5, "Newton's coefficient at the stop", low=0.0, high=1.0),
)


class Oscillator:
    """One mass: m x'' + c x' + k x = excitation + load + laws and, with `stop`, x <= gap or a compliant contact beyond.

    What moves it, by the quantity of the excitation:

    =================  =====  ==========================================================================================
    force              mass   F = U
    base motion        base   F = k U + c U': spring and damper end at a base that moves by U; x is absolute, and the
                              stop stands still
    servo reference    mass   F = G kv (kp (U - x) - x'): a position controller with a velocity loop and a drive of G
                              newtons per volt, as in the EMPS benchmark (Janot, Gautier, Brunot 2019)
    free decay         mass   F = 0; the motion starts from the initial state
    displacement       mass   x = U is prescribed, and the record holds the force that the model needs for it:
                              m x'' + c x' + k x - load - laws (inverse dynamics; servo and stop have no say)
    =================  =====  ==========================================================================================

    U is `amplitude` times the excitation, harmonic or recorded, plus the laws of the excitation. Between the samples of
    a recorded one, `hold` says what it does: "cubic" (a twice differentiable spline: the best for samples of a
    band-limited signal), "linear", or "zero order" (constant until the next sample: a converter's output as it leaves
    it). A run with a recorded input starts from the initial state at the first sample of the input, which may lie
    before time 0; one with a harmonic input from `Request.initial_state` (x, x'), where that is given. A recorded
    displacement passes the zero-phase low-pass of its cutoff before it is differentiated.

    With `contact` = "rigid" (the default) an impact at the stop follows Newton's law. The others are laws of a
    compliant contact: the force per unit mass [m/s^2] over the penetration d [m] and its rate d' [m/s].

    =====================  ====================================  ======================================================
    "kelvin_voigt"         max(0, k d^n + c d')                  c from the restitution of a mass that flies freely
    "hunt_crossley"        max(0, k d^n (1 + h d'))              h = hunt_crossley; Hunt and Crossley 1975
    "lankarani_nikravesh"  max(0, k d^n (1 + 3 (1 - e^2) d'      v0 the closing speed of the impact at hand, e =
                           / (4 v0)))                            restitution; Lankarani and Nikravesh 1990
    "gonthier"             max(0, k d^n (1 + a d' / v0))         a so that e is the restitution; Gonthier et al. 2004
    =====================  ====================================  ======================================================

    n is contact_exponent; k follows from contact_time, how long a loss-free impact at 1 m/s lasts. At a contact_time of
    0 the stop is rigid. See `calib.simulators.impact.contact_laws`.

    The linear part is solved exactly, impacts are located exactly; see `calib.simulators.impact`.
    """

    name = "oscillator"
    bodies = (BODY,)
    excitations = frozenset(PLACES.items())
    initial = {"initial_displacement": (BODY, "displacement"), "initial_velocity": (BODY, "velocity")}

    def __init__(self, hold: str = "cubic", stop: bool = False, contact: ContactName = "rigid") -> None:
        if hold not in HOLDS:
            raise CalibError(f"hold is one of {list(HOLDS)}, got {hold!r}{nearest(hold, HOLDS)}")
        if contact not in CONTACTS:
            raise CalibError(
                f"unknown contact {contact!r}; oscillator has {', '.join(CONTACTS)}{nearest(contact, CONTACTS)}"
            )
        if contact != "rigid" and not stop:
            raise CalibError(
                f"contact {contact!r} is that of a stop, and there is none; add stop = true to the options"
            )
        self.hold = hold
        self.stop = stop
        self.contact = contact
        self.numerics = frozenset({"time_step", "event_tolerance"} if stop else {"time_step"})
        self.contacts = COMPLIANT if stop and contact == "rigid" else frozenset()
        self.refinement = UNREFINED
        self.parameters = PARAMETERS + (with_contact(STOP_PARAMETERS, contact) if stop else ())
        self.places = {"body": (BODY,), **({"interface": (PORT,)} if stop else {})}
        self.interfaces = {PORT: Interface("gap", {BODY: -1.0}, contact != "rigid")} if stop else {}
        self.sites = frozenset({"force", "excitation"} | ({"gap"} if stop else set()))
        if stop and contact == "rigid":
            self.sites |= {"restitution"}

    def finer(self, what: str, factor: float) -> "Oscillator":
        """Return the same with the steps of its loads, or the tolerance of its events, divided by `factor`."""
        other = copy.copy(self)
        other.refinement = self.refinement.times(what, factor)
        return other

    def compliant(self, contact: ContactName) -> "Oscillator":
        """Return the same with a compliant contact in the place of the rigid stop."""
        other = Oscillator(self.hold, self.stop, contact)
        other.refinement = self.refinement
        return other

    def run(
        self, values: Mapping[str, float], excitation: Excitation, laws: Sequence[BoundLaw], request: Request
    ) -> xr.Dataset:
        """Simulate at `values` (SI); see the class for what a record holds.

        Raises
        ------
        CalibError : an excitation that it cannot take, or output times that the recorded input does not cover
        """
        _check(excitation, self.hold)
        times = _times(excitation, request)
        attrs = _attrs(values, excitation)
        for name, value in values.items():
            if not math.isfinite(value):
                return records.failed(self.bodies, "impossible value", f"{name} is {value}", **attrs)
        if values["mass"] <= 0.0:
            return records.failed(self.bodies, "impossible value", f"a mass of {values['mass']:g} kg", **attrs)
        if excitation.quantity == "displacement":
            return _inverse_dynamics(values, excitation, laws, request, times, attrs)
        return self._motion(values, excitation, laws, request, times, attrs)

    def period_map(
        self, values: Mapping[str, float], excitation: Excitation, laws: Sequence[BoundLaw], phase: float = 0.0
    ) -> ImpactMap:
        """Map of a period from `phase` on; see `calib.modelling.orbit.PeriodMap`.

        Raises
        ------
        CalibError : an excitation that it cannot take, that is no harmonic or prescribes the motion
        ValueError : these values give no oscillator
        """
        _check(excitation, self.hold)
        if excitation.quantity == "displacement":
            raise CalibError("a prescribed displacement has no period map; drive the mass by a force or by its base")
        for name, value in values.items():
            if not math.isfinite(value):
                raise ValueError(f"{name} is {value}")
        if values["mass"] <= 0.0:
            raise ValueError(f"a mass of {values['mass']:g} kg")
        excitation = shifted(excitation, phase)
        contact, restitution, laws = stop_law(self.contact, values, laws)
        structure = _structure(values, excitation.quantity, laws, restitution)
        drive = _drive(excitation, values["amplitude"], self.hold, np.zeros(0))
        length = _length(values, structure, excitation, drive.period)
        return impact_map(
            assemble(structure, drive, laws, self.bodies, length=length, refinement=self.refinement, contact=contact),
            self.bodies,
            (0,),
            laws,
            length=length,
            channels=lambda rows, _: (rows[:, 0][None], rows[:, 1][None]),
            initial=np.array([values["initial_displacement"], values["initial_velocity"]]),
        )

    def _motion(
        self,
        values: Mapping[str, float],
        excitation: Excitation,
        laws: Sequence[BoundLaw],
        request: Request,
        times: np.ndarray,
        attrs: dict[str, Any],
    ) -> xr.Dataset:
        harmonic = excitation.harmonic
        try:
            contact, restitution, laws = stop_law(self.contact, values, laws)
        except ValueError as error:
            return records.failed(self.bodies, "impossible value", str(error), **attrs)
        structure = _structure(values, excitation.quantity, laws, restitution)
        drive = _drive(excitation, values["amplitude"], self.hold, times)
        begins = excitation.as_samples.time[0] if excitation.recorded else 0.0
        duration = drive.period - begins
        problem = assemble(
            structure,
            drive,
            laws,
            self.bodies,
            length=_length(values, structure, excitation, duration),
            step=None if harmonic else duration / MIN_STEPS,
            refinement=self.refinement,
            contact=contact,
        )
        begin = np.array([values["initial_displacement"], values["initial_velocity"]])
        if harmonic and request.initial_state is not None:
            begin = np.asarray(request.initial_state, dtype=float)
        state = with_memory(problem, start(problem, begin[:1], begin[1:2]), begin[2:])
        state.clock[0] = begins
        if harmonic:
            motion = simulate(
                problem, state, times, request.periods,
                settle=request.settle, budget=request.step_budget, near=request.near,
            )  # fmt: skip
        else:
            motion = simulate(problem, state, times, settle=0, sections=0, budget=request.step_budget)
        return _record(times, motion, harmonic, attrs)


def _check(excitation: Excitation, hold: str) -> None:
    quantity, place = excitation.quantity, excitation.place
    if PLACES.get(quantity) != place:
        takes = ", ".join(f"{q} at {p!r}" for q, p in PLACES.items())
        raise CalibError(f"simulator 'oscillator' is not driven by {quantity} at {place!r}; it takes {takes}")
    if excitation.recorded and quantity == "base motion" and hold == "zero order":
        raise CalibError(
            "a base whose displacement jumps from sample to sample has no velocity, which the damper needs; "
            'use hold = "linear" or "cubic"'
        )


def _times(excitation: Excitation, request: Request) -> np.ndarray:
    """Output times (n,) [s]."""
    if excitation.harmonic:
        return np.arange(request.periods * request.samples) / (excitation.as_harmonic.frequency * request.samples)
    return output_times(excitation, request)[0]


def _attrs(values: Mapping[str, float], excitation: Excitation) -> dict[str, Any]:
    attrs: dict[str, Any] = {"source": "oscillator", **excitation.attributes}
    if excitation.harmonic:
        attrs["amplitude"] = values["amplitude"] * excitation.as_harmonic.amplitude
    if excitation.quantity == "displacement":
        attrs["prescribed"] = records.prescription([BODY])
    return attrs


def _structure(
    values: Mapping[str, float], quantity: str, laws: Sequence[BoundLaw], restitution: float
) -> LinearStructure:
    """Put together mass, spring, damper, servo, stop and what the drive does to them."""
    stiffness, damping = values["stiffness"], values["damping"]
    load = [0.0, 0.0, 0.0]  # per unit of U, U', U''
    if quantity == "force":
        load = [1.0, 0.0, 0.0]
    elif quantity == "base motion":
        load = [stiffness, damping, 0.0]
    elif quantity == "servo reference":
        rate_gain = values["drive_constant"] * values["velocity_gain"]  # G kv  [N s/m]
        stiffness += rate_gain * values["position_gain"]
        damping += rate_gain
        load = [rate_gain * values["position_gain"], 0.0, 0.0]
    stop = None
    if "gap" in values:
        gap = values["gap"] + sum(law.function(0.0, law.p) for law in at_site(laws, "gap"))
        stop = Stop(np.array([-1.0]), np.array([-1.0]), gap, restitution)
    return LinearStructure(
        mass=np.array([[values["mass"]]]),
        stiffness=np.array([[stiffness]]),
        rate=viscous(damping / (2.0 * values["mass"])),
        load=np.array([load]),
        constant=np.array([values["load"]]),
        stop=stop,
    )


def _drive(excitation: Excitation, scale: float, hold: str, times: np.ndarray) -> ImpactDrive:
    """Return U as the kernel takes it; without a period, the run lasts to the last of `times` [s]."""
    if excitation.quantity == "free decay":
        return ImpactDrive(period=times[-1])
    if excitation.recorded:
        samples = excitation.as_samples
        return ImpactDrive(period=times[-1], knots=samples.time, table=scale * _pieces(samples, hold))
    tone = excitation.as_harmonic
    amplitude = scale * tone.amplitude * cmath.exp(1j * tone.phase)
    return ImpactDrive(period=tone.period, omega=2.0 * math.pi * tone.frequency, amplitude=amplitude)


def _pieces(samples: Samples, hold: str) -> np.ndarray:
    """Coefficients (n - 1, 4), of rising power, of the recorded input between its samples."""
    time, value = samples
    if hold == "cubic":
        return CubicSpline(time, value).c[::-1].T
    table = np.zeros((time.size - 1, 4))
    table[:, 0] = value[:-1]
    if hold == "linear":
        table[:, 1] = np.diff(value) / np.diff(time)
    return table


def _length(values: Mapping[str, float], structure: LinearStructure, excitation: Excitation, duration: float) -> float:
    """Scale of the motion [m]: what the initial state and the loads make of a mass in the time they have."""
    mass = values["mass"]
    slowest = max(math.sqrt(abs(structure.stiffness[0, 0]) / mass), 1.0 / duration)
    omega = 2.0 * math.pi * (excitation.frequency or 0.0)
    largest = np.abs(excitation.as_samples.value).max() if excitation.recorded else abs(excitation.amplitude or 0.0)
    drive = abs(values["amplitude"]) * largest
    fastest = max(omega, slowest)  # above resonance the response falls with the square of the frequency
    force = drive * (abs(structure.load[0, 0]) + abs(structure.load[0, 1]) * fastest)
    loads = abs(values["load"]) / mass / slowest**2 + force / mass / fastest**2
    return max(abs(values["initial_displacement"]), abs(values["initial_velocity"]) / slowest, loads) or 1.0


def _record(times: np.ndarray, motion: SimulatedMotion, harmonic: bool, attrs: dict[str, Any]) -> xr.Dataset:
    if motion.status != records.OK:
        return records.failed((BODY,), motion.status, motion.reason, **attrs)
    if not np.isfinite(motion.samples).all():
        return records.failed((BODY,), "diverged", "the motion is not finite", **attrs)
    channels = {"displacement": motion.samples[None, :, 0], "velocity": motion.samples[None, :, 1]}
    if harmonic:
        attrs = {**attrs, "settled_periods": motion.settled}
    inside = motion.impacts[motion.impacts[:, 0] >= times[0]]
    stationary: dict[str, Any] = {}
    if harmonic:
        section = {"displacement": motion.sections[None, :, 0], "velocity": motion.sections[None, :, 1]}
        stationary = {"section": section, "state": np.concatenate([motion.sections[-1, :2], motion.memory])}
    return records.make(times, (BODY,), channels, impacts=(inside[:, 0], inside[:, 1]), **stationary, **attrs)


def _inverse_dynamics(
    values: Mapping[str, float],
    excitation: Excitation,
    laws: Sequence[BoundLaw],
    request: Request,
    times: np.ndarray,
    attrs: dict[str, Any],
) -> xr.Dataset:
    """Record of the force that the model needs for the prescribed motion, beside that motion."""
    laws = [law for law in laws if law.site != "force" or law.bodies is None or BODY in law.bodies]  # none at the stop
    evaluated = times  # [s]
    if not excitation.recorded:  # internal states of laws settle, and the section fills, before time 0
        before = max(records.MIN_SECTION_PERIODS, request.settle or 0) * request.samples
        evaluated = np.arange(-before, times.size + 1) / (excitation.as_harmonic.frequency * request.samples)
    motion = prescribed_motion(excitation, values["amplitude"], laws, evaluated)
    accelerations = law_accelerations(motion, laws, request.step_budget)
    if accelerations is None:
        reason = f"the internal states of the laws took more than {request.step_budget} steps"
        return records.failed((BODY,), "step budget", reason, **attrs)
    force = (
        values["mass"] * (motion.a - accelerations)
        + values["damping"] * motion.v
        + values["stiffness"] * motion.x
        - values["load"]
    )
    if not np.isfinite(force).all():
        return records.failed((BODY,), "diverged", "the force is not finite", **attrs)
    at = np.searchsorted(motion.time, times - 1e-6 * (times[1] - times[0]))
    channels = {"displacement": motion.x[None, at], "velocity": motion.v[None, at], "force": force[None, at]}
    if excitation.recorded:
        return records.make(times, (BODY,), channels, **attrs)
    whole = np.searchsorted(
        motion.time,
        np.arange(request.periods - records.MIN_SECTION_PERIODS + 1, request.periods + 1)
        / excitation.as_harmonic.frequency
        - 0.5 * (motion.time[1] - motion.time[0]),
    )
    section = {"displacement": motion.x[None, whole], "velocity": motion.v[None, whole]}
    return records.make(times, (BODY,), channels, section=section, **attrs)
