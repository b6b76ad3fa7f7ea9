"""The simulator `delaminated_beam`."""

import copy
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Literal

import numpy as np
import xarray as xr

from calib.errors import CalibError, nearest
from calib.modelling.laws import BoundLaw
from calib.modelling.parameter import Parameter
from calib.records import OK, STATE, failed, make, prescription
from calib.records.excitation import Excitation
from calib.simulators.delaminated_beam.case import BeamCase, critical_step_of, modes_of, structure_of
from calib.simulators.delaminated_beam.contact import Stiffness, clearance, critical_damping, penalty
from calib.simulators.delaminated_beam.drive import BeamDrive
from calib.simulators.delaminated_beam.layout import BODIES, LONGEST, elastic_energy, stable_step
from calib.simulators.delaminated_beam.mesh import Counts, Geometry, mesh
from calib.simulators.delaminated_beam.period_map import BeamMap
from calib.simulators.delaminated_beam.reduction import Fineness
from calib.simulators.delaminated_beam.stationary import StationaryMotion, stationary
from calib.simulators.impact.period_map import shifted

Fidelity = Literal["reduced", "full", "auto"]
PLACE, QUANTITY = "centre", "displacement"
LEVELS = {
    "straight": (Fineness(40, 512, 16, 2), Fineness(64, 1024, 16, 1), Fineness(128, 1024, 32, 1)),
    "arched": (Fineness(48, 512, 12, 1), Fineness(64, 1024, 16, 1), Fineness(128, 1024, 32, 1)),
}
FACTOR = 1.2  # estimated error over the difference to the next level
LAST, SHARE = 0.65, 0.25  # of the last level, over the differences before it, with the last but one's share in them
SETTLE = 200  # periods after which a motion that does not return is taken as it is

PARAMETERS = (
    Parameter("alpha", "1/s", 500.0, "mass-proportional Rayleigh damping", null=0.0, low=0.0),
    Parameter("beta", "1", 0.02, "stiffness damping, as a share of critical at the elements' highest frequency "
              "(the unitless coefficient of LS-DYNA): beta = 1 is critical_step seconds", null=0.0, low=0.0),
    Parameter("beta_seconds", "s", 0.0, "classical stiffness-proportional damping, added", null=0.0, low=0.0),
    Parameter("f", "1", 0.01, "factor on the contact stiffness", low=0.0),
    Parameter("c_con", "1", 5.0, "contact damping over C_crit = 2 m w of each pair, with m the smaller of its masses: "
              "up to half the true damping ratio", null=0.0, low=0.0),
    Parameter("dt", "s", 9.38e-8, "time step; the longest below it that divides the period is taken. In reduced "
              "fidelity it decides only whether a run is stable, and its effect shows in full", low=0.0),
    Parameter("f_dt", "1", 0.0, "time step over the computed critical one (eq. 4), in the place of dt; 0: dt holds",
              null=0.0, low=0.0),
    Parameter("g_max", "m", 0.2e-3, "height of the gap's cubics in the middle (Fig. 8)", low=0.0),
    Parameter("s", "m", 0.8e-3, "shift of the gap", null=0.0),
    Parameter("gap", "m", 1.0e-3, "gap in the middle, where the shift is tied: s = gap - g_max"),
    Parameter("amplitude", "1", 1.0, "scale on the excitation's amplitude", null=1.0),
    Parameter("length", "m", 1.386, "length of the beam", low=0.0),
    Parameter("delamination", "m", 0.56, "length of the delamination", low=0.0),
    Parameter("beam_thickness", "m", 7.5e-3, "thickness of the remaining beam", low=0.0),
    Parameter("layer_thickness", "m", 2.5e-3, "thickness of the layer", low=0.0),
    Parameter("width", "m", 0.040, "width of the beam", low=0.0),
    Parameter("support", "m", 0.373, "distance of the supports from the middle; the mesh node nearest to it is taken",
              low=0.0),
    Parameter("young_modulus", "Pa", 70.0e9, "Young's modulus", low=0.0),
    Parameter("poisson_ratio", "1", 0.3, "Poisson's ratio", low=0.0, high=0.5),
    Parameter("density", "kg/m^3", 2700.0, "density", low=0.0),
)  # fmt: skip
SHAPE = ("length", "delamination", "beam_thickness", "layer_thickness", "support")
NOT_SHAPE = ("alpha", "beta", "beta_seconds", "f", "c_con", "dt", "f_dt", "s", "gap", "amplitude")


class DelaminatedBeam:
    """A beam with a delaminated layer in its middle: plane stress, large rotations, penalty contact (paper, section 4).

    Two kernels take the same parameters and give the same record. "full" is the explicit finite-element code: central
    differences over corotational quadrilaterals with incompatible modes, contact of nodes with segments. "reduced"
    moves the modes of the same mesh, with the stretch of the bent layer and an implicit contact, a hundred times
    faster; in it `dt` decides only whether the step is stable. "auto" is "reduced" for a search, whose leaders "full"
    confirms.

    The beam is held at two supports and driven by a prescribed displacement in the middle, quantity "displacement" at
    place "centre".

    Parameters
    ----------
    fidelity : "reduced" (default), "full" or "auto"
    contact_stiffness : "bulk" (default), f K l b / t, or "mass_dt", f m / (2 dt^2); see `contact.penalty`
    damper : "semi_implicit" (default): contact damping sees the mean of the velocities before and after a step;
        "lagged": the one before, as the paper's code does, which is unstable for large c_con. Full fidelity only
    clipped : whether the contact force cannot pull
    symmetric : whether the right half is computed, or the whole beam
    layer : "straight" (default), or "arched": its stress-free middle follows the gap's cubics
    shift : "free" (default): s is a parameter, or "tied": s = gap - g_max, and in its place `gap` is one: the gap in
        the middle, nominally 1 mm
    gap_table : [[place, gap], ...] instead of the cubics: places from 0 (or -1) to 1, the end of the delamination, and
        measured gaps [m], between which is interpolated; `s` is added, g_max has no say
    masters, slaves, outer, beam_rows, layer_rows : of the mesh, see `mesh.Counts`
    refinement : every element is cut into so many times so many
    modes, steps, parts, every : of the reduced kernel, see `reduction.Fineness`; those not given are of its lowest
        level
    tolerance : error of the reduced phase curve that is accepted: modes and steps rise until the estimated error, which
        the record states (`error_estimate`), is below it. Not given: the lowest level, no estimate
    balance : whether the record states, of one period, the work of the drive and what alpha, beta and contact took of
        it [J]; the period takes several times as long. Not in fidelity "reduced"
    settle_limit : periods after which a motion that does not return is taken as it is

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

    def __init__(
        self,
        fidelity: Fidelity = "reduced",
        contact_stiffness: Stiffness = "bulk",
        damper: Literal["semi_implicit", "lagged"] = "semi_implicit",
        clipped: bool = True,
        symmetric: bool = True,
        layer: Literal["straight", "arched"] = "straight",
        shift: Literal["free", "tied"] = "free",
        gap_table: Sequence[Sequence[float]] | None = None,
        masters: int = 56,
        slaves: int = 4,
        outer: int = 41,
        beam_rows: Sequence[float] = (5.0, 2.5),
        layer_rows: Sequence[float] = (1.0,),
        refinement: int = 1,
        modes: int | None = None,
        steps: int | None = None,
        parts: int | None = None,
        every: int | None = None,
        tolerance: float | None = None,
        balance: bool = False,
        settle_limit: int = SETTLE,
    ):
        for key, value, known in (
            ("fidelity", fidelity, ("reduced", "full", "auto")),
            ("contact_stiffness", contact_stiffness, ("bulk", "mass_dt")),
            ("damper", damper, ("semi_implicit", "lagged")),
            ("layer", layer, ("straight", "arched")),
            ("shift", shift, ("free", "tied")),
        ):
            if value not in known:
                raise CalibError(f"unknown {key} {value!r}{nearest(str(value), known)}; there are {', '.join(known)}")
        whole = {"masters": masters, "slaves": slaves, "outer": outer, "refinement": refinement}
        given = {"modes": modes, "steps": steps, "parts": parts, "every": every}
        given = {name: value for name, value in given.items() if value is not None}
        for key, value in {**whole, **given, "settle_limit": settle_limit}.items():
            if isinstance(value, bool) or not isinstance(value, int) or value < 1:
                raise CalibError(f"{key} is a whole number from 1 on, got {value!r}")
        for key, value in (("clipped", clipped), ("symmetric", symmetric), ("balance", balance)):
            if not isinstance(value, bool):
                raise CalibError(f"{key} is true or false, got {value!r}")
        if masters % 2:
            raise CalibError(f"masters is even, half of them on each side of the middle; got {masters}")
        for key, rows in (("beam_rows", beam_rows), ("layer_rows", layer_rows)):
            if not isinstance(rows, Sequence) or not rows or not all(map(_positive, rows)):
                raise CalibError(f"{key} is a list of positive heights, got {rows!r}")
        if tolerance is not None and not _positive(tolerance):
            raise CalibError(f"tolerance is above 0, such as 0.01; got {tolerance!r}")
        if damper == "lagged" and fidelity != "full":
            raise CalibError(
                "the reduced kernel takes contact damping implicitly; damper 'lagged' needs fidelity 'full', "
                f"not {fidelity!r}"
            )
        if balance and fidelity == "reduced":
            raise CalibError("an energy balance is of the full kernel; take fidelity 'full' or 'auto', or drop balance")
        self.fidelity = fidelity
        self.balance = balance
        self.contact_stiffness = contact_stiffness
        self.damper = damper
        self.clipped = clipped
        self.symmetric = symmetric
        self.layer = layer
        self.shift = shift
        self.gap_table = None if gap_table is None else _table(gap_table, symmetric)
        self.counts = Counts(masters, slaves, outer, tuple(beam_rows), tuple(layer_rows)).refined(refinement)
        pairs = self.counts.masters // 2 * slaves  # of a half
        if every is not None and pairs % every:
            raise CalibError(f"every divides the {pairs} elements of half the layer; {every} does not")
        line = (pairs + self.counts.outer) * (1 if symmetric else 2) + 1
        if fidelity != "reduced" and line > LONGEST:
            raise CalibError(
                f"a line of {line} nodes along the layer; fidelity {fidelity!r} takes {LONGEST} at most: lower "
                "refinement, masters, slaves or outer, or set symmetric = true"
            )
        self.levels = tuple(
            replace(level, **{"every": math.gcd(level.every, pairs), **given}) for level in LEVELS[layer]
        )
        self.steps_stated = steps is not None
        nominal = Geometry(arch=0.0, **{p.name: p.nominal for p in PARAMETERS if p.name in SHAPE})
        most = self.levels[0].modes  # finer levels are taken only where the tolerance asks for them
        freedoms = mesh(nominal, self.counts, symmetric).freedoms
        if fidelity != "full" and most >= freedoms:
            raise CalibError(f"{most} modes of a mesh with {freedoms} freedoms; take fewer modes or a finer mesh")
        self.tolerance = tolerance
        self.settle_limit = settle_limit
        self.shorter = 1.0
        dropped = ("s",) if shift == "tied" else ("gap",)
        self.parameters = tuple(p for p in PARAMETERS if p.name not in dropped)

    @property
    def confirming(self) -> "DelaminatedBeam | None":
        """The same in full fidelity, where the fidelity is "auto"."""
        if self.fidelity != "auto":
            return None
        other = object.__new__(DelaminatedBeam)
        other.__dict__.update({**self.__dict__, "fidelity": "full"})
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

    def run(self, values: Mapping[str, float], excitation: Excitation, laws: Sequence[BoundLaw], request) -> xr.Dataset:
        """Simulate; see `calib.modelling.model.Simulator` and `calib.modelling.model.Request`.

        Raises
        ------
        CalibError : an excitation that is not a harmonic displacement of the centre; an initial state of the wrong size
        """
        self._check(excitation, request)
        attrs = self._attrs(values, excitation)
        try:
            case = self._case(values, excitation, laws)
        except ValueError as error:
            return failed(BODIES, "diverged", str(error), **attrs)
        if case.step > case.stable:
            return failed(BODIES, "unstable step", case.why_unstable(), **attrs, **case.steps())
        attrs |= case.steps()
        motion, more = self._full(case, request) if self.fidelity == "full" else self._reduced(case, request)
        if motion.status != OK:
            return failed(BODIES, motion.status, motion.reason, **attrs)
        return self._record(case, motion, request, {**attrs, **more})

    def period_map(
        self, values: Mapping[str, float], excitation: Excitation, laws: Sequence[BoundLaw], phase: float = 0.0
    ) -> BeamMap:
        """Map of a period from `phase` on; see `calib.dynamics.contract.PeriodMap`.

        Raises
        ------
        CalibError : an excitation that is not a harmonic displacement of the centre
        ValueError : these values give no beam, or a step that is not stable
        """
        self._check(excitation)
        case = self._case(values, shifted(excitation, phase), laws)
        if case.step > case.stable:
            raise ValueError(case.why_unstable())
        if self.fidelity == "full":
            return BeamMap.of_full(case.full, case.structure, excitation, case.drive.amplitude)
        return BeamMap.of_reduced(
            lambda state, budget: case.reduced(self.levels[0], state, budget),
            modes_of(case.structure, self.levels[0].modes),
            excitation,
            case.drive.amplitude,
        )

    # --- putting a case together

    def _check(self, excitation: Excitation, request=None) -> None:
        if (excitation.quantity, excitation.place) not in self.excitations or not excitation.harmonic:
            given = f"{'recorded ' if excitation.recorded else ''}{excitation.quantity} at {excitation.place!r}"
            raise CalibError(f"delaminated_beam takes a harmonic {QUANTITY} at {PLACE!r}, got {given}")
        if request is not None and request.times is not None:
            raise CalibError("output times are for excitations without a period; ask for periods and samples instead")

    def _case(self, values: Mapping[str, float], excitation: Excitation, laws: Sequence[BoundLaw]) -> BeamCase:
        for name, value in values.items():
            if not math.isfinite(value):
                raise ValueError(f"parameter {name} is {value}")
        for p in self.parameters:
            if not p.low <= values[p.name] <= p.high:
                raise ValueError(f"parameter {p.name} is {values[p.name]:g}, outside [{p.low:g}, {p.high:g}]")
        held = {name: value for name, value in values.items() if name not in NOT_SHAPE}
        height = held.pop("g_max")
        arch = height if self.layer == "arched" else 0.0
        built = structure_of(tuple(sorted(held.items())), arch, self.counts, self.symmetric)
        critical = critical_step_of(built)
        step = values["f_dt"] * critical or values["dt"]
        step /= self.shorter
        if not step > 0.0:
            raise ValueError("the time step is 0 s; give dt, or f_dt as a share of the critical step, a positive value")
        count = math.ceil(excitation.period / step * (1.0 - 1e-12))
        step = excitation.period / count
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
            alpha=values["alpha"],
            beta=share * critical,
            critical=critical,
            stable=stable_step(critical, share),
            step=step,
            count=count,
            clearance=clearance(pairs, height, shift, laws, self.gap_table),
            stiffness=stiffness,
            damping=values["c_con"] * critical_damping(pairs, stiffness),
            drive=BeamDrive(excitation, values["amplitude"], values["alpha"], laws),
            lagged=self.damper == "lagged",
            clipped=self.clipped,
            laws=tuple(laws),
        )

    # --- from a case to a motion

    def _settled(self, engine, request) -> StationaryMotion:
        return stationary(engine, request.periods, request.samples, request.settle, self.settle_limit)

    def _full(self, case: BeamCase, request) -> tuple[StationaryMotion, dict]:
        """Run the full kernel; also the energy balance of a period, where it is asked for."""
        engine = case.full(request.initial_state, request.step_budget)
        motion = self._settled(engine, request)
        if not self.balance or motion.status != OK:
            return motion, {}
        balance = engine.balance(lambda displacement: elastic_energy(case.structure, displacement))
        return motion, {name: case.factor * energy for name, energy in balance.items()}

    def _reduced(self, case: BeamCase, request) -> tuple[StationaryMotion, dict]:
        """Run the reduced kernel at the level that the tolerance asks for; also that level, and its estimated error."""
        level = self.levels[0]
        engine = case.reduced(level, request.initial_state, request.step_budget)
        motion, more = self._settled(engine, request), {}
        if self.tolerance is not None and motion.status == OK:
            estimate, steps = math.nan, []
            for finer in self.levels[1:]:
                if motion.returns is None:
                    break
                better = self._settled(case.reduced(finer, engine.carried(finer.modes), request.step_budget), request)
                if better.status != OK or better.returns is None:
                    break
                steps.append(loop_difference(motion, better, request.samples))
                estimate = FACTOR * steps[-1]
                if estimate <= self.tolerance:
                    break
                level, motion = finer, better
                estimate = LAST * steps[-1] ** (1.0 - SHARE) * steps[-2:][0] ** SHARE
            more["error_estimate"] = estimate
        return motion, {"modes": level.modes, "steps_per_period": level.steps, "parts": level.parts, **more}

    def _attrs(self, values: Mapping[str, float], excitation: Excitation) -> dict:
        fidelity = "full" if self.fidelity == "full" else "reduced"
        return {
            "source": f"delaminated_beam, {fidelity}",
            "fidelity": fidelity,
            "place": excitation.place,
            "quantity": excitation.quantity,
            "phase": excitation.phase,
            "frequency": excitation.frequency,
            "amplitude": excitation.amplitude * values["amplitude"],
            "prescribed": prescription(["beam"]),
        }

    def _record(self, case: BeamCase, motion: StationaryMotion, request, attrs: dict) -> xr.Dataset:
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
            contact_force_max=case.factor * contact.force,
            penetration_max=contact.penetration,
            centre_impacts=len(contact.central) / request.periods,
            **attrs,
        )
        record = record.assign_coords(contact_place=("contact_place", case.place_of(contact.closed), {"units": "1"}))
        return record.assign(
            contact_force=("time", case.factor * motion.force, {"units": "N"}),
            contact_share=("contact_place", contact.closed, {"units": "1"}),
        )


def loop_difference(one: StationaryMotion, other: StationaryMotion, samples: int) -> float:
    """Root mean square difference of the layer's phase curves, over the second one's about its mean  [1].

    The mean of the squares of displacement and velocity, as the feature `phase_curve` has it; over the periods after
    which both return.
    """
    count = samples * min(math.lcm(one.returns or 1, other.returns or 1), len(one.samples) // samples)
    total = 0.0
    for channel in (1, 3):
        a, b = one.samples[:count, channel], other.samples[:count, channel]
        total += 0.5 * np.mean((a - b) ** 2) / max(np.var(b), 1e-300)
    return float(np.sqrt(total))


def _positive(value) -> bool:
    """Whether it is a number above 0."""
    return isinstance(value, int | float) and not isinstance(value, bool) and 0.0 < value < math.inf


def _table(rows: Sequence[Sequence[float]], symmetric: bool) -> np.ndarray:
    """Check a measured gap."""
    try:
        table = np.array(rows, dtype=float)
    except (TypeError, ValueError):
        table = np.zeros(0)
    if table.ndim != 2 or table.shape[1] != 2 or len(table) < 2 or not np.isfinite(table).all():
        raise CalibError("gap_table is a list of at least two pairs [place, gap]: place in [-1, 1] [1], gap [m]")
    if not (np.diff(table[:, 0]) > 0.0).all():
        raise CalibError("the places of gap_table must increase from pair to pair")
    if table[0, 0] not in (-1.0, 0.0) or table[-1, 0] != 1.0:
        raise CalibError(f"the places of gap_table go from 0 (or -1) to 1, got {table[0, 0]:g} to {table[-1, 0]:g}")
    if table[0, 0] < 0.0 and symmetric:
        raise CalibError("a gap_table from -1 to 1 is of the whole beam; set symmetric = false, or give its right half")
    return table
