"""What makes a dataset a record: the one place where records are checked and brought to SI."""

import re
from collections.abc import Hashable, Sequence
from numbers import Real
from typing import Any

import numpy as np
import xarray as xr

from calib.errors import CalibError
from calib.records.excitation import UNITS as EXCITATION_UNITS
from calib.records.held_response import at_one_level
from calib.records.record import CHANNELS, INTERVAL, OK, STATE, channels, nuisance_sigma
from calib.records.response import HELD, check_response, is_response
from calib.records.rounded_time import rounding_hint
from calib.units import is_si, to_si

MAX_TIME_S = 1e9  # s, either side of zero: 32 years
MIN_INTERVAL_S = 1e-15  # s, between two samples
MIN_FREQUENCY_HZ, MAX_FREQUENCY_HZ = 1e-9, 1e9  # Hz, of an excitation
MAX_MAGNITUDE = 1e100  # SI unit of the channel; squares of such values and their sums are finite
MAX_UNIT_CHARACTERS = 60  # of the unit of a variable
POWER_OF_NUMBER = re.compile(r"[\d)]\s*(\*\*|\^)")  # 9^9^9 takes for ever; no unit is written so
# units and dims of the variables that are no channels
UNITS = {"time": "s", "impact_time": "s", "impact_speed": "m/s"} | {f"section_{c}": CHANNELS[c] for c in STATE}
# simulators, and earlier versions for an excitation from arrays, write these without a unit, and in SI
SI_UNLESS_STATED = {*UNITS, "excitation"} - {"time"}
DIMS: dict[str, tuple[tuple[str, ...], ...]] = {
    "time": (("time",),),
    "body": (("body",),),
    "excitation": (("time",),),
    "impact_time": (("impact",),),
    "impact_speed": (("impact",),),
    "state": (("component",),),
    **{f"section_{channel}": (("body", "period"),) for channel in STATE},
    **{channel: (("body", "time"),) for channel in CHANNELS},
}
SIGMA_DIMS = (("body",), ("body", "time"))
TEXTS = ("place", "quantity", "reason", "prescribed", "nuisance")  # attributes
NUMBERS = ("amplitude", "phase", "cutoff", INTERVAL)  # attributes, in SI


def check(record: xr.Dataset, name: str = "record") -> xr.Dataset:
    """Return the record in SI, where it satisfies the schema.

    Every variable of a known unit is converted from the unit that its attribute `units` states; numbers become doubles.

    Parameters
    ----------
    name : of the record or its file, with which every message begins

    Raises
    ------
    CalibError : it does not satisfy the schema; the message names the variable, what was expected and the remedy
    """
    _check_attributes(record, name)
    if is_response(record):
        record = check_response(record, name)
        return at_one_level(record, str(record.attrs[HELD])) if HELD in record.attrs else record
    for dim, what in (("body", "names of the bodies"), ("time", "time [s]")):
        if dim not in record.coords:
            raise CalibError(f"{name}: the coordinate {dim!r} ({what}) is missing; it has {list(record.coords)}")
    present = channels(record)
    if not present:
        turned = [str(v) for v in record.data_vars if record[v].dims == ("time", "body")]
        if turned:
            raise CalibError(
                f"{name}: expected {turned[0]} with dims ('body', 'time'), got ('time', 'body'); transpose it"
            )
        raise CalibError(f"{name}: no channel over (body, time), such as displacement [m] or velocity [m/s]")
    _check_dims(record, name)
    _check_bodies(record, name)
    record = _in_si(record, name)
    _check_time(record.time.values, name)
    for channel in present:
        _check_channel(record, channel, name)
    return record


def _check_attributes(record: xr.Dataset, name: str) -> None:
    attrs = record.attrs
    status = attrs.get("status", OK)
    if not isinstance(status, str) or status != OK:
        reason = f" ({attrs['reason']})" if attrs.get("reason") else ""
        raise CalibError(
            f"{name}: attribute status: expected {OK!r}, got {status!r}{reason}: the run that made it failed; "
            "make the record again"
        )
    for attribute in TEXTS:
        if not isinstance(attrs.get(attribute, ""), str):
            raise CalibError(f"{name}: attribute {attribute}: expected a text, got {attrs[attribute]!r}; mend it")
    for attribute in NUMBERS:
        if attribute in attrs:
            _check_number(attrs[attribute], f"{name}: attribute {attribute}", "a finite number in SI")
    if "frequency" in attrs:
        where = f"{name}: attribute frequency"
        wanted = f"a number in SI from {MIN_FREQUENCY_HZ:g} to {MAX_FREQUENCY_HZ:g} Hz"
        frequency = _check_number(attrs["frequency"], where, wanted)
        if not MIN_FREQUENCY_HZ <= frequency <= MAX_FREQUENCY_HZ:
            raise CalibError(f"{where}: expected {wanted}, got {frequency!r}; state it in Hz, or drop it")
    try:
        nuisance_sigma(record)
    except CalibError as error:
        raise CalibError(f"{name}: {error}") from error


def _check_number(value: Any, where: str, wanted: str) -> float:
    if not isinstance(value, Real) or not abs(float(value)) <= MAX_MAGNITUDE:
        raise CalibError(f"{where}: expected {wanted}, got {value!r}; mend or drop it")
    return float(value)


def _check_dims(record: xr.Dataset, name: str) -> None:
    sigmas = {f"{channel}_sigma": SIGMA_DIMS for channel in channels(record)}
    for variable, allowed in (DIMS | sigmas).items():
        dims = record.variables[variable].dims if variable in record.variables else allowed[0]
        if dims not in allowed:
            wanted = " or ".join(str(one) for one in allowed)
            raise CalibError(f"{name}: expected {variable} with dims {wanted}, got {dims}; reshape or transpose it")


def _check_bodies(record: xr.Dataset, name: str) -> None:
    bodies = record.body.values.tolist()
    if not bodies:
        raise CalibError(f"{name}: body: expected one name at least, got none; name the bodies")
    for body in bodies:
        if not isinstance(body, str) or not body:
            raise CalibError(f"{name}: body: expected names that are texts, such as 'beam', got {body!r}; rename it")
        if bodies.count(body) > 1:
            raise CalibError(f"{name}: body: expected each name once, got {body!r} {bodies.count(body)} times; rename")


def _check_time(time: np.ndarray, name: str) -> None:
    if time.size < 2:
        raise CalibError(f"{name}: at least two samples are needed, got {time.size}")
    if not np.isfinite(time).all():
        raise CalibError(f"{name}: time holds NaN at sample {int(np.argmin(np.isfinite(time)))}; cut those samples")
    if np.abs(time).max() > MAX_TIME_S:
        largest = float(time[np.argmax(np.abs(time))])
        raise CalibError(f"{name}: time: expected at most {MAX_TIME_S:g} s, got {largest:.6g} s; check its units")
    steps = np.diff(time)
    if (steps <= 0.0).any():
        at = int(np.argmax(steps <= 0.0))
        hint = rounding_hint(time)
        remedy = "drop samples only that were recorded twice" if hint else "sort the samples and drop repeated ones"
        raise CalibError(
            f"{name}: time must increase, but goes from {time[at]:.9g} s to {time[at + 1]:.9g} s at sample {at + 1}; "
            f"{hint and f'{hint}; '}{remedy}"
        )
    if steps.min() < MIN_INTERVAL_S:
        raise CalibError(
            f"{name}: time: expected at least {MIN_INTERVAL_S:g} s between samples, got {steps.min():.3g} s; "
            "check its units"
        )


def _check_channel(record: xr.Dataset, channel: str, name: str) -> None:
    finite = np.abs(record[channel].values) <= MAX_MAGNITUDE
    if not finite.all():
        body, sample = (int(i) for i in np.argwhere(~finite)[0])
        value = float(record[channel].values[body, sample])
        what = f"too large ({value:.3g})" if np.isfinite(value) else "not a number"
        raise CalibError(
            f"{name}: {channel} of body {str(record.body.values[body])!r} is {what} at sample {sample} "
            f"(t = {float(record.time.values[sample]):.6g} s; {int((~finite).sum())} such samples in all); "
            "cut or repair them"
        )
    sigma = f"{channel}_sigma"
    if sigma in record:
        values = record[sigma].values
        if not ((values > 0.0) & (values <= MAX_MAGNITUDE)).all():
            raise CalibError(f"{name}: {sigma} must be positive and finite everywhere; leave it out where not known")


def _in_si(record: xr.Dataset, name: str) -> xr.Dataset:
    """Return the record with all variables of a known unit as doubles in SI."""
    present = channels(record)
    record = _with_units_of_sigmas(record, present)
    units = {**UNITS, "excitation": EXCITATION_UNITS.get(record.attrs.get("quantity", ""), "")}
    for channel in present:
        units[channel] = CHANNELS.get(channel) or _own_unit(record, channel, name)
        units[f"{channel}_sigma"] = units[channel]
    for variable in list(record.variables):
        if variable in units or variable == "state":
            converted = _variable_in_si(record, variable, units.get(str(variable)), name)
            if converted is not record.variables[variable]:
                assign = record.assign_coords if variable in record.coords else record.assign
                record = assign({variable: converted})
    return record


def _with_units_of_sigmas(record: xr.Dataset, present: Sequence[str]) -> xr.Dataset:
    """Return the record where an uncertainty that states no unit has that of its channel."""
    for channel in present:
        sigma = f"{channel}_sigma"
        if sigma in record and "units" not in record[sigma].attrs and "units" in record[channel].attrs:
            unit = record[channel].attrs["units"]
            record = record.assign({sigma: record[sigma].assign_attrs(units=unit)})
    return record


def _own_unit(record: xr.Dataset, channel: str, name: str) -> str:
    """Unit of a channel that is none of the usual ones: it is kept, so it has to be one of SI without a factor."""
    unit = _stated_unit(record.variables[channel], f"{name}: {channel}", "its SI unit")
    try:
        coherent = is_si(unit)
    except CalibError as error:
        raise CalibError(f"{name}: {channel}: attribute units: {error}") from error
    if not coherent:
        raise CalibError(
            f"{name}: {channel} is none of {sorted(CHANNELS)}, so it is expected in an SI unit without a factor, "
            f"such as 'm/s^2', got {unit!r}; convert it to SI"
        )
    return unit


def _stated_unit(variable: xr.Variable, where: str, expected: str) -> str:
    unit = variable.attrs.get("units")
    if unit is None:
        raise CalibError(f"{where} states no unit; set its attribute units to {expected!r}")
    if not isinstance(unit, str) or len(unit) > MAX_UNIT_CHARACTERS or POWER_OF_NUMBER.search(unit):
        raise CalibError(f"{where}: attribute units: expected a unit such as {expected!r}, got {unit!r:.80}; mend it")
    return unit


def _variable_in_si(record: xr.Dataset, name: Hashable, unit: str | None, where: str) -> xr.Variable:
    """Return a variable as doubles in `unit`; None and "" have nothing to be converted to."""
    variable = record.variables[name]
    place = f"{where}: {name}"
    if variable.dtype.kind not in "fiu":
        kind = {"c": "complex numbers", "b": "truth values", "M": "dates", "m": "durations"}.get(
            variable.dtype.kind, "text" if variable.dtype.kind in "SUO" else str(variable.dtype)
        )
        raise CalibError(f"{place}: expected real numbers [{unit or '1'}], got {kind}; write it as 64-bit floats")
    values = variable.values.astype(float, copy=False)
    attrs = variable.attrs
    if unit and ("units" in attrs or name not in SI_UNLESS_STATED):
        stated = _stated_unit(variable, place, unit)
        if stated != unit:
            values, attrs = values * _factor(stated, unit, place), {**attrs, "units": unit}
    if name == "excitation" and not np.isfinite(values).all():
        raise CalibError(f"{place}: expected finite numbers, got NaN or infinity; cut those samples")
    if values.dtype == variable.dtype and attrs is variable.attrs:
        return variable
    return xr.Variable(variable.dims, values, attrs)


def _factor(unit: str, si: str, where: str) -> float:
    """Factor from a unit to SI."""
    try:
        return to_si(f"1 {unit}", si)
    except CalibError as error:
        raise CalibError(f"{where} is expected in {si!r} or a unit of its dimension, got {unit!r}: {error}") from error
