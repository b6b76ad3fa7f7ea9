"""Options of the simulator `fmu` that name variables: parameters, outputs, the input, the initial state."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calib.errors import CalibError, nearest
from calib.modelling.parameter import Parameter
from calib.records import CHANNELS
from calib.records.excitation import UNITS as QUANTITIES
from calib.records.excitation import Excitation
from calib.simulators.fmu.description import FmuDescription, FmuInterface, read_description
from calib.simulators.fmu.units import VariableUnit
from calib.units import to_si

DERIVATIVES = {"displacement": 0, "velocity": 1, "acceleration": 2}  # key of `input`: of what it is driven by
RATES = {0: "m", 1: "m/s", 2: "m/s^2"}  # their units
FORCE = "force"
FREE_DECAY = "free decay"


@dataclass(frozen=True)
class ParameterVariable:
    """A variable that is set before a run, and the parameter that it is."""

    parameter: Parameter
    reference: int
    unit: VariableUnit


@dataclass(frozen=True)
class OutputVariable:
    """A variable that is a channel of a body.

    Attributes
    ----------
    si : SI unit of the channel
    """

    body: str
    channel: str
    reference: int
    unit: VariableUnit
    si: str


@dataclass(frozen=True)
class InputVariable:
    """A variable that follows the excitation or, for an `order` above 0, its derivative of this order."""

    reference: int
    order: int
    unit: VariableUnit


@dataclass(frozen=True)
class DrivenInput:
    """What the excitation of a record sets: the variables, and the quantity and place that it has to have."""

    quantity: str
    place: str
    variables: tuple[InputVariable, ...]


@dataclass(frozen=True)
class FmuUse:
    """An FMU, and what the options make of its variables."""

    fmu: FmuDescription
    interface: FmuInterface
    parameters: tuple[ParameterVariable, ...]
    outputs: tuple[OutputVariable, ...]
    input: DrivenInput | None
    initial: Mapping[str, tuple[str, str]]

    def driven(self, excitation: Excitation) -> tuple[InputVariable, ...]:
        """Variables that an excitation sets; none in a free decay, where they keep their start values."""
        return () if self.input is None or excitation.quantity == FREE_DECAY else self.input.variables


def fmu_use(
    path: Path,
    parameters: Sequence[str] | Mapping[str, Mapping[str, Any]],
    outputs: Mapping[str, Mapping[str, Any]],
    input: Mapping[str, Any] | None,
    interface: str | None,
    initial: Mapping[str, str] | None,
) -> FmuUse:
    """Read an FMU and the options that name its variables; see `calib.simulators.fmu.Fmu`.

    Raises
    ------
    CalibError : no FMU that can be run here, or options that do not fit it
    """
    fmu = read_description(path)
    exposed, recorded = exposed_parameters(parameters, fmu), recorded_outputs(outputs, fmu)
    names = [variable.parameter.name for variable in exposed]
    return FmuUse(
        fmu=fmu,
        interface=fmu.interface(interface),
        parameters=exposed,
        outputs=recorded,
        input=driven_input(input, fmu),
        initial=initial_state(initial, names, recorded),
    )


def exposed_parameters(
    stated: Sequence[str] | Mapping[str, Mapping[str, Any]], fmu: FmuDescription
) -> tuple[ParameterVariable, ...]:
    """Read the option `parameters`: names of variables, or a table of name -> {variable, unit, nominal}.

    Raises
    ------
    CalibError : no such parameter, or one without a unit or without a start value
    """
    if (
        isinstance(stated, str)
        or not isinstance(stated, Sequence | Mapping)
        or not all(isinstance(n, str) for n in stated)
    ):
        raise CalibError(f"parameters: expected a list of names or a table of tables, got {stated!r}")
    entries = stated if isinstance(stated, Mapping) else dict.fromkeys(stated, {})
    return tuple(_parameter(name, entry, fmu) for name, entry in entries.items())


def _parameter(name: str, entry: Any, fmu: FmuDescription) -> ParameterVariable:
    where = f"parameters.{name}"
    table = _table(entry, where, ("variable", "unit", "nominal"))
    variable = fmu.variable(table.get("variable", name), where, "parameter")
    if "@" in name:
        raise CalibError(f'{where}: "@" binds a value to a record; give a name without it, and state the variable')
    unit = fmu.unit(variable, table.get("unit"), where)
    if "nominal" in table:
        nominal = to_si(table["nominal"], unit.si)
    elif variable.start is not None:
        nominal = unit.to_si(variable.start)
    else:
        raise CalibError(f"{where}: {fmu.label} gives {variable.name!r} no start value; state nominal")
    ends = [unit.to_si(end) for end in (variable.low, variable.high) if end is not None]
    low = -math.inf if variable.low is None else min(ends)
    high = math.inf if variable.high is None else max(ends)
    parameter = Parameter(name, unit.si, nominal, variable.meaning, low=low, high=high)
    return ParameterVariable(parameter, variable.reference, unit)


def recorded_outputs(stated: Mapping[str, Mapping[str, Any]], fmu: FmuDescription) -> tuple[OutputVariable, ...]:
    """Read the option `outputs`: body -> channel -> name of a variable, or {variable, unit}.

    Raises
    ------
    CalibError : no such variable, a unit that is none of the channel, or bodies whose channels differ
    """
    expected = 'expected bodies with their channels, as in { mass = { displacement = "x", velocity = "v" } }'
    if not isinstance(stated, Mapping) or not stated or not all(isinstance(one, Mapping) for one in stated.values()):
        raise CalibError(f"outputs: {expected}, got {stated!r}")
    channels = list(next(iter(stated.values())))
    for body, table in stated.items():
        if sorted(table) != sorted(channels) or not channels:
            raise CalibError(
                f"outputs.{body}: all bodies have the same channels, expected {', '.join(channels) or 'one at least'}, "
                f"got {', '.join(table) or 'none'}"
            )
    return tuple(_output(body, channel, table[channel], fmu) for body, table in stated.items() for channel in channels)


def _output(body: str, channel: str, entry: Any, fmu: FmuDescription) -> OutputVariable:
    where = f"outputs.{body}.{channel}"
    table = _table(entry, where, ("variable", "unit"))
    variable = fmu.variable(_named(table, where), where)
    unit = fmu.unit(variable, table.get("unit"), where)
    si = CHANNELS.get(channel, unit.si)
    _check_dimension(unit, si, where)
    return OutputVariable(body, channel, variable.reference, unit, si)


def driven_input(stated: Mapping[str, Any] | None, fmu: FmuDescription) -> DrivenInput | None:
    """Read the option `input`: quantity, place, and the variables that take it or its derivatives.

    Raises
    ------
    CalibError : an unknown key or quantity, no variable, or one that is no input or has another dimension
    """
    if stated is None:
        return None
    if not isinstance(stated, Mapping):
        raise CalibError(
            f'input: expected a table with quantity = "force", place = "mass", force = "F", got {stated!r}'
        )
    quantity, place = stated.get("quantity"), stated.get("place")
    known = [name for name in QUANTITIES if name != FREE_DECAY]
    if quantity not in known:
        raise CalibError(
            f"input.quantity: expected one of {', '.join(known)}, got {quantity!r}{nearest(str(quantity), known)}"
        )
    if not isinstance(place, str) or not place:
        raise CalibError(f"input.place: expected the place of the records' excitation, such as 'base', got {place!r}")
    keys = (FORCE,) if quantity == FORCE else tuple(DERIVATIVES)
    named = [key for key in stated if key not in ("quantity", "place")]
    for key in named:
        if key not in keys:
            raise CalibError(f"input.{key}: a {quantity} sets {', '.join(keys)}, no {key}{nearest(key, keys)}")
    if not named:
        raise CalibError(f'input: name the variable that the {quantity} sets, as in {keys[0]} = "u"')
    return DrivenInput(quantity, place, tuple(_input(key, stated[key], fmu) for key in named))


def _input(key: str, entry: Any, fmu: FmuDescription) -> InputVariable:
    where = f"input.{key}"
    table = _table(entry, where, ("variable", "unit"))
    variable = fmu.variable(_named(table, where), where, "input")
    unit = fmu.unit(variable, table.get("unit"), where)
    order = DERIVATIVES.get(key, 0)
    _check_dimension(unit, "N" if key == FORCE else RATES[order], where)
    return InputVariable(variable.reference, order, unit)


def initial_state(
    stated: Mapping[str, str] | None, parameters: Iterable[str], outputs: Sequence[OutputVariable]
) -> dict[str, tuple[str, str]]:
    """Read the option `initial`: parameter -> "body.channel" whose value at the start it is.

    Raises
    ------
    CalibError : an unknown parameter, body or channel
    """
    if not isinstance(stated or {}, Mapping):
        raise CalibError(f'initial: expected parameters, as in {{ x0 = "mass.displacement" }}, got {stated!r}')
    names = list(parameters)
    known = [f"{output.body}.{output.channel}" for output in outputs]
    pairs = {}
    for name, target in (stated or {}).items():
        if name not in names:
            raise CalibError(f"initial.{name}: no such parameter{nearest(name, names)}; known are {', '.join(names)}")
        if target not in known:
            raise CalibError(
                f"initial.{name}: expected one of {', '.join(known)}, got {target!r}{nearest(str(target), known)}"
            )
        body, _, channel = target.rpartition(".")
        pairs[name] = (body, channel)
    return pairs


def _table(entry: Any, where: str, keys: tuple[str, ...]) -> Mapping[str, Any]:
    """Return an entry as a table; a text is the name of a variable."""
    table = {"variable": entry} if isinstance(entry, str) else entry
    if not isinstance(table, Mapping):
        raise CalibError(f"{where}: expected the name of a variable, or a table of {', '.join(keys)}, got {entry!r}")
    for key in table:
        if key not in keys:
            raise CalibError(f"{where}: unknown key {key!r}{nearest(key, keys)}; it takes {', '.join(keys)}")
    for key in ("variable", "unit"):
        if key in table and not isinstance(table[key], str):
            raise CalibError(f"{where}.{key}: expected a text, got {table[key]!r}")
    return table


def _named(table: Mapping[str, Any], where: str) -> str:
    if "variable" not in table:
        raise CalibError(f"{where}: name the variable of the FMU")
    return str(table["variable"])


def _check_dimension(unit: VariableUnit, si: str, where: str) -> None:
    if unit.si == si:
        return
    try:
        same = to_si(f"1 {unit.si}", si) == 1.0
    except CalibError:
        same = False
    if not same:
        raise CalibError(f"{where}: expected a variable in {si} or a unit of its dimension, got one in {unit.si}")
