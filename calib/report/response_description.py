"""What a frequency response holds, in sentences and in the words of figures."""

from collections.abc import Iterator, Sequence

import numpy as np
import xarray as xr

from calib.records.held_response import as_measured, is_held
from calib.records.response import (
    HELD,
    complex_amplitude,
    complex_harmonics,
    harmonic_orders,
    order_of_part,
    sweeps,
)
from calib.records.sweep_names import direction_text, level_text, range_text
from calib.units import shown


def part_text(part: str) -> str:
    """Name of a part of a response for readers, such as "in phase" or "quadrature of harmonic 2"."""
    order = order_of_part(part)
    name = part.removesuffix(f"_{order}").replace("_", " ")
    return name if order == 1 else f"{name} of harmonic {order}"


def response_text(record: xr.Dataset, quantity: str, place: str) -> str:
    """Describe the excitation of a frequency response: quantity, place, levels and frequencies.

    quantity, place : of the excitation, which a study may state in the place of the record; "" where neither does
    """
    frequency = record["frequency"].values
    drive = " at the ".join(filter(None, (quantity, place))) or "an excitation that is not stated"
    held = f", {record.attrs[HELD]} held at a set amplitude," if is_held(record) else ""
    return (
        f"swept by {drive}, {levels_text(record)}{held or ','} from {shown(float(frequency.min()), 'Hz')} to "
        f"{shown(float(frequency.max()), 'Hz')}"
    )


def levels_text(record: xr.Dataset) -> str:
    """Levels of all points of a frequency response as they were measured, such as "0.1 N to 0.6 N"."""
    unit, level = str(record["level"].attrs["units"]), as_measured(record)["level"].values
    low, high = shown(float(level.min()), unit), shown(float(level.max()), unit)
    return low if low == high else f"{low} to {high}"


def gross_errors_text(name: str, size: int, numbers: Sequence[int], frequencies: Sequence[float]) -> str:
    """Name the points of a response that are gross errors.

    Parameters
    ----------
    name : of the record
    size : number of its points
    numbers : of those, the first point being number 1
    frequencies : of those  [Hz]
    """
    named = [f"number {n} at {shown(f, 'Hz')}" for n, f in zip(numbers, frequencies, strict=True)]
    lie, were, have, them = (
        ("lies", "it was", "It has", "it") if len(named) == 1 else ("lie", "they were", "They have", "them")
    )
    return (
        f"record {name!r}: {len(named)} of {size} points, {', '.join(named)}, {lie} neither on the simulated response "
        f"nor beside the points before and after: {were} read before the motion had settled after a jump, or in "
        f"error, or the frequencies are too far apart there. {have} little weight; measure {them} again"
    )


def response_description(record: xr.Dataset) -> Iterator[str]:
    """Describe a frequency response, sweep by sweep."""
    drive = (str(record.attrs.get(key, "")) for key in ("quantity", "place"))
    orders = harmonic_orders(record)
    of = f" of harmonics {', '.join(map(str, orders))}" if len(orders) > 1 else ""
    yield f"frequency response{of} of {record.sizes['point']} points: {response_text(record, *drive)}"
    amplitude, stated = np.abs(complex_amplitude(record)), "response_sigma" in record
    levels, unit = as_measured(record)["level"].values, str(record["level"].attrs["units"])
    for sweep, points in sweeps(record):
        way = direction_text(record, points)
        if is_held(record):
            least = points[int(np.argmin(levels[points]))]
            at = shown(float(record["frequency"].values[least]), "Hz", 6)
            size = range_text(levels[points], unit)
            yield (
                f"sweep {sweep:g} {way}, {level_text(record, points)}, {points.size} points: level {size}, the least "
                f"at {at}{_largest_harmonics(as_measured(record), record.attrs[HELD], points)}"
            )
            continue
        for body, own in zip(record.body.values.tolist(), amplitude[:, points], strict=True):
            top = int(np.argmax(own))
            noise = ""
            if stated:
                sigma = float(record["response_sigma"].sel(body=body).values[points[top]])
                noise = f", standard uncertainty {shown(sigma, 'm', 2)}"
            yield (
                f"sweep {sweep:g} {way}, level {level_text(record, points)}, {points.size} "
                f"points: largest amplitude of {body} {shown(float(own[top]), 'm')} at "
                f"{shown(float(record['frequency'].values[points[top]]), 'Hz', 6)}{noise}"
                f"{_largest_harmonics(record, body, points)}"
            )


def _largest_harmonics(record: xr.Dataset, body: str, points: np.ndarray) -> str:
    """Name the largest amplitude of each higher harmonic of a body in a sweep; "" where there is none."""
    found = []
    row, frequency = record.body.values.tolist().index(body), record["frequency"].values[points]
    for order, own in zip(harmonic_orders(record)[1:], np.abs(complex_harmonics(record)[1:, row]), strict=True):
        top = int(np.argmax(own[points]))
        size, at = shown(float(own[points[top]]), "m"), shown(float(frequency[top]), "Hz", 6)
        found.append(f"; harmonic {order}: {size} at {at}")
    return "".join(found)
