"""Model = Simulator + Effects, and what a simulator has to be."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import xarray as xr

from calib.errors import CalibError, nearest
from calib.modelling.effect import Effect, places_of
from calib.modelling.laws import PLAIN, SLOTS, BoundLaw
from calib.modelling.parameter import Parameter
from calib.records import INTERVAL, OK
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


class Simulator(Protocol):
    """What calibration needs of a simulator.

    To write one:

    1. `name`, the `bodies` whose motion it gives, its `parameters` (each with unit, nominal value and meaning) and the
       `sites` at which it takes laws (see `calib.modelling.laws`; "structure", "numerical" and "sensor" are served by
       the model and need not be listed).
    2. `run` returns a record (see `calib.records.record`): displacement and velocity over (body, time), time 0 at phase
       zero of the excitation, whole periods of the stationary motion; with an excitation that has a period also the
       stroboscopic section of the last 64 periods or more.
    3. A motion that diverges, an unstable step, a spent budget: a record with that status and a reason
       (`calib.records.record.failed`), not an exception. An excitation or option that it cannot take: CalibError.
    4. The same values give the same bits. Nothing random, no clock.
    5. Channels that the excitation prescribes stand in the attribute `prescribed` ("body.channel", comma between).
    6. It pickles, and runs in a child process.
    7. Optionally `excitations`, the pairs (quantity, place) it takes: a study file is then refused before any run.
    8. Optionally `period_map(values, excitation, laws, phase)`, from which sections, bifurcation diagrams, exponents,
       branches and basins are made; see `calib.dynamics.contract.PeriodMap`.
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
        events ("event_tolerance") divided by `factor`, and `numerics`, the set of those it can refine.

    `calib.testing.SimulatorSuite` checks all this.
    """

    name: str
    bodies: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    sites: frozenset[str]

    def run(
        self, values: Mapping[str, float], excitation: Excitation, laws: Sequence[BoundLaw], request: Request
    ) -> xr.Dataset:
        """Simulate; `values` holds every parameter of the simulator in SI."""
        ...


class Model:
    """A simulator with the effects it is extended by; immutable."""

    def __init__(self, simulator: Simulator, effects: Sequence[Effect] = ()):
        self.simulator = simulator
        self.effects = tuple(effects)
        self.parameters = {p.name: p for p in simulator.parameters}
        for effect in self.effects:
            self._check(effect)
            self.parameters |= {p.name: p for p in effect.parameters}
        self._check_initial()
        if self._confirming is not None:
            self._check_confirming(self._confirming)
        for site in {effect.site for effect in self.effects} - set(PLAIN):
            count = sum(effect.site == site for effect in self.effects)
            if count > SLOTS:
                raise CalibError(f"{count} effects act at {site!r}, at most {SLOTS} can; drop some of them")

    def _check(self, effect: Effect) -> None:
        reason = effect.offered(self.simulator)
        if reason:
            raise CalibError(
                f"effect {effect.name!r}: {reason}; choose another simulator or drop the effect from [model] effects"
            )
        for parameter in effect.parameters:
            if parameter.name in self.parameters:
                raise CalibError(f"effect {effect.name!r} brings {parameter.name!r}, which the model has already")

    def _check_initial(self) -> None:
        for name, (body, _) in self.initial.items():
            if name not in self.parameters or body not in self.bodies:
                what = f"parameter {name!r}" if name not in self.parameters else f"body {body!r}"
                raise CalibError(f"simulator {self.simulator.name!r} declares an initial state of an unknown {what}")

    @property
    def _confirming(self) -> Simulator | None:
        return getattr(self.simulator, "confirming", None)

    def _check_confirming(self, other: Simulator) -> None:
        for what in ("parameters", "bodies", "sites"):
            unlike = set(getattr(self.simulator, what)) ^ set(getattr(other, what, ()))
            if unlike:
                names = sorted({getattr(thing, "name", thing) for thing in unlike})
                raise CalibError(
                    f"simulator {self.simulator.name!r} cannot be confirmed by {getattr(other, 'name', other)!r}: they "
                    f"differ in the {what} {', '.join(names)}; both need the same"
                )

    @property
    def confirming(self) -> "Model | None":
        """The model whose simulator confirms what this one finds, with the same effects; None where none does."""
        return None if self._confirming is None else Model(self._confirming, self.effects)

    @property
    def name(self) -> str:
        """Name of the simulator and, after plus signs, of the effects."""
        return " + ".join([self.simulator.name, *(effect.name for effect in self.effects)])

    @property
    def bodies(self) -> tuple[str, ...]:
        """Bodies whose motion the simulator gives."""
        return self.simulator.bodies

    @property
    def initial(self) -> Mapping[str, tuple[str, str]]:
        """Parameters that set the initial state, each with the (body, channel) that it sets; empty without them."""
        return getattr(self.simulator, "initial", {})

    @property
    def nominal(self) -> dict[str, float]:
        """Nominal value of every parameter, in SI."""
        return {name: parameter.nominal for name, parameter in self.parameters.items()}

    def extended(self, *effects: Effect) -> "Model":
        """Return the model with more effects."""
        return Model(self.simulator, (*self.effects, *effects))

    def run(self, values: Mapping[str, float], excitation: Excitation, request: Request | None = None) -> xr.Dataset:
        """Simulate at `values` (SI; the nominal value stands in for what they lack).

        Raises
        ------
        CalibError : an unknown parameter, or an excitation that the simulator cannot take
        """
        values, request = self._complete(values), request or Request()
        own = self._own(values)
        begins = not excitation.harmonic or request.settle == 0
        laws = self._laws(values, own, begins)
        record = self._refined(values).run(own, excitation, laws, request)
        if record.attrs["status"] == OK:
            for effect in self._acting(values):
                if effect.site == "sensor":
                    record = effect.sense(record.assign_attrs({INTERVAL: request.interval}), values)
            record.attrs.pop(INTERVAL, None)
        stated = {name: value if math.isfinite(value) else None for name, value in values.items()}
        return record.assign_attrs(model=self.name, values=json.dumps(stated))

    def period_map(self, values: Mapping[str, float], excitation: Excitation, phase: float = 0.0):
        """Map of one period of a harmonic excitation at `values`; see `calib.dynamics.contract.PeriodMap`.

        Effects on sensors have no part in it: it is of the motion itself.

        Parameters
        ----------
        values : SI; the nominal value stands in for what they lack
        phase : where in the period the section is taken, in [0, 1)  [1, in periods]

        Raises
        ------
        CalibError : an unknown parameter, a simulator or an excitation without a period map, or an effect that is
            explicit in time
        ValueError : these values give nothing that could move
        """
        if not hasattr(self.simulator, "period_map"):
            raise CalibError(
                f"simulator {self.simulator.name!r} offers no period map, which sections, exponents, branches and "
                "basins are made from; see calib.dynamics.contract.PeriodMap"
            )
        if not 0.0 <= phase < 1.0:
            raise CalibError(f"a section's phase is in [0, 1) periods, got {phase}")
        values = self._complete(values)
        for effect in self._acting(values):
            if effect.transient:
                raise CalibError(f"effect {effect.name!r} is explicit in time, and no period is like the one before")
        own = self._own(values)
        return self._refined(values).period_map(own, excitation, self._laws(values, own, begins=False), phase)

    def _complete(self, values: Mapping[str, float]) -> dict[str, float]:
        """Fill `values` up with nominal ones."""
        for name in values:
            if name not in self.parameters:
                raise CalibError(
                    f"unknown parameter {name!r}; this model has {', '.join(self.parameters)}"
                    f"{nearest(name, self.parameters)}"
                )
        return {**self.nominal, **{name: float(value) for name, value in values.items()}}

    def _own(self, values: Mapping[str, float]) -> dict[str, float]:
        """Values of the simulator's parameters, as the effects on the structure change them."""
        own = {p.name: values[p.name] for p in self.simulator.parameters}
        for effect in self._acting(values):
            if effect.site == "structure":
                own = effect.restructure(own, values)
        return own

    def _refined(self, values: Mapping[str, float]) -> Simulator:
        """Return the simulator that the numerical effects put in the place of the model's."""
        simulator = self.simulator
        for effect in self._acting(values):
            if effect.site == "numerical":
                simulator = effect.refine(simulator, values)
        return simulator

    def _acting(self, values: Mapping[str, float]) -> list[Effect]:
        return [effect for effect in self.effects if not effect.at_null(values)]

    def _laws(self, values: Mapping[str, float], own: Mapping[str, float], begins: bool = True) -> tuple[BoundLaw, ...]:
        """Laws that act at these values; those explicit in time only where the motion `begins`."""
        numbers, places = {**values, **own}, places_of(self.simulator)
        acting = [effect for effect in self._acting(values) if effect.site not in PLAIN]
        return tuple(effect.bound(numbers, places) for effect in acting if begins or not effect.transient)
