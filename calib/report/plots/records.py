"""What figures read from a measured record and its simulation: channels compared, units, time axes, impacts."""

import numpy as np
import xarray as xr

from calib.objective import Objective
from calib.records import OK, channels, prescribed, stated_period
from calib.units import shown_unit

MAX_SPAN_IN_MS = 2.0  # s: longest interval whose time axis is in milliseconds


def channel_pairs(record: xr.Dataset) -> list[tuple[str, str]]:
    """All (body, channel) pairs of a record."""
    return [(str(b), c) for b in record.body.values for c in channels(record)]


def compared_channels(measured: xr.Dataset, simulated: xr.Dataset) -> list[tuple[str, str]]:
    """(body, channel) pairs that both records have and the excitation does not prescribe."""
    given = prescribed(simulated)
    return [(b, c) for b, c in channel_pairs(measured) if has_channels(simulated, b, c) and (b, c) not in given]


def is_drawable(record: xr.Dataset) -> bool:
    """Whether the simulation succeeded and has samples to draw."""
    return record.attrs.get("status", OK) == OK and max(record.sizes.get("time", 0), record.sizes.get("point", 0)) > 1


def has_channels(record: xr.Dataset, body: str, *names: str) -> bool:
    """Whether the record has this body and these channels."""
    return all(name in record and body in record.body.values for name in names)


def impact_times(record: xr.Dataset) -> np.ndarray:
    """Instants (n,) of the impacts in a record [s]; empty where it has none."""
    return np.asarray(record["impact_time"].values, dtype=float) if "impact_time" in record else np.empty(0)


def aligned_simulation(objective: Objective, name: str, simulated: xr.Dataset) -> xr.Dataset:
    """Return a simulated record on the time base of the reference `name`.

    It keeps its impacts (variable impact_time [s]) and the channels that the excitation prescribes (attribute).
    """
    aligned = _with_impacts(objective.aligned(name, simulated), simulated)
    return aligned.assign_attrs(prescribed=simulated.attrs.get("prescribed", ""))


def _with_impacts(aligned: xr.Dataset, simulated: xr.Dataset) -> xr.Dataset:
    """Put the impacts of a simulated record on the time of the reference it was aligned with.

    The trigger, attribute `nuisance_trigger` of `aligned`, is the simulation's time at the reference's time zero [s];
    the simulation repeats itself after its own length.
    """
    times = impact_times(simulated)
    period = stated_period(simulated) or stated_period(aligned)
    if not times.size or not period:
        return aligned
    step = (float(simulated.time[-1]) - float(simulated.time[0])) / (simulated.sizes["time"] - 1)
    length = period * max(1, round((float(simulated.time[-1]) - float(simulated.time[0]) + step) / period))
    shifted = times - float(aligned.attrs.get("nuisance_trigger", 0.0))
    start, end = float(aligned.time[0]), float(aligned.time[-1])
    turns = np.arange(np.floor((start - shifted.max()) / length), np.ceil((end - shifted.min()) / length) + 1)
    moved = np.sort((shifted[:, None] + length * turns).ravel())
    return aligned.assign(impact_time=("impact", moved[(moved >= start) & (moved <= end)]))


def channel_axis(record: xr.Dataset, body: str, channel: str) -> tuple[str, float, str]:
    """Label of a channel, and the factor and unit in which it is drawn."""
    values = record[channel].sel(body=body).values
    return channel.capitalize(), *shown_unit(record[channel].attrs.get("units", "1"), np.max(np.abs(values)))


def time_axis(record: xr.Dataset) -> tuple[float, str]:
    """Factor and unit of time axes: ms where less than 2 s are shown."""
    period = stated_period(record)
    span = 2.0 * period if period else float(record.time[-1] - record.time[0])
    return (1e3, "ms") if span < MAX_SPAN_IN_MS else (1.0, "s")


def two_periods(record: xr.Dataset, period: float) -> slice:
    """Samples of the first two periods; `period` in s."""
    inside = np.flatnonzero(record.time.values <= float(record.time[0]) + 2.0 * period)
    return slice(0, int(inside[-1]) + 1)
