"""Effect: a named physical or instrumental cause, absent at its null value."""

import math
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
import xarray as xr

from calib.errors import CalibError, nearest
from calib.modelling.laws import LAW_PARAMETERS, MAX_LAW_PARAMETERS, PYTHON_SITES, SITES, STATES, BoundLaw, Law
from calib.modelling.parameter import Parameter
from calib.modelling.simulator import Simulator
from calib.records.excitation import Excitation

ALL = None  # bodies: whatever the simulator has
PLACES = ("body", "support", "interface")
DRIVEN_BY = ("", "any", "harmonic")  # what an effect may need of the excitation
EFFECT_GROUPS = ("stiffness", "damping", "friction", "load", "contact", "structure", "drive", "instrument", "numerics")
GROUP_OF_SITE = {
    "force": "load", "gap": "contact", "contact": "contact", "restitution": "contact", "stop": "contact",
    "excitation": "drive", "structure": "structure", "numerical": "numerics", "sensor": "instrument",
    "response": "instrument",
}  # fmt: skip
SIZES = (0.01, 0.03, 0.1)  # typical sizes of an effect, in natural scales of its parameters


def places_of(simulator: object) -> Mapping[str, tuple[str, ...]]:
    """Bodies at each place of a simulator where laws act, as its attribute `places` states them; empty without it."""
    return getattr(simulator, "places", {})


@dataclass(frozen=True)
class Interface:
    """What a force law sees at an interface: clearance = gap + sum of factor times displacement of the bodies.

    Attributes
    ----------
    gap : parameter that is the clearance at rest  [m]
    factors : of the bodies' displacements; those of the two that meet are 1 and -1
    compliant : whether the clearance is negative in contact, zero otherwise
    """

    gap: str
    factors: Mapping[str, float]
    compliant: bool = False


def interfaces_of(simulator: object) -> Mapping[str, Interface]:
    """Interfaces of a simulator where laws act, as its attribute `interfaces` states them; empty without it."""
    return getattr(simulator, "interfaces", {})


@dataclass(frozen=True)
class Effect:
    """A law at a site with the parameters it takes, in their order.

    At the null values of its parameters the record is bit-identical to the one without the effect, because the law is
    dropped before the run.

    Attributes
    ----------
    equation : what is added, in plain text
    group : what it is, one of `EFFECT_GROUPS`, by which it is listed; not stated: by its site, of a force a load
    confused : names of effects that it tends to be mistaken for
    generalises : names of effects that it contains as special cases, or comes near to: a diagnosis tests it only where
        others show, and names these where they explain as much
    special_cases : of those that it contains exactly, name -> values of its own parameters at which it is that one, or
        names of the other's parameters; parameters that are not stated have no influence there. A diagnosis begins a
        fit there
    requires : apparatus without which it cannot act and which few laboratories have, such as "a controller"; "" for
        none. A diagnosis suspects it only where its candidates name it
    quantity : of the excitation without which it is absent, such as "force"; "" for none. A diagnosis suspects it only
        where a record has it
    drive : the excitation without which it is absent: "harmonic", as where its law is in proportion to the amplitude;
        "any", a harmonic or a recorded one; "" for none. A study has the effect, and a diagnosis suspects it, only
        where a record has such an excitation
    bodies : on which a force law acts; ALL leaves it to `place`
    place : where a force law acts where no bodies are named: "body" (on all bodies), "support", or "interface", the
        port between two bodies (see `calib.modelling.laws`); the simulator states which bodies are at a place
    borrowed : parameters of the simulator, whose values follow the effect's own in the law's p
    positive : those of `borrowed` that have to be above 0 where it acts
    changes : of a law of the structure, alternatives of parameters of the simulator that it changes, of which the first
        that the simulator has entirely is taken; of a numerical law, alternatives of what it refines; of a law of the
        stop, alternatives of contacts of which the simulator has one
    transient : whether the law is explicit in time: no motion under it is periodic. It acts on motions that begin:
        a motion that has settled under a harmonic excitation has no initial instant, and the law does not change it
    differentiable : whether the record has a usable derivative by the parameters at their null
    noise : whether the effect belongs to the noise of a record, so that the simulated record does not change
    natural : parameter -> multiples of its natural scale: by dimensional analysis from the displacement amplitude and
        the angular frequency (of a frequency in Hz, that of the drive). Of one without null, the values at which it
        is held in turn (not stated: at its nominal value); of one with null, typical departures from it, from zero
        where it is infinite (not stated: `SIZES`)
    guess : (record) -> parameter -> starting values, read off the measured record
    """

    name: str
    site: str
    law: Law
    parameters: tuple[Parameter, ...]
    meaning: str
    equation: str = ""
    group: str = ""
    confused: tuple[str, ...] = ()
    generalises: tuple[str, ...] = ()
    special_cases: Mapping[str, Mapping[str, str | float]] = field(default_factory=dict, hash=False)
    requires: str = ""
    quantity: str = ""
    drive: str = ""
    bodies: tuple[str, ...] | None = ALL
    place: str = "body"
    borrowed: tuple[str, ...] = ()
    positive: tuple[str, ...] = ()
    changes: tuple[tuple[str, ...], ...] = ()
    transient: bool = False
    differentiable: bool = True
    noise: bool = False
    natural: Mapping[str, tuple[float, ...]] = field(default_factory=dict, hash=False)
    guess: Callable[[xr.Dataset], dict[str, tuple[float, ...]]] | None = None
    cite: str = ""

    def __post_init__(self) -> None:
        name = self.name
        if self.site not in SITES:
            raise CalibError(f"effect {name!r} acts at {self.site!r}; sites are {', '.join(SITES)}")
        if not self.group:
            object.__setattr__(self, "group", GROUP_OF_SITE[self.site])
        if self.group not in EFFECT_GROUPS:
            raise CalibError(f"effect {name!r} is of group {self.group!r}; groups are {', '.join(EFFECT_GROUPS)}")
        if self.law.site != self.site:
            raise CalibError(f"effect {name!r} acts at {self.site!r}, but its law is one of {self.law.site!r}")
        if len(self.parameters) + len(self.borrowed) > MAX_LAW_PARAMETERS:
            count = len(self.parameters) + len(self.borrowed)
            raise CalibError(f"effect {name!r} has {count} parameters; a law takes {MAX_LAW_PARAMETERS}")
        if all(p.null is None for p in self.parameters):
            raise CalibError(f"effect {name!r} has no null value; give one of its parameters a null")
        if self.place not in PLACES or (self.place != "body" and self.site != "force"):
            raise CalibError(f"effect {name!r} at place {self.place!r}; force laws act at one of {', '.join(PLACES)}")
        if bool(self.changes) != (self.site in ("structure", "stop", "numerical")):
            raise CalibError(f"effect {name!r} at {self.site!r}: those at structure, stop, numerical state `changes`")
        if self.drive not in DRIVEN_BY:
            raise CalibError(f"effect {name!r} needs the drive {self.drive!r}; known are 'harmonic', 'any' and ''")
        for key in set(self.positive) - set(self.borrowed):
            raise CalibError(f"effect {name!r} needs {key!r} above 0, but does not borrow it; name it in `borrowed`")
        own = {p.name for p in self.parameters}
        for key, values in self.special_cases.items():
            if key not in self.generalises or not set(values) <= own:
                raise CalibError(
                    f"effect {name!r} has the special case {key!r} at {sorted(values)}; name it in `generalises`, and "
                    f"state parameters of its own: {sorted(own)}"
                )
        for key in self.natural:
            if key not in {p.name for p in self.parameters}:
                raise CalibError(f"effect {name!r} has natural sizes of {key!r}, which is no parameter of it")

    @property
    def null(self) -> dict[str, float]:
        """Values of its parameters at which the effect is absent."""
        return {p.name: p.null for p in self.parameters if p.null is not None}

    def at_null(self, values: Mapping[str, float]) -> bool:
        """Whether the effect is absent at these values."""
        return all(values[name] == null for name, null in self.null.items())

    def impossible(self, values: Mapping[str, float]) -> str:
        """Say which of its own and its borrowed values [SI] the effect cannot act at; "" where it can."""
        for p in self.parameters:
            value = values[p.name]
            if not p.admits(value):
                return f"{p.name} is {value:g}" + (f", outside {p.interval} {p.unit}" if math.isfinite(value) else "")
        for name in self.positive:
            if not values[name] > 0.0:
                return f"{name} is {values[name]:g}; effect {self.name!r} needs it above 0"
        return ""

    def undriven(self, excitations: Iterable[Excitation]) -> str:
        """Why the effect is absent under each of these excitations, "" where it acts under one."""
        known = list(excitations)
        if self.quantity and all(one.quantity != self.quantity for one in known):
            return f"it needs a {self.quantity}, by which no record is excited"
        if self.drive == "harmonic" and not any(one.harmonic for one in known):
            return "it needs a harmonic excitation, which no record has"
        if self.drive == "any" and not any(one.harmonic or one.recorded for one in known):
            return "it needs an excitation, and every record is a free decay"
        return ""

    def refusal(self, simulator: Simulator) -> str:
        """Why `simulator` cannot take the effect, "" where it can."""
        name = simulator.name
        own = {p.name for p in simulator.parameters}
        if self.site in PYTHON_SITES:
            return self._unchangeable(simulator, own)
        if not simulator.sites:
            return f"it acts at {self.site!r}, but simulator {name!r} takes no force laws"
        if self.site not in simulator.sites:
            return f"it acts at {self.site!r}, but simulator {name!r} takes laws at {sorted(simulator.sites)}"
        if self.law.states > getattr(simulator, "law_states", STATES):
            return f"simulator {name!r} takes no force laws with internal states"
        borrowed = [parameter for parameter in self.borrowed if parameter not in own]
        if borrowed:
            return f"it needs {', '.join(borrowed)}, which simulator {name!r} does not have"
        return self._unplaced(simulator)

    def _unchangeable(self, simulator: Simulator, own: Collection[str]) -> str:
        """Why the simulator, of these parameters, has nothing that the effect changes; "" where it has."""
        name, needed = simulator.name, " or ".join(", ".join(alternative) for alternative in self.changes)
        if self.site == "structure" and self._changed(own) is None:
            return f"it changes {needed}, which simulator {name!r} does not have"
        if self.site == "stop" and self._changed(getattr(simulator, "contacts", ())) is None:
            return f"it needs a rigid stop that contact {needed} can replace, which simulator {name!r} does not have"
        if self.site == "numerical" and self._changed(getattr(simulator, "numerics", ())) is None:
            return f"it refines {needed}, which simulator {name!r} cannot refine"
        return ""

    def _unplaced(self, simulator: Simulator) -> str:
        places = places_of(simulator)
        known = {*simulator.bodies, *(body for bodies in places.values() for body in bodies)}
        for body in self.bodies or ():
            if body not in known:
                return (
                    f"it acts on body {body!r}{nearest(body, known)}; simulator {simulator.name!r} has "
                    f"{', '.join(simulator.bodies)}"
                )
        if self.bodies is None and self.place != "body" and self.place not in places:
            return f"it acts at the {self.place}, which simulator {simulator.name!r} does not have"
        return ""

    def _changed(self, known: Collection[str]) -> tuple[str, ...] | None:
        """Return the first alternative of `changes` that is known entirely."""
        return next((names for names in self.changes if all(name in known for name in names)), None)

    def bound(self, values: Mapping[str, float], places: Mapping[str, tuple[str, ...]] | None = None) -> BoundLaw:
        """Return the law with its numbers taken from `values`, at the bodies that the simulator has at `places`."""
        names = [*(q.name for q in self.parameters), *self.borrowed]
        p = np.zeros(max(LAW_PARAMETERS, len(names)))
        p[: len(names)] = [values[name] for name in names]
        bodies = self.bodies
        if bodies is None and self.place != "body":
            bodies = (places or {})[self.place]
        return BoundLaw(self.site, self.law.function, p, bodies, self.law.states)

    def restructure(self, own: Mapping[str, float], values: Mapping[str, float]) -> dict[str, float]:
        """Return the simulator's values `own` as the effect changes them (site `structure`)."""
        names = self._changed(own) or ()
        new = self.law.function(tuple(own[name] for name in names), self._numbers(values))
        return {**own, **dict(zip(names, map(float, new), strict=True))}

    def substitute(self, simulator: Simulator, values: Mapping[str, float]) -> Simulator:
        """Return the simulator that is run in the place of `simulator` (sites `stop` and `numerical`)."""
        return self.law.function(simulator, self._numbers(values))

    def sense(self, record: xr.Dataset, values: Mapping[str, float]) -> xr.Dataset:
        """Return what the instruments make of `record` (sites `sensor` and `response`)."""
        return self.law.function(record, self._numbers(values))

    def _numbers(self, values: Mapping[str, float]) -> dict[str, float]:
        return {q.name: values[q.name] for q in self.parameters}
