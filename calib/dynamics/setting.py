"""Model, excitation, values and phase of the section, held while one or two parameters vary."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from calib.errors import CalibError, nearest
from calib.modelling.model import Model
from calib.modelling.orbit import PeriodMap
from calib.modelling.simulator import Simulator
from calib.records.excitation import Excitation
from calib.store.plain import plain

DRIVE = {"excitation.frequency": "frequency", "excitation.amplitude": "amplitude"}


@dataclass(frozen=True, eq=False)
class Setting:
    """A model under a harmonic excitation, ready for sections, sweeps, branches and basins.

    What varies is named: a parameter of the model, "excitation.frequency" [Hz] or "excitation.amplitude" [its unit].

    Attributes
    ----------
    model : whose simulator offers a period map
    excitation : harmonic
    values : of its parameters in SI; nominal ones stand in for those that it lacks
    phase : where in the period the section is taken, in [0, 1)  [1, in periods]
    """

    model: Model
    excitation: Excitation
    values: Mapping[str, float] = field(default_factory=dict)
    phase: float = 0.0

    @property
    def section_phase(self) -> float:
        """Phase of the excitation at the section  [rad]."""
        return self.excitation.phase + 2.0 * math.pi * self.phase

    def map(self, varied: Mapping[str, float] | None = None) -> PeriodMap:
        """Period map with other values (SI) of the parameters named.

        Raises
        ------
        CalibError : an unknown parameter, a simulator or an excitation without a period map
        ValueError : these values give nothing that could move
        """
        values, own = {**self.values, **(varied or {})}, self.excitation
        drive = replace(
            own,
            frequency=values.pop("excitation.frequency", own.frequency),
            amplitude=values.pop("excitation.amplitude", own.amplitude),
        )
        return self.model.period_map(values, drive, self.phase)

    def unit(self, name: str) -> str:
        """SI unit of what can vary.

        Raises
        ------
        CalibError : there is nothing of that name
        """
        if name in DRIVE:
            return "Hz" if DRIVE[name] == "frequency" else self.excitation.unit
        known = [*self.model.parameters, *DRIVE]
        if name not in known:
            raise CalibError(f"{name!r} cannot vary{nearest(name, known)}; this model has {', '.join(known)}")
        return self.model.parameters[name].unit

    def value(self, name: str) -> float:
        """Value (SI) at which a parameter is held.

        Raises
        ------
        CalibError : there is nothing of that name
        """
        self.unit(name)
        held = {**self.model.nominal, **self.values}
        return float(held[name]) if name in held else float(getattr(self.excitation, DRIVE[name]))

    def meaning(self, name: str) -> str:
        """Meaning of what varies."""
        if name in DRIVE:
            return f"{DRIVE[name]} of the excitation ({self.excitation.quantity})"
        return self.model.parameters[name].meaning

    def check(self, name: str, values: Sequence[float]) -> None:
        """Check values of what varies.

        Raises
        ------
        CalibError : not finite, or outside the parameter's bounds
        """
        unit, own = self.unit(name), self.model.parameters.get(name)
        bounds = f"in [{own.low:g}, {own.high:g}]" if own else "above 0"
        for value in values:
            inside = own.low <= value <= own.high if own else value > 0.0
            if not (inside and math.isfinite(value)):
                raise CalibError(f"expected finite values of {name!r} {bounds} {unit}, got {value:g}")

    def definition(self) -> dict[str, Any]:
        """All that determines the motions, as JSON takes it."""
        simulator, drive = self.model.simulator, self.excitation
        return plain(
            {
                "simulator": simulator.name,
                "options": _options(simulator),
                "effects": [[effect.name, effect.bodies] for effect in self.model.effects],
                "values": {**self.model.nominal, **self.values},
                "excitation": {k: getattr(drive, k) for k in ("place", "quantity", "frequency", "amplitude", "phase")},
                "phase": self.phase,
            }
        )


def _options(simulator: Simulator) -> dict[str, Any]:
    """What a simulator has of its options; neither its parameters, whose values stand beside, nor what it caches."""
    own = {name: value for name, value in vars(simulator).items() if name != "parameters" and _option(value)}
    kind = type(simulator)
    return {name: value for name, value in own.items() if not isinstance(getattr(kind, name, None), cached_property)}


def _option(value: Any) -> bool:
    """Whether an attribute of a simulator holds options of a study file: as they are, in arrays or in dataclasses."""
    if isinstance(value, Mapping):
        return all(_option(part) for part in value.values())
    if isinstance(value, list | tuple):
        return all(_option(part) for part in value)
    if is_dataclass(value) and not isinstance(value, type):
        return all(_option(getattr(value, part.name)) for part in fields(value))
    if isinstance(value, np.ndarray | np.generic):
        return value.dtype.kind in "biufU"
    return value is None or isinstance(value, str | int | float | bool)
