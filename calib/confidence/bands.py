"""Bands of records that a posterior distribution predicts: their file."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from calib.confidence.predictive import TAILS, PredictedChannel, PredictedLoop
from calib.errors import CalibError
from calib.execution.netcdf import read_dataset, write_dataset
from calib.records import STATE, is_response
from calib.records.held_response import is_held
from calib.records.response import HELD, HELD_AMPLITUDE, KIND

PREDICTIVE = "predictive.nc"
RECORDS, PREFIX = "records", "record{}."  # attribute of the file; in front of the names of a record's variables
SWEPT_AT = ("frequency", "level", "sweep", "direction")  # what was set at the points of a frequency response


def predicted_bands(
    measured: xr.Dataset,
    channels: Mapping[tuple[str, str], PredictedChannel],
    trust: np.ndarray,
    period: float | None,
) -> xr.Dataset:
    """Bands of a record.

    Parameters
    ----------
    measured : channels (body, time) in SI; of a frequency response (body, point)
    channels : prediction of each (body, channel)
    trust : (time,) in a velocity; small beside an impact
    period : of the motion [s], None without one

    Returns
    -------
    measured and median (row, time), curve and sample (tail, row, time) at the probabilities `tail`, noise (row, time),
    unit, body and channel (row), trust (time); of each body with both channels loop_curve and loop_sample (tail, state,
    loop, time), across the median curve, and loop_body (loop). Of a frequency response all are over point instead of
    time, beside frequency, level, sweep and direction (point) of the record; NaN where it has no band.
    """
    rows, along = list(channels), "point" if is_response(measured) else "time"
    whole = {
        "measured": (("row", along), np.array([measured[c].sel(body=b).values for b, c in rows])),
        "median": (("row", along), np.array([own.median for own in channels.values()])),
        "curve": (("tail", "row", along), np.stack([own.curve_quantiles for own in channels.values()], axis=1)),
        "sample": (("tail", "row", along), np.stack([own.sample_quantiles for own in channels.values()], axis=1)),
        "noise": (("row", along), np.array([np.broadcast_to(own.noise, trust.shape) for own in channels.values()])),
        "unit": ("row", np.array([measured[c].attrs.get("units", "1") for _, c in rows], dtype=str)),
        "body": ("row", np.array([b for b, _ in rows], dtype=str)),
        "channel": ("row", np.array([c for _, c in rows], dtype=str)),
        "trust": (along, trust),
        "tail": ("tail", np.array(TAILS)),
    }
    if is_response(measured):
        set_at = (*SWEPT_AT, HELD_AMPLITUDE) if is_held(measured) else SWEPT_AT
        held = {HELD: measured.attrs[HELD]} if is_held(measured) else {}
        return xr.Dataset(whole | {name: measured[name].variable for name in set_at}, attrs={"kind": KIND, **held})
    whole["time"] = ("time", measured.time.values)
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
        part = one.rename(names)
        part.attrs = {}
        parts.append(part)
    known = [{"name": name, **one.attrs} for name, one in bands.items()]
    merged = xr.merge(parts, combine_attrs="no_conflicts")
    write_dataset(merged.assign_attrs({RECORDS: json.dumps(known)}), folder / PREDICTIVE)


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
        known = [dict(one) for one in json.loads(stored.attrs[RECORDS])]
        names = [str(one.pop("name")) for one in known]
    except (KeyError, TypeError, ValueError) as error:
        raise CalibError(
            f"{path} holds no predictions; delete it and run `calib confidence --posterior` again"
        ) from error
    found = {}
    for k, (name, attributes) in enumerate(zip(names, known, strict=True)):
        prefix = PREFIX.format(k)
        own = stored[[variable for variable in stored.variables if str(variable).startswith(prefix)]]
        own = own.rename({key: str(key).removeprefix(prefix) for key in (*own.variables, *own.dims)})
        own.attrs = {key: value for key, value in attributes.items() if value is not None}
        found[name] = own
    return found
