"""Units of an FMU's variables: conversion between them and SI."""

import re
from collections.abc import Mapping
from dataclasses import dataclass

from calib.errors import CalibError
from calib.units import coherent, is_si, to_si

POWER = re.compile(r"(?<=[A-Za-z)])(-?\d+)")  # as in "m/s2", which pint writes "m/s^2"
DOT = re.compile(r"\.(?=[A-Za-z(])")  # between factors, as in "N.m"


@dataclass(frozen=True)
class VariableUnit:
    """Unit of a variable: a value in SI is ``factor * value + offset``.

    Attributes
    ----------
    si : the SI unit without a factor
    """

    si: str
    factor: float = 1.0
    offset: float = 0.0

    def to_si(self, value: float) -> float:
        """Value in SI of one in the variable's unit."""
        return self.factor * value + self.offset

    def from_si(self, value: float) -> float:
        """Value in the variable's unit of one in SI."""
        return (value - self.offset) / self.factor


@dataclass(frozen=True)
class UnitDefinition:
    """What a model description says of a unit: powers of the base units, and how values are converted to them."""

    powers: Mapping[str, int]
    factor: float = 1.0
    offset: float = 0.0


def defined_unit(name: str, definition: UnitDefinition) -> VariableUnit:
    """Return a unit that the model description defines; its own name is kept where it is one of SI, as "N/m" is."""
    above = [_power(base, power) for base, power in definition.powers.items() if power > 0]
    below = [_power(base, -power) for base, power in definition.powers.items() if power < 0]
    base = "/".join([" ".join(above) or "1", *below])
    written = _written(name)
    if definition.factor == 1.0 and definition.offset == 0.0 and (written == "Hz" or _equals(written, base)):
        base = written
    return VariableUnit(base, definition.factor, definition.offset)


def named_unit(name: str) -> VariableUnit:
    """Return a unit by its name, such as "mm" or, as Modelica writes it, "N.m/s2".

    Raises
    ------
    CalibError : there is no such unit, or cycles are counted by it otherwise than in Hz
    """
    written = _written(name)
    if written in ("", "1"):
        return VariableUnit("1")
    if is_si(written):
        return VariableUnit(written)
    base = coherent(written)
    offset = to_si(f"0 {written}", base)
    return VariableUnit(base, to_si(f"1 {written}", base) - offset, offset)


def _written(name: str) -> str:
    """Write a unit as Modelica does ("kg.m2/s2") as pint does ("kg m^2/s^2")."""
    return DOT.sub(" ", POWER.sub(r"^\1", name.strip()))


def _power(base: str, power: int) -> str:
    return base if power == 1 else f"{base}^{power}"


def _equals(unit: str, base: str) -> bool:
    """Whether two texts are one unit."""
    try:
        return unit == base or to_si(f"1 {unit}", base) == 1.0
    except CalibError:
        return False
