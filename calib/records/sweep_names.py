"""What the sweeps of a frequency response are called: by the level that was set, and the direction."""

from collections import Counter

import numpy as np
import xarray as xr

from calib.records.held_response import is_held
from calib.records.response import HELD, HELD_AMPLITUDE, sweeps
from calib.units import shown

STEADY_LEVEL = 0.02  # range of the level of a sweep over its largest, up to which it is told as one  [1]


def sweep_names(record: xr.Dataset) -> dict[float, str]:
    """Name of each sweep by its number, such as "0.6 N, up".

    The number is added where several have one level and direction.
    """
    names = {
        number: f"{level_text(record, points)}, {direction_text(record, points)}" for number, points in sweeps(record)
    }
    same = Counter(names.values())
    return {number: name if same[name] == 1 else f"{name}, sweep {number:g}" for number, name in names.items()}


def direction_text(record: xr.Dataset, points: np.ndarray) -> str:
    """Direction, "up" or "down", of a sweep through these points."""
    return "up" if record["direction"].values[points[0]] > 0.0 else "down"


def level_text(record: xr.Dataset, points: np.ndarray | slice) -> str:
    """What was set at points, such as those of a sweep, or its range where it follows the frequency.

    That is the amplitude of the excitation, or that of a body at which this was held.
    """
    if is_held(record):
        return f"{record.attrs[HELD]} held at {range_text(record[HELD_AMPLITUDE].values[points], 'm')}"
    return range_text(record["level"].values[points], str(record["level"].attrs["units"]))


def range_text(values: np.ndarray, unit: str) -> str:
    """Median of values in SI, such as levels, or their range where they differ."""
    if np.ptp(values) <= STEADY_LEVEL * values.max():
        return shown(float(np.median(values)), unit)
    return f"{shown(float(values.min()), unit)} .. {shown(float(values.max()), unit)}"
