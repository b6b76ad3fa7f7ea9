"""The parameters that a study declares for its program."""

import math
from collections.abc import Mapping
from typing import Any

from calib.errors import CalibError, nearest
from calib.modelling.parameter import Parameter
from calib.units import MAX_QUANTITY_CHARACTERS, coherent, to_si

KEYS = ("nominal", "meaning", "low", "high", "null")


def declared_parameters(stated: Mapping[str, Any]) -> tuple[Parameter, ...]:
    """Parameters from what the option `parameters` says of each: a quantity, or a table with `nominal` in it.

    Raises
    ------
    CalibError : no name that a template can have, no quantity, bounds that exclude the nominal value
    """
    if not isinstance(stated, Mapping):
        raise CalibError(f'parameters: expected a table such as {{ gap = "1 mm" }}, got {stated!r:.60}')
    return tuple(_parameter(name, value) for name, value in stated.items())


def _parameter(name: str, stated: Any) -> Parameter:
    where = f"parameters: {name}"
    if not name.isidentifier():
        raise CalibError(f"{where}: expected a name of letters, digits and '_', as a placeholder can have; rename it")
    table = stated if isinstance(stated, Mapping) else {"nominal": stated}
    for key in table:
        if key not in KEYS:
            raise CalibError(f"{where}: unknown key {key!r}{nearest(key, KEYS)}; known are {', '.join(KEYS)}")
    if "nominal" not in table:
        raise CalibError(f'{where}: nominal is missing; state the nominal value, such as nominal = "1 mm"')
    meaning = table.get("meaning", f"{name} of the templates")
    if not isinstance(meaning, str):
        raise CalibError(f"{where}: meaning: expected a text, got {meaning!r:.60}")
    try:
        unit = unit_of_quantity(table["nominal"])
        numbers = {key: to_si(table[key], unit) for key in KEYS if key in table and key != "meaning"}
    except CalibError as error:
        raise CalibError(f"{where}: {error}") from error
    if not math.isfinite(numbers["nominal"]):
        raise CalibError(f"{where}: expected a finite nominal value, got {table['nominal']!r}")
    nominal, null = numbers["nominal"], numbers.get("null")
    low, high = numbers.get("low", -math.inf), numbers.get("high", math.inf)
    parameter = Parameter(name, unit, nominal, meaning, null=null, low=low, high=high)
    if not parameter.low <= parameter.nominal <= parameter.high:
        raise CalibError(
            f"{where}: the nominal value {parameter.nominal:g} {unit} lies outside [{parameter.low:g}, "
            f"{parameter.high:g}] {unit}; mend nominal, low or high"
        )
    return parameter


def unit_of_quantity(quantity: Any) -> str:
    """Coherent SI unit of a quantity: "Pa" of "70 GPa"; "1" of a bare number.

    Raises
    ------
    CalibError : it is no quantity
    """
    if isinstance(quantity, bool) or not isinstance(quantity, str | int | float):
        raise CalibError(f"expected a number or a text with a unit, such as '1 mm', got {quantity!r:.60}")
    if not isinstance(quantity, str):
        return "1"
    text = quantity.strip()[:MAX_QUANTITY_CHARACTERS]
    size = len(text)
    while size and not _is_number(text[:size]):
        size -= 1
    return coherent(text[size:].strip())


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
