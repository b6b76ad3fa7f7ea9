"""The record: channels of named bodies over time, measured or simulated, in one schema."""

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from calib.errors import CalibError, nearest
from calib.records.response import HELD

CHANNELS = {"displacement": "m", "velocity": "m/s", "force": "N"}  # the usual ones; others state their own unit
STATE = ("displacement", "velocity")  # what a phase curve and a section are made of
MIN_SECTION_PERIODS = 64  # periods that the section of a simulated record holds, at least
OK = "ok"
SIMULATIONS = "simulations"  # attribute of a simulated record: runs of the simulator that it took, 1 where it is absent
DETAILS = "; details: "  # in the reason of a failed run, before what holds of this one run only, such as its folder
INTERVAL = "recorded_interval"  # attribute: between the samples of the instruments that see a simulated motion [s]


def make(
    time: np.ndarray,
    bodies: Sequence[str],
    channels: Mapping[str, np.ndarray],
    units: Mapping[str, str] | None = None,
    *,
    impacts: tuple[np.ndarray, np.ndarray] | None = None,
    section: Mapping[str, np.ndarray] | None = None,
    state: np.ndarray | None = None,
    **attrs: Any,
) -> xr.Dataset:
    """Build a record from arrays.

    Parameters
    ----------
    time : (n,)  [s]
    bodies : names of the bodies, in the order of the arrays' rows
    channels : name -> (body, n) array in SI; ``"<channel>_sigma"`` -> (body,) or (body, n) standard uncertainty
    units : unit of each channel that is not among `CHANNELS`
    impacts : of a simulation, their instants (m,) [s] and closing speeds (m,) [m/s]
    section : of a simulation, displacement or velocity -> stroboscopic section (body, period) at phase 0, in SI
    state : of a simulation, the simulator's own state (component,) at its end, from which a run can continue
    attrs : status (default "ok"), source, frequency [Hz], amplitude, place, quantity, ...
    """
    units = {**CHANNELS, **(units or {})}
    variables: dict[str, xr.Variable] = {}
    for name, values in channels.items():
        values = np.asarray(values, dtype=float)
        unit = units.get(name.removesuffix("_sigma"))
        if unit is None:
            raise CalibError(f"channel {name!r} needs a unit; the channels with a known one are {sorted(CHANNELS)}")
        variables[name] = xr.Variable(("body", "time") if values.ndim == 2 else ("body",), values, {"units": unit})
    if impacts is not None:
        variables["impact_time"] = xr.Variable("impact", impacts[0], {"units": "s"})
        variables["impact_speed"] = xr.Variable("impact", impacts[1], {"units": "m/s"})
    for channel, values in (section or {}).items():
        variables[f"section_{channel}"] = xr.Variable(("body", "period"), values, {"units": CHANNELS[channel]})
    if state is not None:
        variables["state"] = xr.Variable("component", state)
    record = xr.Dataset(
        variables,
        coords={"body": list(bodies), "time": ("time", np.asarray(time, dtype=float), {"units": "s"})},
        attrs={"status": OK, **attrs},
    )
    record.attrs.setdefault("Conventions", "CF-1.11")
    return record


def with_channels(record: xr.Dataset, channels: Mapping[str, np.ndarray]) -> xr.Dataset:
    """Return a record with other values (body, n) of channels that it has; all else is shared with it."""
    values = {name: record.variables[name].values for name in record.data_vars}
    return record.copy(data={**values, **channels})


def failed(bodies: Sequence[str], status: str, reason: str, **attrs: Any) -> xr.Dataset:
    """Build the record of a failed run: no samples, but a status and its reason.

    Runs whose reasons differ only in numbers, or behind `DETAILS`, are said to fail for one cause.
    """
    return make(np.empty(0), bodies, {}, status=status, reason=reason, **attrs)


def channels(record: xr.Dataset) -> tuple[str, ...]:
    """Names of the record's channels: variables over (body, time), or (body, point), that are no uncertainty."""
    # not of data arrays: each looks through all coordinates for its own
    both = [
        str(name) for name in record.data_vars if record.variables[name].dims in (("body", "time"), ("body", "point"))
    ]
    return tuple(name for name in both if not name.endswith("_sigma"))


def stated_period(record: xr.Dataset) -> float | None:
    """Period of the excitation that the record states [s], None without one."""
    frequency = record.attrs.get("frequency")
    return 1.0 / float(frequency) if frequency else None


def mean_interval(record: xr.Dataset) -> float:
    """Mean interval between the samples [s].

    Raises
    ------
    CalibError : fewer than two samples
    """
    time = record.variables["time"].values
    if time.size < 2:
        raise CalibError(f"an interval lies between at least two samples, the record has {time.size}; record more")
    return float(time[-1] - time[0]) / (time.size - 1)


def fills_periods(record: xr.Dataset) -> bool:
    """Whether the samples fill whole periods of the excitation, so that the first one follows upon the last."""
    period = stated_period(record)
    if period is None or record.time.size < 2:
        return False
    cycles = record.time.size * mean_interval(record) / period
    return round(cycles) >= 1 and abs(cycles - round(cycles)) < 1e-6


def prescription(bodies: Sequence[str]) -> str:
    """Text of the attribute `prescribed` where the excitation prescribes the motion of `bodies`."""
    return ",".join(f"{body}.{channel}" for body in bodies for channel in STATE)


def prescribed(record: xr.Dataset) -> tuple[tuple[str, str], ...]:
    """Return the (body, channel) pairs that the excitation prescribes, from the attribute `prescribed`."""
    entries = (entry.strip() for entry in str(record.attrs.get("prescribed", "")).split(","))
    parts = (entry.rpartition(".") for entry in entries if entry)
    return tuple((body, channel) for body, _, channel in parts)


def nuisance_sigma(record: xr.Dataset) -> dict[str, float]:
    """Return the standard uncertainty of a figure's shear, scale and offset, from the attribute `nuisance_sigma`.

    Raises
    ------
    CalibError : no JSON object of numbers
    """
    stated = record.attrs.get("nuisance_sigma", "{}")
    try:
        sigmas = {name: float(sigma) for name, sigma in json.loads(stated).items()}
        if not all(map(math.isfinite, sigmas.values())):
            raise ValueError("a standard uncertainty is finite")
    except (TypeError, ValueError, AttributeError, OverflowError, RecursionError) as error:
        wanted = 'expected a JSON object of standard uncertainties in SI, such as {"scale.velocity": 0.004}'
        raise CalibError(f"attribute nuisance_sigma: {wanted}, got {stated!r:.80}; mend it") from error
    return sigmas


def rename_bodies(record: xr.Dataset, names: Mapping[str, str], name: str = "record") -> xr.Dataset:
    """Return the record with only the bodies in `names` (record body -> new name), renamed."""
    have = [str(b) for b in record.body.values]
    for body in names:
        if body not in have:
            raise CalibError(f"{name}: there is no body {body!r}{nearest(body, have)}; the record has {have}")
    renamed = record.sel(body=list(names)).assign_coords(body=list(names.values()))
    if (held := renamed.attrs.get(HELD)) is not None:
        if held not in names:
            raise CalibError(f"{name}: the amplitude of {held!r} was held; name it among the bodies")
        renamed.attrs[HELD] = names[held]
    if renamed.attrs.get("prescribed"):
        renamed.attrs["prescribed"] = ",".join(f"{names[b]}.{c}" for b, c in prescribed(record) if b in names)
    return renamed
