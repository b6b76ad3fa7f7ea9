"""Bands of records that a posterior distribution predicts: their file."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from calib.confidence.predictive import TAILS, PredictedChannel, PredictedLoop
from calib.errors import CalibError
from calib.execution.netcdf import read_dataset, write_dataset
from calib.records import STATE

PREDICTIVE = "predictive.nc"
RECORDS, PREFIX = "records", "record{}."  # attribute of the file; in front of the names of a record's variables


def predicted_bands(
    measured: xr.Dataset,
    channels: Mapping[tuple[str, str], PredictedChannel],
    trust: np.ndarray,
    period: float | None,
) -> xr.Dataset:
    """Bands of a record.

    Parameters
    ----------
    measured : channels (body, time) in SI
    channels : prediction of each (body, channel)
    trust : (time,) in a velocity; small beside an impact
    period : of the motion [s], None without one

    Returns
    -------
    measured and median (row, time), curve and sample (tail, row, time) at the probabilities `tail`, noise (row), unit,
    body and channel (row), trust (time); of each body with both channels loop_curve and loop_sample (tail, state, loop,
    time), across the median curve, and loop_body (loop)
    """
    rows = list(channels)
    whole = {
        "measured": (("row", "time"), np.array([measured[c].sel(body=b).values for b, c in rows])),
        "median": (("row", "time"), np.array([own.median for own in channels.values()])),
        "curve": (("tail", "row", "time"), np.stack([own.curve_quantiles for own in channels.values()], axis=1)),
        "sample": (("tail", "row", "time"), np.stack([own.sample_quantiles for own in channels.values()], axis=1)),
        "noise": ("row", np.array([own.noise for own in channels.values()])),
        "unit": ("row", np.array([measured[c].attrs.get("units", "1") for _, c in rows], dtype=str)),
        "body": ("row", np.array([b for b, _ in rows], dtype=str)),
        "channel": ("row", np.array([c for _, c in rows], dtype=str)),
        "trust": ("time", trust),
        "tail": ("tail", np.array(TAILS)),
        "time": ("time", measured.time.values),
    }
    looped = [body for body in dict.fromkeys(b for b, _ in rows) if all((body, c) in channels for c in STATE)]
    if looped:
        loops = [PredictedLoop(*(channels[body, c] for c in STATE)).bands() for body in looped]
        for k, name in enumerate(("loop_curve", "loop_sample")):
            whole[name] = (("tail", "state", "loop", "time"), np.stack([bands[k] for bands in loops], axis=2))
        whole["loop_body"] = ("loop", np.array(looped, dtype=str))
    return xr.Dataset(whole, attrs={} if period is None else {"period": period})


def write_bands(bands: Mapping[str, xr.Dataset], folder: Path) -> None:
    """Write the bands of records, by name."""
    parts = []
    for k, one in enumerate(bands.values()):
        prefix = PREFIX.format(k)
        names = {name: f"{prefix}{name}" for name in (*one.variables, *one.dims)}
        parts.append(one.rename(names))
    known = [{"name": name, "period": one.attrs.get("period")} for name, one in bands.items()]
    write_dataset(xr.merge(parts, combine_attrs="drop").assign_attrs({RECORDS: json.dumps(known)}), folder / PREDICTIVE)


def read_bands(folder: Path) -> dict[str, xr.Dataset]:
    """Bands of records by name, see `predicted_bands`; none where there is no file.

    Raises
    ------
    CalibError : it holds none
    """
    path = folder / PREDICTIVE
    if not path.is_file():
        return {}
    stored = read_dataset(path)
    try:
        known = [(str(one["name"]), one["period"]) for one in json.loads(stored.attrs[RECORDS])]
    except (KeyError, TypeError, ValueError) as error:
        raise CalibError(
            f"{path} holds no predictions; delete it and run `calib confidence --posterior` again"
        ) from error
    found = {}
    for k, (name, period) in enumerate(known):
        prefix = PREFIX.format(k)
        own = stored[[variable for variable in stored.variables if str(variable).startswith(prefix)]]
        own = own.rename({key: str(key).removeprefix(prefix) for key in (*own.variables, *own.dims)})
        own.attrs = {} if period is None else {"period": float(period)}
        found[name] = own
    return found
