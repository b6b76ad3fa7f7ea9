"""Frequency and damping ratio over amplitude as a Dataset, the same whatever the method."""

from collections.abc import Mapping

import numpy as np
import xarray as xr


def curves_dataset(
    time: np.ndarray,
    amplitude: np.ndarray,
    frequency: np.ndarray,
    damping_ratio: np.ndarray,
    frequency_sigma: np.ndarray | None = None,
    damping_ratio_sigma: np.ndarray | None = None,
    *,
    attrs: Mapping[str, str | float],
) -> xr.Dataset:
    """Return curves over the dimension point, with the standard uncertainties that are known.

    time : (m,) when the decay passes each amplitude  [s]
    amplitude : (m,) of the fundamental  [unit of the channel]
    frequency, damping_ratio : (m,) damped frequency  [Hz]; -A' / A over the modulus of i omega + A' / A  [1]
    attrs : method, unit of the amplitude, ...
    """
    variables = {
        "frequency": (frequency, "Hz"),
        "damping_ratio": (damping_ratio, "1"),
        "frequency_sigma": (frequency_sigma, "Hz"),
        "damping_ratio_sigma": (damping_ratio_sigma, "1"),
    }
    return xr.Dataset(
        {name: ("point", values, {"units": unit}) for name, (values, unit) in variables.items() if values is not None},
        coords={"time": ("point", time, {"units": "s"}), "amplitude": ("point", amplitude)},
        attrs=dict(attrs),
    )
