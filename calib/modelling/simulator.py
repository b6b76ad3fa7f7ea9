"""The contract of a simulator, and the request that it answers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import xarray as xr

from calib.errors import CalibError
from calib.modelling.laws import BoundLaw
from calib.modelling.orbit import PeriodMap
from calib.modelling.parameter import Parameter
from calib.records.excitation import Excitation


@dataclass(frozen=True, eq=False)
class Request:
    """What to compute, and when to give up.

    Attributes
    ----------
    periods : periods of the stationary motion to record (excitation with a period)
    samples : samples per period
    times : (n,) output times [s] instead, for an excitation without a period
    settle : periods to drop first; None leaves it to the simulator, which goes by convergence of its section
    initial_state : where to start, in the simulator's own state, as the variable `state` of a record has it; None is
        rest
    near : whether the initial state lies near the stationary motion that is sought: a simulator may then go there by a
        shorter way than by waiting, and keep no longer section than the periods recorded
    interval : between the samples of the instruments [s], which some sensors show; None is that of the record
    step_budget : steps after which the run ends with status "step budget"; steps, not seconds, so that the same values
        always give the same record
    """

    periods: int = 6
    samples: int = 400
    times: np.ndarray | None = None
    settle: int | None = None
    initial_state: np.ndarray | None = None
    near: bool = False
    interval: float | None = None
    step_budget: int = 50_000_000

    def output_times(self, recorded: np.ndarray | None) -> np.ndarray:
        """Output times (n,) [s] of an excitation without a period: the `times`, else those of a recorded input.

        Raises
        ------
        CalibError : neither is there (a free decay), fewer than two, or they do not increase
        """
        times = recorded if self.times is None else self.times
        if times is None:
            raise CalibError("a free decay has no period: state its output times [s] (Request.times)")
        times = np.asarray(times, dtype=float)
        if times.size < 2 or not (np.diff(times) > 0.0).all():
            raise CalibError("output times [s] must be at least two, and increase")
        return times


class Simulator(Protocol):
    """What calibration needs of a simulator.

    To write one:

    1. `name`, the `bodies` whose motion it gives, its `parameters` (each with unit, nominal value and meaning) and the
       `sites` at which it takes laws (see `calib.modelling.laws`; those in plain Python are served by the model and
       need not be listed).
    2. `run` returns a record (see `calib.records.record`): displacement and velocity over (body, time), time 0 at phase
       zero of the excitation, whole periods of the stationary motion; with an excitation that has a period also the
       stroboscopic section of the last 64 periods or more; where a study asks for fewer of a slow program, of those.
    3. A motion that diverges, an unstable step, a spent budget: a record with that status and a reason
       (`calib.records.record.failed`), not an exception. An excitation or option that it cannot take: CalibError.
    4. The same values give the same bits. Nothing random, no clock.
    5. Channels that the excitation prescribes stand in the attribute `prescribed` ("body.channel", comma between).
    6. It pickles, and runs in a child process.
    7. Optionally `excitations`, the pairs (quantity, place) it takes: a study file is then refused before any run.
    8. Optionally `period_map(values, excitation, laws, phase)`, from which sections, bifurcation diagrams, exponents,
       branches and basins are made; see `MappedSimulator` and `calib.modelling.orbit.PeriodMap`.
    9. Optionally `confirming`: a simulator of the same parameters, bodies and sites, of higher fidelity and cost. A
       search runs with this one; its leaders are simulated again with the confirming one before one of them is called
       the best (see `calib.study.Confirmation`). Absent or None: nothing is confirmed.
    10. Optionally `places`, a mapping of "body", "support", "interface" to names of bodies: "body", those on which an
        effect is likely; "support", those that are held from outside; "interface", the name of a *port* between two
        bodies, no body itself, at which force laws see the clearance (see `calib.modelling.laws`). Absent: effects
        that act at a support or an interface are not offered.
    11. Optionally `law_states`, how many internal states a force law may have (0: such laws are refused before any
        run). Absent: as many as a law can.
    12. Optionally `initial`, a mapping of the parameters that set the initial state to the (body, channel) that each
        sets, such as {"initial_velocity": ("mass", "velocity")}: a record's nuisance "initial_state" solves for them.
    13. Optionally `finer(what, factor)`, the same simulator with a time step (what = "time_step") or a tolerance of its
        events ("event_tolerance") divided by `factor`, and `numerics`, the set of those it can refine; see
        `RefinableSimulator`.
    14. Optionally `placed(study, results, modules)`, the same simulator, told the folder to which files that its
        options name are relative, the folder of the results, in which it may keep files, and the folder of modules of
        the study (None: all are on Python's path); called when a study is read.
    15. Optionally `code`, a mapping of names of files, programs and modules that it uses to their SHA-256 or version:
        trials made with others no longer count when a study goes on.
    16. Optionally `incidental`, the names of options that have no influence on records: they may change when a study
        goes on.
    17. Optionally `check(excitation, request)`, which raises CalibError for what it cannot compute: a study is then
        refused when it is read.
    18. Optionally `afresh()`, the same simulator answering nothing from a cache: the best point is evaluated by it.
    19. Optionally `dry_run(values, excitation, request)`, which gives a `calib.modelling.dry_run.DryRun`: it is made
        once before a search begins, which ends there where it fails.
    20. Optionally `cores`, the cores that one run uses. Absent: 1.
    21. Optionally `ignored`, a mapping of those of "frequency", "amplitude", "phase", "value" (of a recorded input) and
        "place" (with the quantity) that have no influence on its records to what a user can do about it: a study is
        then refused whose records differ in one of them, or that states a phase in vain.
    22. Optionally `check_values(values, excitation, request)`, which raises CalibError for values at which it can
        compute nothing, without running: a study is refused whose starting values, or ends of windows, are such ones.
    23. Optionally `remarks`, sentences on what its options leave open: told as a search begins, and kept with its
        result.
    24. Optionally `title`, what a report calls it, such as the program that it runs. Absent: its name.
    25. Optionally `compliant(contact)`, the same simulator with a compliant contact of that name in the place of its
        rigid stop, and `contacts`, the set of those that it has; see `StoppedSimulator`.
    26. Optionally `interfaces`, a mapping of the ports of `places` to a `calib.modelling.effect.Interface`, which says
        how the clearance there follows from the displacements. Absent: a force law that is searched as a free function
        is not searched there.

    `calib.testing.SimulatorSuite` checks all this.
    """

    @property
    def name(self) -> str:
        """Name in study files and records."""
        ...

    @property
    def bodies(self) -> tuple[str, ...]:
        """Bodies whose motion it gives."""
        ...

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters, all of which `run` is given."""
        ...

    @property
    def sites(self) -> frozenset[str]:
        """Sites at which it takes laws."""
        ...

    def run(
        self, values: Mapping[str, float], excitation: Excitation, laws: Sequence[BoundLaw], request: Request
    ) -> xr.Dataset:
        """Simulate; `values` holds every parameter of the simulator in SI."""
        ...


@runtime_checkable
class MappedSimulator(Simulator, Protocol):
    """A simulator that offers its period map."""

    def period_map(
        self, values: Mapping[str, float], excitation: Excitation, laws: Sequence[BoundLaw], phase: float
    ) -> PeriodMap:
        """Map of one period of a harmonic excitation, from `phase` in [0, 1) on  [1, in periods]."""
        ...


class RefinableSimulator(Simulator, Protocol):
    """A simulator whose time step or tolerance of events can be refined."""

    @property
    def numerics(self) -> frozenset[str]:
        """What can be refined: of "time_step" and "event_tolerance"."""
        ...

    def finer(self, what: str, factor: float) -> "RefinableSimulator":
        """Return the same simulator with its time step, or its tolerance of events, divided by `factor`."""
        ...


class StoppedSimulator(Simulator, Protocol):
    """A simulator whose rigid stop a compliant contact can replace."""

    @property
    def contacts(self) -> frozenset[str]:
        """Names of laws of a compliant contact; empty without a rigid stop."""
        ...

    def compliant(self, contact: str) -> Simulator:
        """Return the same simulator with such a contact, whose parameters it has beside or instead of Newton's."""
        ...
