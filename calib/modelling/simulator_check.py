"""Checks of a simulator against its contract, and of an excitation against what a simulator takes."""

import inspect
from collections.abc import Collection, Iterable

import numpy as np
import xarray as xr

from calib.errors import CalibError
from calib.modelling.parameter import Parameter
from calib.modelling.simulator import Simulator
from calib.records import channels, failed
from calib.records.excitation import Excitation
from calib.records.schema import MAX_MAGNITUDE

GUIDE = "see the guide in calib.modelling.simulator.Simulator"
RUN = "run(values, excitation, laws, request)"
EXPECTED = {
    "name": 'its name, such as "pendulum"',
    "bodies": 'a tuple of names, such as ("mass",)',
    "parameters": 'a tuple of calib.Parameter, such as (Parameter("stiffness", "N/m", 4000.0, "of the spring"),)',
    "sites": 'the sites at which it takes laws, such as frozenset() or frozenset({"force"})',
    "run": f"the method {RUN}",
}  # attribute -> what it is
NO_RECORD = "no record"  # status of a run that returned something else


def simulator_class(thing: object, name: str) -> type:
    """Return what a study names as its simulator, not called yet, where it is a class with a method `run`.

    Raises
    ------
    CalibError : it is something else
    """
    if not isinstance(thing, type):
        kind = f"a {type(thing).__name__}" if callable(thing) else f"an instance of {type(thing).__name__}"
        raise CalibError(f"{name!r} is {kind}, and is not called; name the class of a simulator; {GUIDE}")
    if not callable(getattr(thing, "run", None)):
        raise CalibError(f"simulator {thing.__name__} lacks run, {EXPECTED['run']}; {GUIDE}")
    return thing


def check_driven(name: str, excitation: Excitation, takes: Collection[tuple[str, str]]) -> None:
    """Refuse an excitation whose (quantity, place) is none of those that the simulator of this name takes.

    Raises
    ------
    CalibError : with what it takes
    """
    if (excitation.quantity, excitation.place) not in takes:
        known = ", ".join(f"{quantity} at {place!r}" for quantity, place in sorted(takes))
        raise CalibError(
            f"simulator {name!r} is not driven by {excitation.quantity} at {excitation.place!r}; it takes {known}"
        )


def check_simulator(simulator: Simulator) -> None:
    """Check that a simulator has what its contract requires.

    Raises
    ------
    CalibError : an attribute or `run` is missing, or is something else
    """
    if isinstance(simulator, type):
        raise CalibError(f"expected a simulator, got the class {simulator.__name__}; make one: {simulator.__name__}()")
    who = f"simulator {type(simulator).__name__}"
    missing = [f"{name}, {what}" for name, what in EXPECTED.items() if not hasattr(simulator, name)]
    if missing:
        raise CalibError(f"{who} lacks {'; '.join(missing)}; {GUIDE}")
    for name, kind in (("bodies", str), ("parameters", Parameter)):
        value = getattr(simulator, name)
        several = isinstance(value, Iterable) and not isinstance(value, str)
        if not several or not all(isinstance(entry, kind) for entry in value):
            raise CalibError(f"{who}: {name}: expected {EXPECTED[name]}, got {value!r:.60}")
    if not callable(simulator.run):
        raise CalibError(f"{who}: run: expected {EXPECTED['run']}, got {simulator.run!r:.60}")
    try:
        inspect.signature(simulator.run).bind("values", "excitation", "laws", "request")
    except TypeError as error:
        raise CalibError(f"{who}: expected {RUN}, got run{inspect.signature(simulator.run)}") from error


def as_record(returned: object, simulator: Simulator) -> xr.Dataset:
    """Return what `run` has returned where it is a record, else the record of a failed run that says what it is.

    A motion whose values have no finite sums of squares has diverged.
    """
    if not isinstance(returned, xr.Dataset):
        got = "None" if returned is None else f"an object of type {type(returned).__name__}"
    elif "status" not in returned.attrs:
        got = "a dataset without the attribute status"
    else:
        missing = [name for name in ("body", "time") if name not in returned.coords]
        unreal = [name for name, values in returned.variables.items() if np.iscomplexobj(values)]
        if not missing and not unreal:
            beyond = _beyond(returned)
            return failed(simulator.bodies, "diverged", beyond) if beyond else returned
        got = f"complex values of {unreal[0]}" if unreal else f"a dataset without the coordinate {missing[0]}"
    expected = "expected a record, as calib.records.make or calib.records.failed builds it"
    return failed(simulator.bodies, NO_RECORD, f"{type(simulator).__name__}.run returned {got}; {expected}")


def _beyond(record: xr.Dataset) -> str:
    """State which channel exceeds the largest magnitude of a record; "" where none does. NaN and infinity are none."""
    for channel in channels(record):
        values = np.abs(record.variables[channel].values)
        largest = float(np.max(values, where=np.isfinite(values), initial=0.0))
        if largest > MAX_MAGNITUDE:
            return f"{channel} reaches {largest:.3g}; a record holds up to {MAX_MAGNITUDE:g} in SI units"
    return ""
