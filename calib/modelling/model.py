"""Model = Simulator + Effects."""

import json
import math
from collections.abc import Mapping, Sequence
from typing import cast

import xarray as xr

from calib.errors import CalibError, nearest
from calib.modelling.dry_run import DryRun
from calib.modelling.effect import Effect, places_of
from calib.modelling.laws import PYTHON_SITES, BoundLaw
from calib.modelling.orbit import PeriodMap
from calib.modelling.parameter import Parameter
from calib.modelling.simulator import MappedSimulator, Request, Simulator
from calib.modelling.simulator_check import as_record, check_simulator
from calib.records import INTERVAL, OK, failed
from calib.records.excitation import Excitation


class Model:
    """A simulator with the effects it is extended by; immutable."""

    def __init__(self, simulator: Simulator, effects: Sequence[Effect] = ()) -> None:
        check_simulator(simulator)
        self.simulator = simulator
        self.effects = tuple(effects)
        self.parameters = {p.name: p for p in simulator.parameters}
        for effect in self.effects:
            self._check(effect)
            self.parameters |= {p.name: p for p in effect.parameters}
        self._check_initial()
        if self._confirming is not None:
            self._check_confirming(self._confirming)

    def _check(self, effect: Effect) -> None:
        reason = effect.refusal(self.simulator)
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
    def title(self) -> str:
        """Its name, the simulator called as it calls itself in `title`, such as by the program that it runs."""
        return " + ".join([getattr(self.simulator, "title", self.simulator.name), *(e.name for e in self.effects)])

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

    def parameter(self, name: str) -> Parameter:
        """Return a parameter by its name.

        Raises
        ------
        CalibError : there is no such parameter
        """
        if name not in self.parameters:
            known = ", ".join(self.parameters) or "no parameters"
            raise CalibError(f"unknown parameter {name!r}{nearest(name, self.parameters)}; this model has {known}")
        return self.parameters[name]

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
        impossible = self._impossible(values)
        if impossible:
            record = failed(self.bodies, "impossible value", impossible)
        else:
            record = self._simulated(values, excitation, request)
        if record.attrs["status"] == OK:
            for effect in self._acting_at("sensor", values):
                record = effect.sense(record.assign_attrs({INTERVAL: request.interval}), values)
            record.attrs.pop(INTERVAL, None)
        stated = {name: value if math.isfinite(value) else None for name, value in values.items()}
        return record.assign_attrs(model=self.name, values=json.dumps(stated))

    def _simulated(self, values: Mapping[str, float], excitation: Excitation, request: Request) -> xr.Dataset:
        """Record of the motion at values that are possible, without the effects on its sensors."""
        own = self._own(values)
        begins = not excitation.harmonic or request.settle == 0
        laws = self._laws(values, own, begins)
        simulator, own = self._replaced(values, own)
        unserved = self._unserved(simulator, laws)
        if unserved:
            return failed(simulator.bodies, "impossible value", unserved)
        return as_record(simulator.run(own, excitation, laws, request), simulator)

    def measured_response(self, record: xr.Dataset, values: Mapping[str, float]) -> xr.Dataset:
        """Return a simulated frequency response (see `calib.records.response`) as a measurement at `values` has it.

        Raises
        ------
        CalibError : an unknown parameter
        """
        values = self._complete(values)
        for effect in self._acting_at("response", values):
            record = effect.sense(record, values)
        return record

    def afresh(self) -> "Model":
        """Return the model whose simulator answers nothing from a cache."""
        afresh = getattr(self.simulator, "afresh", None)
        return self if afresh is None else Model(afresh(), self.effects)

    def check_values(self, values: Mapping[str, float], excitation: Excitation, request: Request) -> None:
        """Let the simulator refuse values at which it can compute nothing, if it looks at that.

        Raises
        ------
        CalibError : an unknown parameter, or values that the simulator does not take
        """
        check = getattr(self.simulator, "check_values", None)
        if check is not None:
            check(self._own(self._complete(values)), excitation, request)

    def dry_run(self, values: Mapping[str, float], excitation: Excitation, request: Request) -> DryRun:
        """Run the simulator once, as `run` does but without effects on its sensors, and say what it did.

        Raises
        ------
        CalibError : as `run`
        """
        tried = getattr(self.simulator, "dry_run", None)
        if tried is None:
            return DryRun(self.run(values, excitation, request))
        answer: DryRun = tried(self._own(self._complete(values)), excitation, request)
        return answer

    def period_map(self, values: Mapping[str, float], excitation: Excitation, phase: float = 0.0) -> PeriodMap:
        """Map of one period of a harmonic excitation at `values`; see `calib.modelling.orbit.PeriodMap`.

        Effects on sensors do not change it: it maps the motion, not its record.

        Parameters
        ----------
        values : SI; the nominal value stands in for what they lack
        phase : where in the period the section is taken, in [0, 1)  [1, in periods]

        Raises
        ------
        CalibError : an unknown parameter, a simulator or an excitation without a period map, or an effect that is
            explicit in time
        ValueError : these values give nothing that could move, or an effect cannot act at them
        """
        _mapped(self.simulator)
        if not 0.0 <= phase < 1.0:
            raise CalibError(f"a section's phase is in [0, 1) periods, got {phase}")
        values = self._complete(values)
        for effect in self._acting(values):
            if effect.transient:
                raise CalibError(f"effect {effect.name!r} is explicit in time, and no period is like the one before")
        impossible = self._impossible(values)
        if impossible:
            raise ValueError(impossible)
        own = self._own(values)
        laws = self._laws(values, own, begins=False)
        simulator, own = self._replaced(values, own)
        unserved = self._unserved(simulator, laws)
        if unserved:
            raise CalibError(unserved)
        return _mapped(simulator).period_map(own, excitation, laws, phase)

    def _complete(self, values: Mapping[str, float]) -> dict[str, float]:
        """Fill `values` up with nominal ones."""
        for name in values:
            self.parameter(name)
        return {**self.nominal, **{name: float(value) for name, value in values.items()}}

    def _impossible(self, values: Mapping[str, float]) -> str:
        """Say which value [SI] an effect that is present cannot act at; "" where there is none."""
        return next(filter(None, (effect.impossible(values) for effect in self._acting(values))), "")

    def _own(self, values: Mapping[str, float]) -> dict[str, float]:
        """Values of the simulator's parameters, as the effects on the structure change them."""
        own = {p.name: values[p.name] for p in self.simulator.parameters}
        for effect in self._acting_at("structure", values):
            own = effect.restructure(own, values)
        return own

    def _replaced(self, values: Mapping[str, float], own: dict[str, float]) -> tuple[Simulator, dict[str, float]]:
        """Return the simulator that effects on stop and numerics put in the place of the model's, and its values.

        own : values of the parameters of the model's simulator
        """
        simulator = self.simulator
        for site in ("stop", "numerical"):
            for effect in self._acting_at(site, values):
                simulator = effect.substitute(simulator, values)
        if simulator is self.simulator:
            return simulator, own
        return simulator, {p.name: own.get(p.name, values.get(p.name, p.nominal)) for p in simulator.parameters}

    def _unserved(self, simulator: Simulator, laws: Sequence[BoundLaw]) -> str:
        """Why a simulator in the place of the model's cannot take the laws that the model's takes; "" where it can."""
        sites = sorted({law.site for law in laws} - set(simulator.sites)) if simulator is not self.simulator else []
        if not sites:
            return ""
        stops = [effect.name for effect in self.effects if effect.site == "stop"]
        return f"an effect at {sites[0]!r} and {stops[0]!r} exclude one another; leave one of them at its null value"

    def _acting(self, values: Mapping[str, float]) -> list[Effect]:
        return [effect for effect in self.effects if not effect.at_null(values)]

    def _acting_at(self, site: str, values: Mapping[str, float]) -> list[Effect]:
        return [effect for effect in self._acting(values) if effect.site == site]

    def _laws(self, values: Mapping[str, float], own: Mapping[str, float], begins: bool = True) -> tuple[BoundLaw, ...]:
        """Laws that act at these values; those explicit in time only where the motion `begins`."""
        numbers, places = {**values, **own}, places_of(self.simulator)
        acting = [effect for effect in self._acting(values) if effect.site not in PYTHON_SITES]
        return tuple(effect.bound(numbers, places) for effect in acting if begins or not effect.transient)


def _mapped(simulator: Simulator) -> MappedSimulator:
    """Return the simulator where it offers a period map."""
    if not callable(getattr(simulator, "period_map", None)):  # isinstance of a Protocol takes a fifth of a map's time
        raise CalibError(
            f"simulator {simulator.name!r} offers no period map, which sections, exponents, branches and basins are "
            "made from; see calib.modelling.orbit.PeriodMap"
        )
    return cast("MappedSimulator", simulator)
