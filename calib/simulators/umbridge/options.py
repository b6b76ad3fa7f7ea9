"""Options of the simulator `umbridge`: what the model is given, and what its answer means."""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from calib.errors import CalibError, nearest
from calib.modelling.parameter import Parameter
from calib.modelling.simulator import Request
from calib.records import CHANNELS
from calib.records.excitation import UNITS as QUANTITIES
from calib.records.excitation import Excitation
from calib.units import coherent, to_si

NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*")  # of a quantity, before its unit
TOLD_SETTLE_PERIODS = 100  # that the model is told to drop, where the study does not say how many
SCALARS = (
    "excitation.frequency", "excitation.amplitude", "excitation.phase",
    "request.periods", "request.samples", "request.settle",
)  # fmt: skip
VECTORS = ("excitation.time", "excitation.value", "request.times")
FREE_DECAY = "free decay"


@dataclass(frozen=True)
class ScaledParameter:
    """A parameter, and the factor from the unit in which the model takes it to SI."""

    parameter: Parameter
    factor: float


@dataclass(frozen=True)
class OutputChannel:
    """Where a channel of a body stands in the answer.

    Attributes
    ----------
    output : index of the output vector
    first : index of the first sample in it; None: the vector is the channel
    factor : from its unit to SI
    """

    body: str
    channel: str
    output: int
    first: int | None
    factor: float
    si: str


@dataclass(frozen=True)
class OutputTimes:
    """When the samples of the answer are, where it is not at the requested times: an output vector, or even steps.

    Attributes
    ----------
    output, factor : index of the vector of times, and the factor from its unit to s
    start, step : of even steps  [s]
    """

    output: int | None = None
    factor: float = 1.0
    start: float = 0.0
    step: float = 0.0


def scaled_parameters(stated: Any) -> tuple[ScaledParameter, ...]:
    """Read the option `parameters`: name -> nominal value, with the unit in which the model takes it.

    Raises
    ------
    CalibError : no such table, or a value that cannot be read
    """
    if not isinstance(stated, Mapping):
        raise CalibError(f'parameters: expected nominal values, as in {{ stiffness = "4 kN/m" }}, got {stated!r}')
    return tuple(_scaled(name, nominal) for name, nominal in stated.items())


def _scaled(name: str, nominal: Any) -> ScaledParameter:
    where = f"parameters.{name}"
    if "@" in name or name in (*SCALARS, *VECTORS):
        raise CalibError(f"{where}: this name has a meaning of its own; choose another")
    if isinstance(nominal, bool) or not isinstance(nominal, str | int | float):
        raise CalibError(f'{where}: expected a nominal value with its unit, as in "4 kN/m", got {nominal!r}')
    unit = NUMBER.sub("", nominal, count=1) if isinstance(nominal, str) else ""
    try:
        si = coherent(unit)
        factor = 1.0 if unit in ("", "1") else to_si(f"1 {unit}", si)
        value = to_si(nominal, si)
    except CalibError as error:
        raise CalibError(f"{where}: {error}") from error
    if not math.isfinite(value):
        raise CalibError(f"{where}: expected a finite nominal value, got {nominal!r}")
    return ScaledParameter(Parameter(name, si, value, f"input {name} of the model"), factor)


def check_inputs(blocks: Any, parameters: Sequence[str]) -> None:
    """Refuse `inputs` that are no list of blocks of known names and numbers, or lack a parameter.

    Raises
    ------
    CalibError : with the block
    """
    if isinstance(blocks, str) or not isinstance(blocks, Sequence):
        raise CalibError(f'inputs: expected the input vectors, as in [["stiffness", "gap"]], got {blocks!r}')
    known = (*parameters, *SCALARS)
    for index, block in enumerate(blocks):
        if isinstance(block, str):
            if block not in VECTORS:
                raise CalibError(
                    f"inputs[{index}]: expected a list of names, or one of {', '.join(VECTORS)}, "
                    f"got {block!r}{nearest(block, VECTORS)}"
                )
            continue
        if not isinstance(block, Sequence):
            raise CalibError(f"inputs[{index}]: expected a list of names and numbers, got {block!r}")
        for entry in block:
            number = isinstance(entry, int | float) and not isinstance(entry, bool)
            if not number and entry not in known:
                raise CalibError(
                    f"inputs[{index}]: expected a number or one of {', '.join(known)}, "
                    f"got {entry!r}{nearest(str(entry), known)}"
                )
    used = {entry for block in blocks if not isinstance(block, str) for entry in block}
    for name in parameters:
        if name not in used:
            raise CalibError(f"inputs: the parameter {name!r} stands in no block; add it, or drop it from parameters")


def output_channels(stated: Any) -> tuple[OutputChannel, ...]:
    """Read the option `outputs`: body -> channel -> index of an output vector, or {output, first, unit}.

    Raises
    ------
    CalibError : no such table, an unknown key or unit, or bodies whose channels differ
    """
    expected = "expected bodies with their channels, as in { mass = { displacement = 0, velocity = 1 } }"
    if not isinstance(stated, Mapping) or not stated or not all(isinstance(one, Mapping) for one in stated.values()):
        raise CalibError(f"outputs: {expected}, got {stated!r}")
    names = sorted(next(iter(stated.values())))
    for body, table in stated.items():
        if sorted(table) != names or not names:
            raise CalibError(f"outputs.{body}: all bodies have the same channels; {expected}")
    return tuple(_channel(body, channel, table[channel]) for body, table in stated.items() for channel in table)


def _channel(body: str, channel: str, entry: Any) -> OutputChannel:
    where = f"outputs.{body}.{channel}"
    table = _table(entry, where, ("output", "first", "unit"))
    unit = table.get("unit", CHANNELS.get(channel))
    if not isinstance(unit, str):
        raise CalibError(f'{where}: state the unit, as in {{ output = 0, unit = "m/s^2" }}')
    si = CHANNELS.get(channel) or coherent(unit)
    try:
        factor = 1.0 if unit in ("", "1") else to_si(f"1 {unit}", si)
    except CalibError as error:
        raise CalibError(f"{where}.unit: {error}") from error
    first = table.get("first")
    return OutputChannel(
        body, channel, _index(table, where), None if first is None else _count(first, where), factor, si
    )


def output_times(stated: Any) -> OutputTimes | None:
    """Read the option `times`: "requested" (None), {output, unit}, or {start, step}.

    Raises
    ------
    CalibError : something else
    """
    if stated == "requested":
        return None
    if isinstance(stated, str) or not isinstance(stated, int | Mapping):
        raise CalibError(f'times: expected "requested", {{ output = 2 }} or {{ step = "1 ms" }}, got {stated!r}')
    if isinstance(stated, Mapping) and "step" in stated:
        table = _table(stated, "times", ("start", "step"))
        step = seconds(table["step"], "times.step")
        if step == 0.0:
            raise CalibError(f"times.step: expected a time above 0 s, got {table['step']!r}")
        return OutputTimes(start=seconds(table.get("start", 0.0), "times.start"), step=step)
    table = _table(stated, "times", ("output", "unit"))
    return OutputTimes(output=_index(table, "times"), factor=seconds(f"1 {table.get('unit', 's')}", "times.unit"))


def seconds(stated: str | float, where: str) -> float:
    """Read a time of an option [s], 0 or above.

    Raises
    ------
    CalibError : it is none
    """
    try:
        time = to_si(stated, "s")
    except CalibError as error:
        raise CalibError(f"{where}: {error}") from error
    if not 0.0 <= time < math.inf:
        raise CalibError(f"{where}: expected a time of 0 s or more, got {stated!r}")
    return time


def taken_excitation(stated: Any, names: Sequence[str], bodies: Sequence[str]) -> frozenset[tuple[str, str]]:
    """Read the option `excitation`: {quantity, place, built_in}; pairs (quantity, place) that the model takes.

    Raises
    ------
    CalibError : an unknown quantity, or an excitation that the model is told nothing of
    """
    decays = frozenset((FREE_DECAY, body) for body in bodies)
    if stated is None:
        return decays
    if not isinstance(stated, Mapping):
        raise CalibError(f'excitation: expected {{ quantity = "force", place = "mass" }}, got {stated!r}')
    for key in stated:
        if key not in ("quantity", "place", "built_in"):
            raise CalibError(f"excitation: unknown key {key!r}; it takes quantity, place, built_in")
    quantity, place = stated.get("quantity"), stated.get("place")
    if quantity not in list(QUANTITIES):
        raise CalibError(
            f"excitation.quantity: expected one of {', '.join(QUANTITIES)}, "
            f"got {quantity!r}{nearest(str(quantity), QUANTITIES)}"
        )
    if not isinstance(place, str) or not place:
        raise CalibError(f"excitation.place: expected the place of the records' excitation, got {place!r}")
    told = any(name.startswith("excitation.") for name in names)
    if quantity != FREE_DECAY and not told and stated.get("built_in") is not True:
        raise CalibError(
            f"excitation: neither inputs nor config tell the model of the {quantity}; name what it takes of "
            f"{', '.join((*SCALARS[:3], *VECTORS[:2]))}, or state built_in = true where it has the records' excitation"
        )
    return decays | {(quantity, place)}


def named_in(config: Any) -> Iterator[str]:
    """Yield the texts in a configuration that stand for something of the excitation or the request."""
    if isinstance(config, str):
        yield from [config] if config in (*SCALARS, *VECTORS) else []
    elif isinstance(config, Mapping | list):
        for value in config.values() if isinstance(config, Mapping) else config:
            yield from named_in(value)


def filled(config: Any, given: Mapping[str, Any]) -> Any:
    """Return a configuration with these texts replaced by what they stand for."""
    if isinstance(config, str):
        return given[config] if config in (*SCALARS, *VECTORS) else config
    if isinstance(config, Mapping):
        return {key: filled(value, given) for key, value in config.items()}
    return [filled(value, given) for value in config] if isinstance(config, list) else config


def block_values(block: Any, values: Mapping[str, float], given: Mapping[str, Any]) -> list[float]:
    """Numbers of an input vector; `values` are those of the parameters, in the units of the model."""
    if isinstance(block, str):
        return list(given[block])
    return [
        float(entry) if isinstance(entry, int | float) else float(values[entry] if entry in values else given[entry])
        for entry in block
    ]


def told(excitation: Excitation, request: Request, periods: int, times: np.ndarray) -> dict[str, Any]:
    """What a model can be told of an excitation and a request, in SI."""
    given: dict[str, Any] = {
        "request.periods": periods,
        "request.samples": request.samples,
        "request.settle": TOLD_SETTLE_PERIODS if request.settle is None else request.settle,
        "request.times": times.tolist(),
        "excitation.phase": excitation.phase,
    }
    if excitation.frequency is not None:
        given["excitation.frequency"] = excitation.frequency
    if excitation.amplitude is not None:
        given["excitation.amplitude"] = excitation.amplitude
    if excitation.recorded:
        samples = excitation.as_samples
        given |= {"excitation.time": samples.time.tolist(), "excitation.value": samples.value.tolist()}
    return given


def _table(entry: Any, where: str, keys: tuple[str, ...]) -> Mapping[str, Any]:
    table = entry if isinstance(entry, Mapping) else {"output": entry}
    for key in table:
        if key not in keys:
            raise CalibError(f"{where}: unknown key {key!r}{nearest(key, keys)}; it takes {', '.join(keys)}")
    return table


def _index(table: Mapping[str, Any], where: str) -> int:
    if "output" not in table:
        raise CalibError(f"{where}: state output, the index of the output vector, from 0 on")
    return _count(table["output"], where)


def _count(value: Any, where: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise CalibError(f"{where}: expected an index from 0 on, got {value!r}")
    return value
