"""What a free decay says of its dominant mode, in sentences."""

from collections.abc import Iterator

import numpy as np
import xarray as xr

from calib.errors import CalibError
from calib.records.decay import BodyDecay, body_decays
from calib.units import shown

TOLD_AMPLITUDES = 3  # largest, middle and smallest, of which frequency and damping ratio are told


def decay_description(record: xr.Dataset) -> Iterator[str]:
    """Tell frequency and damping ratio at some amplitudes, what is left out, and other modes; a sentence each."""
    for one in body_decays(record):
        if isinstance(one, CalibError):
            yield f"no frequency and damping over amplitude: {one}"
        else:
            yield from _told(record, one)


def _told(record: xr.Dataset, one: BodyDecay) -> Iterator[str]:
    curves, unit = one.curves, str(record[one.channel].attrs.get("units", "1"))
    for point in np.linspace(0, curves.sizes["point"] - 1, TOLD_AMPLITUDES).round().astype(int):
        here = curves.isel(point=point)
        yield (
            f"{one.body} at an amplitude of {shown(float(here.amplitude), unit, 3)}: {float(here.frequency):.5g} "
            f"+- {2.0 * float(here.frequency_sigma):.1g} Hz, damping ratio {100.0 * float(here.damping_ratio):.3g} "
            f"+- {200.0 * float(here.damping_ratio_sigma):.1g} % (two standard uncertainties)"
        )
    noise = shown(float(curves.attrs["noise"]), unit, 2)
    left_out = []
    if "cut" in curves.attrs:
        floor = shown(float(curves.attrs["floor"]), unit, 2)
        left_out.append(f"what follows {curves.attrs['cut']:.4g} s, where the amplitude falls below {floor}")
    if curves.attrs["outliers"]:
        left_out.append(f"{curves.attrs['outliers']} outliers")
    yield (
        f"noise of {one.channel} about the frequency of the motion: {noise}"
        + (f"; left out of the decay: {' and '.join(left_out)}" if left_out else "")
    )
    if curves.attrs["other_modes"]:
        yield (
            f"the decay is that of the dominant mode of {one.body}, at {one.smoothed.dominant:.4g} Hz; others are at "
            f"{curves.attrs['other_modes']} Hz"
        )
