"""The simulator `delaminated_beam`."""

import copy
import inspect
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
import xarray as xr

from calib.errors import CalibError
from calib.modelling.laws import BoundLaw
from calib.modelling.simulator import Request
from calib.records import STATE, failed, make, prescription
from calib.records.excitation import Excitation, Harmonic
from calib.simulators.delaminated_beam.case import BeamCase, critical_step_of, modes_of, structure_of
from calib.simulators.delaminated_beam.coefficients import Coefficients
from calib.simulators.delaminated_beam.contact import clearance, critical_damping, penalty
from calib.simulators.delaminated_beam.drive import PLACE, QUANTITY, BeamDrive, centre_displacement
from calib.simulators.delaminated_beam.error_estimate import LEVELS, refined
from calib.simulators.delaminated_beam.mesh import Geometry, mesh
from calib.simulators.delaminated_beam.options import SIGNATURE, BeamOptions, Fidelity, described
from calib.simulators.delaminated_beam.parameters import GEOMETRY, NOT_OF_STRUCTURE, PARAMETERS
from calib.simulators.delaminated_beam.period_map import BeamMap
from calib.simulators.delaminated_beam.reduction import Fineness
from calib.simulators.delaminated_beam.stationary import Engine, FailedMotion, StationaryMotion, stationary
from calib.simulators.delaminated_beam.structure import BODIES, elastic_energy, stable_step
from calib.simulators.impact.period_map import shifted

STEP_ROUNDING = 1e-12  # of the number of steps a period  [1]
IMPACT_SEPARATION_PERIODS = 0.01  # without contact, between two impacts


class DelaminatedBeam:
    """A beam with a delaminated layer in its middle: plane stress, large rotations, penalty contact.

    Source ("the paper"): section 4 of Parameter estimation for finite element analyses of stationary oscillations of a
    vibro-impacting system.

    Two kernels take the same parameters and give the same record. "full" is the explicit finite-element code: central
    differences over corotational quadrilaterals with incompatible modes, contact of nodes with segments. "reduced"
    moves the modes of the same mesh, with the stretch of the bent layer and an implicit contact, a hundred times
    faster; in it `dt` decides only whether the step is stable. "auto" is "reduced" for a search, whose leaders "full"
    confirms.

    The beam is held at two supports and driven by a prescribed displacement in the middle, quantity "displacement" at
    place "centre".

    Parameters
    ----------
    {options}

    Notes
    -----
    The motion settles until its full state returns within 1e-6 after 1 to 16 periods. The record's attribute
    `settled_periods` says how long that took, `stationary` whether it did, and where it did not, `reason` says so.
    The levels depend on the layer: the lowest one takes every second contact pair of a straight layer, and each of an
    arched one. The estimated error is made of the differences d1, d2 of phase curves (`loop_difference`) between one
    level and the next: 1.2 times that to the next one, and 0.65 d2^(3/4) d1^(1/4) for the last, which has no next. Over
    22 random motions with contact of a straight layer and 19 of an arched one, alpha 20 to 750 1/s, against full
    fidelity on the same branch: the levels' errors are 1.1, 0.47 and 0.40 % (medians; arched 1.8, 0.93 and 0.55 %), and
    the estimate is right within a factor of 2 in 41, 37 and 38 of the 41. Without contact the error is 0.01 % at each
    level, and the estimate tells no more than that it is small. Where a motion does not return there is none: NaN.

    `Request.initial_state` is modal coordinates and rates in reduced fidelity, displacements and velocities of the
    free nodes beyond the static shape in full; None is rest on the static shape.
    """

    name = "delaminated_beam"
    bodies = BODIES
    sites = frozenset({"force", "gap", "contact", "excitation"})
    places = MappingProxyType({"body": ("layer",)})
    law_states = 0  # each node would have its own
    numerics = frozenset({"time_step"})
    excitations = frozenset({(QUANTITY, PLACE)})

    __signature__ = SIGNATURE

    def __init__(self, fidelity: Fidelity = "reduced", **options: Any) -> None:
        chosen = BeamOptions.of(fidelity, options)
        self.fidelity = fidelity
        self.balance = chosen.solver.balance
        self.contact_stiffness = chosen.contact.contact_stiffness
        self.damper = chosen.contact.damper
        self.clipped = chosen.contact.clipped
        self.symmetric = chosen.geometry.symmetric
        self.layer = chosen.geometry.layer
        self.shift = chosen.geometry.shift
        self.gap_table = chosen.geometry.measured_gap()
        self.counts = chosen.mesh.counts
        self.levels = _levels(chosen)
        self.steps_stated = chosen.solver.steps is not None
        self.tolerance = chosen.solver.tolerance
        self.settle_limit = chosen.solver.settle_limit
        self.shorter = 1.0
        dropped = "s" if self.shift == "tied" else "gap"
        self.parameters = tuple(p for p in PARAMETERS if p.name != dropped)

    @property
    def confirming(self) -> "DelaminatedBeam | None":
        """The same in full fidelity, where the fidelity is "auto"."""
        if self.fidelity != "auto":
            return None
        other = copy.copy(self)
        other.fidelity = "full"
        return other

    def finer(self, what: str, factor: float) -> "DelaminatedBeam":
        """Return the same with its time step divided by `factor`; in reduced fidelity, the level that is as fine.

        A level stands for half the step of the one before; there is none beyond the last. Where the steps of a period
        are stated, these are multiplied.
        """
        other = copy.copy(self)
        other.shorter = self.shorter * factor
        other.levels = self.levels[min(math.ceil(math.log2(factor) - 1e-9), len(self.levels) - 1) :]
        if self.steps_stated:
            other.levels = tuple(replace(level, steps=math.ceil(level.steps * factor)) for level in other.levels)
        return other

    def run(
        self, values: Mapping[str, float], excitation: Excitation, laws: Sequence[BoundLaw], request: Request
    ) -> xr.Dataset:
        """Simulate; see `calib.modelling.simulator.Simulator` and `calib.modelling.simulator.Request`.

        Raises
        ------
        CalibError : an excitation that is not a harmonic displacement of the centre; output times; an initial state of
            the wrong size
        """
        drive = centre_displacement(excitation)
        if request.times is not None:
            raise CalibError("output times are for excitations without a period; ask for periods and samples instead")
        attrs = self._attrs(values, drive)
        try:
            case = self._case(values, drive, laws)
        except ValueError as error:
            return failed(BODIES, "diverged", str(error), **attrs)
        if case.step > case.stable:
            return failed(BODIES, "unstable step", case.why_unstable(), **attrs, **case.steps())
        attrs |= case.steps()
        motion, more = self._full(case, request) if self.fidelity == "full" else self._reduced(case, request)
        if isinstance(motion, FailedMotion):
            return failed(BODIES, motion.status, motion.reason, **attrs)
        return _record(case, motion, request, {**attrs, **more})

    def period_map(
        self, values: Mapping[str, float], excitation: Excitation, laws: Sequence[BoundLaw], phase: float = 0.0
    ) -> BeamMap:
        """Map of a period from `phase` on; see `calib.modelling.orbit.PeriodMap`.

        Raises
        ------
        CalibError : an excitation that is not a harmonic displacement of the centre
        ValueError : these values give no beam, or a step that is not stable
        """
        centre_displacement(excitation)
        drive = centre_displacement(shifted(excitation, phase))
        case = self._case(values, drive, laws)
        if case.step > case.stable:
            raise ValueError(case.why_unstable())
        if self.fidelity == "full":
            return BeamMap.of_full(case.full, case.structure, drive, case.drive.amplitude)
        return BeamMap.of_reduced(
            lambda state, budget: case.reduced(self.levels[0], state, budget),
            modes_of(case.structure, self.levels[0].modes),
            drive,
            case.drive.amplitude,
        )

    # --- putting a case together

    def _case(self, values: Mapping[str, float], drive: Harmonic, laws: Sequence[BoundLaw]) -> BeamCase:
        for name, value in values.items():
            if not math.isfinite(value):
                raise ValueError(f"parameter {name} is {value}")
        for p in self.parameters:
            if not p.low <= values[p.name] <= p.high:
                raise ValueError(f"parameter {p.name} is {values[p.name]:g}, outside [{p.low:g}, {p.high:g}]")
        of_structure = {name: value for name, value in values.items() if name not in NOT_OF_STRUCTURE}
        height = of_structure.pop("g_max")
        arch = height if self.layer == "arched" else 0.0
        built = structure_of(tuple(sorted(of_structure.items())), arch, self.counts, self.symmetric)
        critical = critical_step_of(built)
        step = values["f_dt"] * critical or values["dt"]
        step /= self.shorter
        if not step > 0.0:
            raise ValueError("the time step is 0 s; give dt, or f_dt as a share of the critical step, a positive value")
        count = math.ceil(drive.period / step * (1.0 - STEP_ROUNDING))
        step = drive.period / count
        shift = values["gap"] - height if self.shift == "tied" else values["s"]
        if self.shift == "tied" and shift < 0.0 and self.gap_table is None:
            raise ValueError(
                f"g_max of {1e3 * height:g} mm is above the gap of {1e3 * values['gap']:g} mm in the middle, so that "
                "layer and beam would overlap at the ends; lower g_max, or take shift 'free' and give s"
            )
        pairs = built.pairs
        stiffness = penalty(
            pairs, self.contact_stiffness, values["f"], built.material, built.width, values["layer_thickness"], step
        )
        share = values["beta"] + values["beta_seconds"] / critical
        return BeamCase(
            structure=built,
            coefficients=Coefficients(
                alpha=values["alpha"],
                beta=share * critical,
                clearance=clearance(pairs, height, shift, laws, self.gap_table),
                stiffness=stiffness,
                damping=values["c_con"] * critical_damping(pairs, stiffness),
                impact_separation=IMPACT_SEPARATION_PERIODS * drive.period,
                lagged=self.damper == "lagged",
                clipped=self.clipped,
                laws=tuple(laws),
            ),
            critical=critical,
            stable=stable_step(critical, share),
            step=step,
            count=count,
            drive=BeamDrive(drive, values["amplitude"], values["alpha"], laws),
        )

    # --- from a case to a motion

    def _settled(self, engine: Engine, request: Request) -> StationaryMotion | FailedMotion:
        return stationary(engine, request.periods, request.samples, request.settle, self.settle_limit)

    def _full(self, case: BeamCase, request: Request) -> tuple[StationaryMotion | FailedMotion, dict[str, float]]:
        """Run the full kernel; also the energy balance of a period, where it is asked for."""
        engine = case.full(request.initial_state, request.step_budget)
        motion = self._settled(engine, request)
        if not self.balance or isinstance(motion, FailedMotion):
            return motion, {}
        balance = engine.balance(lambda displacement: elastic_energy(case.structure, displacement))
        return motion, {name: case.force_factor * energy for name, energy in balance.items()}

    def _reduced(self, case: BeamCase, request: Request) -> tuple[StationaryMotion | FailedMotion, dict[str, float]]:
        """Run the reduced kernel at the level that the tolerance asks for; also that level, and its estimated error."""
        engine = case.reduced(self.levels[0], request.initial_state, request.step_budget)
        motion = self._settled(engine, request)
        if self.tolerance is None or isinstance(motion, FailedMotion):
            return motion, _stated(self.levels[0])
        taken = refined(
            motion,
            self.levels,
            lambda level: self._settled(case.reduced(level, engine.carried(level.modes), request.step_budget), request),
            self.tolerance,
            request.samples,
        )
        return taken.motion, {**_stated(taken.level), "error_estimate": taken.error}

    def _attrs(self, values: Mapping[str, float], drive: Harmonic) -> dict[str, Any]:
        fidelity = "full" if self.fidelity == "full" else "reduced"
        return {
            "source": f"delaminated_beam, {fidelity}",
            "fidelity": fidelity,
            "place": PLACE,
            "quantity": QUANTITY,
            "phase": drive.phase,
            "frequency": drive.frequency,
            "amplitude": drive.amplitude * values["amplitude"],
            "prescribed": prescription(["beam"]),
        }


DelaminatedBeam.__doc__ = inspect.cleandoc(DelaminatedBeam.__doc__ or "").replace("{options}", described())


def _levels(options: BeamOptions) -> tuple[Fineness, ...]:
    """Levels of the reduced kernel with what the options state of them.

    Raises
    ------
    CalibError : the lowest level has more modes than the mesh
    """
    pairs, stated = options.half_pairs, options.solver.fineness
    levels = tuple(
        replace(level, **{"every": math.gcd(level.every, pairs), **stated}) for level in LEVELS[options.geometry.layer]
    )
    nominal = Geometry(arch=0.0, **{p.name: p.nominal for p in PARAMETERS if p.name in GEOMETRY})
    freedoms = mesh(nominal, options.mesh.counts, options.geometry.symmetric).freedoms
    count = levels[0].modes  # finer levels are taken only where the tolerance asks for them
    if options.fidelity != "full" and count >= freedoms:
        raise CalibError(f"{count} modes of a mesh with {freedoms} freedoms; take fewer modes or a finer mesh")
    return levels


def _stated(level: Fineness) -> dict[str, float]:
    """Attributes of a record that say at which level the reduced kernel ran."""
    return {"modes": level.modes, "steps_per_period": level.steps, "parts": level.parts}


def _record(case: BeamCase, motion: StationaryMotion, request: Request, attrs: Mapping[str, Any]) -> xr.Dataset:
    times = np.arange(len(motion.samples)) * (case.drive.period / request.samples)
    contact, reason = motion.contact, ""
    if motion.returns is None and request.settle is None:
        reason = f"no stationary state within {motion.settled} periods; the motion is recorded as it is"
    record = make(
        times,
        BODIES,
        {"displacement": motion.samples[:, :2].T, "velocity": motion.samples[:, 2:].T},
        impacts=(contact.impacts[:, 0], contact.impacts[:, 1]),
        section={name: motion.sections[:, 2 * k : 2 * k + 2].T for k, name in enumerate(STATE)},
        reason=reason,
        settled_periods=motion.settled,
        stationary=int(motion.returns is not None),
        contact_fraction=contact.fraction,
        contact_force_max=case.force_factor * contact.force,
        penetration_max=contact.penetration,
        centre_impacts=len(contact.central) / request.periods,
        **attrs,
    )
    record = record.assign_coords(contact_place=("contact_place", case.contact_places(contact.closed), {"units": "1"}))
    return record.assign(
        contact_force=("time", case.force_factor * motion.force, {"units": "N"}),
        contact_share=("contact_place", contact.closed, {"units": "1"}),
    )
