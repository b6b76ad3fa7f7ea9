"""The response that a measured sweep would have met: that of the motions which `calib.dynamics.swept_motions` has."""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
import xarray as xr

from calib.dynamics.swept_motions import swept_motions
from calib.dynamics.swept_paths import KnownSweeps
from calib.modelling.model import Model
from calib.records.excitation import Excitation
from calib.records.held_response import is_held
from calib.records.response import (
    complex_harmonics,
    harmonic_orders,
    make_response,
    median_of_sweeps,
    with_harmonics,
)


def swept_response(
    model: Model, values: Mapping[str, float], excitation: Excitation, measured: xr.Dataset
) -> xr.Dataset:
    """Return the response of `swept_curves`, sought without a known one."""
    return swept_curves(model, values, excitation, measured)[0]


def swept_curves(
    model: Model,
    values: Mapping[str, float],
    excitation: Excitation,
    measured: xr.Dataset,
    known: KnownSweeps = MappingProxyType({}),
    to_first_order: bool = False,
) -> tuple[xr.Dataset, KnownSweeps]:
    """Response that sweeps of the levels and directions of a measured one run through, beyond its ends by a margin.

    Parameters
    ----------
    as those of `calib.dynamics.swept_motions.swept_motions`

    Returns
    -------
    response of the same sweeps, and with the same harmonics, at the points of the continuation, as effects at the site
    "response" have it measured; `piece` (point,) numbers its stretches, and the attribute `jumps` says where they end.
    A sweep ends where motions are not periodic; a failed record where none of it is, or nothing could move. Of sweeps
    at a held amplitude it is the response at one level, as the measured one is.
    curves of those sweeps that are one stretch of series, and of those at a held amplitude

    Raises
    ------
    CalibError : as that function
    """
    orders = harmonic_orders(measured)
    motions = swept_motions(model, values, excitation, measured, orders[-1], known, to_first_order)
    if motions.failure:
        return motions.failed, {}
    own = motions.stretches
    count = [stretch.frequency.size for stretch in own]
    harmonics = np.concatenate([stretch.harmonics for stretch in own]).T  # (k, body, m)
    record = make_response(
        np.concatenate([stretch.frequency for stretch in own]), motions.bodies, harmonics[1],
        np.concatenate([stretch.level for stretch in own]), str(measured["level"].attrs["units"]),
        np.repeat([stretch.sweep for stretch in own], count), np.repeat([stretch.direction for stretch in own], count),
        jumps="; ".join(motions.jumps), source=f"simulated by {model.simulator.name}",
        place=excitation.place, quantity=excitation.quantity, higher={order: harmonics[order] for order in orders[1:]},
    ).assign(piece=("point", np.repeat(np.arange(float(len(own))), count)))  # fmt: skip
    record = model.measured_response(record, values)
    return _at_levels_of(measured, record) if is_held(measured) else record, dict(motions.curves)


def _at_levels_of(measured: xr.Dataset, simulated: xr.Dataset) -> xr.Dataset:
    """Put a response at the one level that each sweep of a measured one is at."""
    level = median_of_sweeps(measured, measured["level"].values, simulated["sweep"].values)
    scaled = with_harmonics(simulated, complex_harmonics(simulated) * level / simulated["level"].values)
    return scaled.assign(level=simulated["level"].copy(data=level))
