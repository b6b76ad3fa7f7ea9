"""Output times of a run without a period, on the clock of its input."""

import math

import numpy as np

from calib.errors import CalibError
from calib.modelling.simulator import Request
from calib.records.excitation import Excitation

OUTPUT_TIME_TOLERANCE = 1e-6  # by which output may be requested beyond the input, over the mean interval  [1]


def output_times(excitation: Excitation, request: Request) -> tuple[np.ndarray, float]:
    """Output times (n,) [s], and when the run begins [s]: at the first sample of a recorded input, else at 0.

    Without `Request.times` they are those samples of a recorded input that do not lie before time 0.

    Raises
    ------
    CalibError : there are none, they do not increase, or a recorded input does not cover them
    """
    begins, ends, recorded = 0.0, math.inf, None
    if excitation.recorded:
        recorded = excitation.as_samples.time
        begins, ends = float(recorded[0]), float(recorded[-1])
        recorded = recorded[recorded >= 0.0]
    times = request.output_times(recorded)
    reach = OUTPUT_TIME_TOLERANCE * (times[-1] - times[0]) / times.size
    if times[0] < begins - reach or times[-1] > ends + reach:
        raise CalibError(
            f"output is requested from {times[0]:.6g} to {times[-1]:.6g} s, but the input lasts from {begins:.6g} "
            f"to {ends:.6g} s; request less or record more"
        )
    return np.clip(times, begins, ends), begins
