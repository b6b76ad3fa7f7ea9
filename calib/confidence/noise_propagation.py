"""Noise of the measured records propagated to the residuals of all terms together."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import xarray as xr

from calib.records import channels

NUMBER = 100  # draws: a standard error of 7 % for each correlation that is made from them
SMALL = 0.01  # of a channel's standard deviation: noise where the record states no uncertainty


def noise_draws(objective, records: Mapping[str, xr.Dataset], seed: int, number: int = NUMBER) -> np.ndarray:
    """Changes (number, m) of the residuals when white noise is added to the measured records.

    Terms that look at one channel see the same noise, so their residuals are correlated although they stand in
    different blocks; how much, `calib.confidence.local` learns from this. Nothing is simulated.

    Parameters
    ----------
    objective : has references, terms and residuals(records), and is made by ``type(objective)(references, terms)``
    records : name -> simulated record at the best point
    seed : of the noise, whose size is the record's own uncertainty or, without one, SMALL
    """
    rng = np.random.default_rng(seed)
    base = objective.residuals(records).values
    found = np.empty((number, base.size))
    for row in found:
        references = {name: replace(r, record=_noisy(r.record, rng)) for name, r in objective.references.items()}
        row[:] = type(objective)(references, objective.terms).residuals(records).values - base
    return found


def _noisy(record: xr.Dataset, rng: np.random.Generator) -> xr.Dataset:
    changed = {}
    for channel in channels(record):
        values = record[channel]
        size = record[f"{channel}_sigma"] if f"{channel}_sigma" in record else SMALL * values.std("time")
        noise = values.copy(data=rng.standard_normal(values.shape)) * size
        changed[channel] = (values + noise.transpose(*values.dims)).assign_attrs(values.attrs)
    return record.assign(changed)
