"""Noise of the measured records propagated to the residuals of all terms together."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import xarray as xr

from calib.errors import CalibError
from calib.objective import Objective
from calib.records import channels, is_response, with_channels
from calib.records.response import stated_sigma

PROPAGATION_DRAWS = 100  # for a standard error of 7 % of each correlation that is estimated from them  [count]
UNSTATED_NOISE_SHARE = 0.01  # of a channel's standard deviation: noise where the record states no uncertainty  [1]


def noise_draws(
    objective: Objective,
    records: Mapping[str, xr.Dataset],
    seed: int,
    number: int = PROPAGATION_DRAWS,
    on_progress: Callable[[int, int], None] = lambda done, foreseen: None,
) -> np.ndarray:
    """Changes (number, m) of the residuals when white noise is added to the measured records.

    Terms that compare one channel share its noise, and so do the frequency and the parts of a point of a response, of
    whatever body: their residuals are correlated although they stand in different blocks. `calib.confidence.local`
    estimates the correlation from these draws. Nothing is simulated. A draw in which the noise takes away what a term
    compares, such as a small impact, is left out.

    Parameters
    ----------
    objective : has references, terms and residuals(records), and is made by ``type(objective)(references, terms)``
    records : name -> simulated record at the best point
    seed : of the noise, whose size is the record's own uncertainty or, without one, UNSTATED_NOISE_SHARE
    on_progress : called with the number of draws that are made, and of all
    """
    rng = np.random.default_rng(seed)
    base = objective.residuals(records).values
    draws = []
    for done in range(number):
        on_progress(done, number)
        noisy = {name: _noisy(reference.record, rng) for name, reference in objective.references.items()}
        try:
            references = {name: replace(r, record=noisy[name]) for name, r in objective.references.items()}
            drawn = type(objective)(references, objective.terms).residuals(records).values
        except CalibError:
            continue
        if drawn.size == base.size:
            draws.append(drawn - base)
    return np.array(draws).reshape(-1, base.size)


def _noisy(record: xr.Dataset, rng: np.random.Generator) -> xr.Dataset:
    """Return the record with white noise added to each channel, and to frequencies whose uncertainty it states."""
    changed = {}
    for channel in channels(record):
        values = record[channel]
        stated = _stated_sigma(record, channel)
        size = record[stated] if stated else UNSTATED_NOISE_SHARE * values.std(str(values.dims[-1]))
        sizes = size.variable.set_dims(values.sizes).transpose(*values.dims).values
        changed[channel] = values.values + rng.standard_normal(values.shape) * sizes
    if "frequency_sigma" in record:
        frequency = record["frequency"]
        sizes = np.broadcast_to(record["frequency_sigma"].values, frequency.shape)
        drawn = frequency.values + rng.standard_normal(frequency.shape) * sizes
        record = record.assign(frequency=(frequency.dims, drawn, frequency.attrs))
    return with_channels(record, changed)


def _stated_sigma(record: xr.Dataset, channel: str) -> str | None:
    """Name of the standard uncertainty that a record states of a channel; None where it states none."""
    if is_response(record):
        return stated_sigma(record, channel)
    name = f"{channel}_sigma"
    return name if name in record else None
