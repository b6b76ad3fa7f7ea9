"""Channels, mean loops and impacts of records, as labelled arrays."""

from collections.abc import Sequence

import numpy as np
import xarray as xr

from calib.errors import CalibError
from calib.records import STATE
from calib.records.cycles import impact, mean_cycle, period_of, rows


def compared_channels(record: xr.Dataset, named: Sequence[str]) -> tuple[str, ...]:
    """Return the channels named, or, where none are, displacement and velocity as the record has them."""
    if named:
        return tuple(named)
    present = tuple(channel for channel in STATE if channel in record.variables)
    if not present:
        raise CalibError("the record has neither displacement nor velocity; name the channels to compare")
    return present


def labelled(
    values: np.ndarray, record: xr.Dataset, bodies: Sequence[str] | None, channels: Sequence[str], *dims: str
) -> xr.DataArray:
    """Put the names of bodies and channels to values (body, channel, *dims)."""
    names = list(bodies or record.variables["body"].values.tolist())
    return xr.DataArray(values, dims=("body", "channel", *dims), coords={"body": names, "channel": list(channels)})


def mean_loops(
    record: xr.Dataset, bodies: Sequence[str] | None, channels: Sequence[str], periods: int = 1
) -> tuple[np.ndarray, np.ndarray]:
    """Mean closed loops (body, channel, phase) and their phase [1, in periods]."""
    mean = mean_cycle(record.variables["time"].values, rows(record, bodies, channels), period_of(record), periods)
    return mean.loop.reshape(-1, len(channels), mean.phase.size), mean.phase


def spread(reference: xr.DataArray) -> xr.DataArray:
    """Root mean square about the mean along the last dimension; of a constant, its magnitude."""
    last = str(reference.dims[-1])
    std, largest = reference.std(last), abs(reference).max(last)
    return std.where(std > 1e-9 * largest, largest)


def trust_of_velocity(trust: np.ndarray, channels: Sequence[str]) -> np.ndarray:
    """Trust (channel, n) of sampled channels: only a velocity jumps at an impact."""
    return np.array([trust.ravel() if channel == "velocity" else np.ones(trust.size) for channel in channels])


def as_names(names: Sequence[str] | str) -> tuple[str, ...]:
    """Return one name or several as a tuple."""
    return (names,) if isinstance(names, str) else tuple(names)


def picked(
    values: np.ndarray, record: xr.Dataset, bodies: Sequence[str] | None, channels: Sequence[str], *dims: str
) -> xr.DataArray:
    """Values (body, channel, *dims) of the record's bodies, of which those named are kept."""
    everything = labelled(values, record, None, channels, *dims)
    return everything if bodies is None else everything.sel(body=list(bodies))


def impacts(record: xr.Dataset, bodies: Sequence[str] | None) -> np.ndarray:
    """Phase, velocity change and duration (body, 1, 3) of the strongest impact; see `calib.records.cycles.impact`."""
    loops, phase = mean_loops(record, bodies, ("velocity",))
    return np.array([[impact(phase, loop) for loop in body] for body in loops])
