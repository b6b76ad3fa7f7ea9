"""The smoother of one body's channel in the record of a free decay, and its curves over amplitude."""

from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import xarray as xr

from calib.errors import CalibError, nearest
from calib.records.decay.curves import amplitude_curves
from calib.records.decay.free_motion import smoothed_decay
from calib.records.decay.smoother import SmoothedDecay
from calib.records.record import STATE, channels

FREE_DECAY = "free decay"
MAX_REMEMBERED = 32  # smoothed records that are remembered: several features and pictures are made of one


class BodyDecay(NamedTuple):
    """The decay of one body: its channel, how it is smoothed, and its curves over amplitude."""

    body: str
    channel: str
    smoothed: SmoothedDecay
    curves: xr.Dataset


def is_free_decay(record: xr.Dataset) -> bool:
    """Whether the record states a free decay as its excitation, with samples over time."""
    return record.attrs.get("quantity") == FREE_DECAY and "time" in record.dims


def decay_channel(record: xr.Dataset) -> str:
    """Channel whose amplitude stands for the motion: displacement, or velocity where there is none.

    Raises
    ------
    CalibError : neither
    """
    present = [channel for channel in STATE if channel in channels(record)]
    if not present:
        raise CalibError("the record has neither displacement nor velocity; name the channel of the decay")
    return present[0]


def smoothed_record(record: xr.Dataset, body: str, channel: str) -> SmoothedDecay:
    """Smooth one body's channel of a free decay; see `smoothed_decay`.

    record : channels (body, time), and their `*_sigma` where they are known, in SI

    Raises
    ------
    CalibError : no free decay, body or channel of this name, or too little of it above the noise
    """
    if "time" not in record.dims or record.attrs.get("quantity", FREE_DECAY) != FREE_DECAY:
        raise CalibError(
            "frequency and damping over amplitude are those of a free decay, got a record of "
            f"{record.attrs.get('quantity', 'points')}; compare it by another feature, or name the decays under "
            "`records` of the term"
        )
    bodies = [str(name) for name in record.body.values]
    if body not in bodies:
        raise CalibError(f"there is no body {body!r}{nearest(body, bodies)}; the record has {bodies}")
    if channel not in channels(record):
        have = channels(record)
        raise CalibError(f"there is no channel {channel!r}{nearest(channel, have)}; the record has {', '.join(have)}")
    row = bodies.index(body)
    stated = record[f"{channel}_sigma"].values[row] if f"{channel}_sigma" in record else None
    sigma = None if stated is None else float(np.sqrt(np.mean(np.square(stated))))
    try:
        return _smoothed(record.time.values.tobytes(), record[channel].values[row].tobytes(), sigma)
    except CalibError as error:
        raise CalibError(f"{channel} of {body}: {error}") from error


def body_decays(record: xr.Dataset) -> Iterator[BodyDecay | CalibError]:
    """Decays of the bodies of a record, or why one cannot be told."""
    for body in (str(name) for name in record.body.values):
        try:
            channel = decay_channel(record)
            smoothed = smoothed_record(record, body, channel)
            yield BodyDecay(body, channel, smoothed, amplitude_curves(smoothed))
        except CalibError as error:
            yield error


@lru_cache(maxsize=MAX_REMEMBERED)
def _smoothed(time: bytes, values: bytes, sigma: float | None) -> SmoothedDecay:
    """Smooth the samples whose float64 these are."""
    return smoothed_decay(np.frombuffer(time), np.frombuffer(values), sigma)
