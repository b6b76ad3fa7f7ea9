"""States that sweeps run through: displacements and velocities along their motions."""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
import xarray as xr

from calib.dynamics.swept_motions import swept_motions
from calib.dynamics.swept_paths import KnownSweeps
from calib.dynamics.swept_series import SERIES_HARMONICS
from calib.modelling.model import Model
from calib.records import OK
from calib.records.excitation import Excitation
from calib.records.response import states_of_motions


def swept_states(
    model: Model,
    values: Mapping[str, float],
    excitation: Excitation,
    measured: xr.Dataset,
    known: KnownSweeps = MappingProxyType({}),
) -> xr.Dataset:
    """States along the motions that the sweeps of a measured response run through.

    Parameters
    ----------
    as those of `calib.dynamics.swept_motions.swept_motions`

    Returns
    -------
    displacement [m] and velocity [m/s] (body, state) of the motions themselves, in the order of
    `calib.records.response.states_of_motions`; a failed record where a sweep meets no periodic motion

    Raises
    ------
    CalibError : as that function
    """
    motions = swept_motions(model, values, excitation, measured, SERIES_HARMONICS[0], known)
    if motions.failure:
        return motions.failed
    harmonics = np.moveaxis(np.concatenate([stretch.harmonics for stretch in motions.stretches]), 0, -1)
    frequency = np.concatenate([stretch.frequency for stretch in motions.stretches])
    displacement, velocity = states_of_motions(frequency, harmonics)
    return xr.Dataset(
        {
            "displacement": (("body", "state"), displacement, {"units": "m"}),
            "velocity": (("body", "state"), velocity, {"units": "m/s"}),
        },
        coords={"body": list(motions.bodies)},
        attrs={"status": OK},
    )
