"""A velocity that was made from displacements by differences."""

import numpy as np

from calib.effect import Effect
from calib.laws import sensor
from calib.parameter import Parameter
from calib.record import fills_periods


@sensor
def differenced(record, p):
    """Return the record with a share of its velocity replaced by backward differences of the displacement.

    A stationary motion that fills whole periods goes on before its first sample as it ended; any other record has there
    the difference that the next two make when they go on in a straight line.
    """
    if "velocity" not in record or "displacement" not in record:
        return record
    time, x, v = record.time.values, record["displacement"].values, record["velocity"].values
    slope = np.empty_like(v)
    slope[:, 1:] = np.diff(x, axis=1) / np.diff(time)
    slope[:, 0] = 2.0 * slope[:, 1] - slope[:, 2]
    if fills_periods(record):
        slope[:, 0] = (x[:, 0] - x[:, -1]) * (time.size - 1) / (time[-1] - time[0])
    return record.assign(velocity=record["velocity"].copy(data=v + p["differencing"] * (slope - v)))


EFFECT = Effect(
    name="velocity_differencing",
    site="sensor",
    law=differenced,
    parameters=(Parameter("differencing", "1", 0.0, "share of differences", null=0.0, low=0.0, high=1.0),),
    meaning="the velocity is a difference of samples: half a step late, its jumps rounded",
    equation="v + differencing ((x_k - x_(k-1)) / dt - v)",
    confused=("channel_lag", "velocity_lowpass"),
    cite="McConnell & Varoto, Vibration Testing: Theory and Practice (2008)",
)
