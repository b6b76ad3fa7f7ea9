"""Channels whose measured amplitude is implausible beside the simulated one, as where a unit is not stated."""

import math
from collections.abc import Collection, Iterator, Mapping

import numpy as np
import xarray as xr

from calib.objective import Objective
from calib.records import CHANNELS, channels, is_response, prescribed
from calib.records.response import order_of_part
from calib.report.formatting import number
from calib.report.response_description import levels_text

MAX_AMPLITUDE_RATIO = 100.0  # of measured to simulated rms, or its inverse: beyond, a unit is suspected  [1]


def implausible_amplitudes(
    objective: Objective, simulated: Mapping[str, xr.Dataset], tables: Collection[str] = ()
) -> list[str]:
    """Name the channel of each record whose amplitude differs most from the simulated one, if beyond all plausibility.

    simulated : name -> record of the calibrated model, before nuisances are solved for
    tables : names of the records that are made of a table, whose columns state their units
    """
    remarks = []
    for name in objective.scored:
        measured = objective.references[name].record
        ratios = dict(_amplitude_ratios(measured, simulated[name]))
        if not ratios:
            continue
        (body, channel), ratio = max(ratios.items(), key=lambda item: abs(math.log(item[1])))
        if not 1.0 / MAX_AMPLITUDE_RATIO <= ratio <= MAX_AMPLITUDE_RATIO:
            unit = CHANNELS.get(channel, measured[channel].attrs.get("units", "1"))
            advice = f"its unit; numbers without a unit are taken as {unit}"
            if is_response(measured):
                advice = f"its unit and that of the level, {levels_text(measured)}, which excites the model"
            elif name in tables:
                advice = "its unit and its column"
            remarks.append(
                f"in {name} the measured {channel} of {body} is {number(ratio, 2)} times as large as the simulated one "
                f"(root mean square about the mean): check {advice}"
            )
    return remarks


def _amplitude_ratios(measured: xr.Dataset, simulated: xr.Dataset) -> Iterator[tuple[tuple[str, str], float]]:
    """Measured over simulated rms about the mean [1] by (body, channel), of channels that move in both.

    Without higher harmonics of a response: a model that is nearly linear has next to none, whatever the unit.
    """
    given = prescribed(simulated)
    for channel in channels(measured):
        if channel not in simulated or (is_response(measured) and order_of_part(channel) > 1):
            continue
        for body in (str(b) for b in measured.body.values):
            if body not in simulated.body.values or (body, channel) in given:
                continue
            one, other = (float(np.std(record[channel].sel(body=body).values)) for record in (measured, simulated))
            if one > 0.0 and other > 0.0:
                yield (body, channel), one / other
