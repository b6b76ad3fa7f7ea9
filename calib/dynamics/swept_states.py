"""States that sweeps run through: displacements and velocities along their motions."""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
import xarray as xr

from calib.dynamics.response import sampled
from calib.dynamics.swept_response import (
    NOT_PERIODIC,
    KnownSweeps,
    harmonics_of_piece,
    setting_of_sweeps,
    swept_paths,
)
from calib.dynamics.swept_series import SERIES_HARMONICS
from calib.modelling.model import Model
from calib.records import OK, failed
from calib.records.excitation import Excitation
from calib.records.response import states_of_motions


def swept_states(
    model: Model,
    values: Mapping[str, float],
    excitation: Excitation,
    measured: xr.Dataset,
    known: KnownSweeps = MappingProxyType({}),
) -> xr.Dataset:
    """States along the motions that the sweeps of `calib.dynamics.swept_response.swept_curves` run through.

    Parameters
    ----------
    as those of that function

    Returns
    -------
    displacement [m] and velocity [m/s] (body, state) of the motions themselves, in the order of
    `calib.records.response.states_of_motions`; a failed record where a sweep meets no periodic motion

    Raises
    ------
    CalibError : as that function
    """
    setting = setting_of_sweeps(model, values, excitation, measured)
    try:
        bodies = sampled(setting, setting.map()).bodies
    except ValueError as error:  # nothing that could move
        return failed(model.bodies, "impossible value", str(error))
    frequency, harmonics = list[np.ndarray](), list[np.ndarray]()
    for sweep, _, level, path in swept_paths(setting, bodies, measured, known):
        if path.reason:
            return failed(bodies, NOT_PERIODIC, f"sweep {sweep:g}: {path.reason}")
        for piece in path.pieces:
            frequency.append(piece.frequency)
            harmonics.append(harmonics_of_piece(setting, level, piece, SERIES_HARMONICS[0]))
    motions = np.moveaxis(np.concatenate(harmonics), 0, -1)
    displacement, velocity = states_of_motions(np.concatenate(frequency), motions)
    return xr.Dataset(
        {
            "displacement": (("body", "state"), displacement, {"units": "m"}),
            "velocity": (("body", "state"), velocity, {"units": "m/s"}),
        },
        coords={"body": list(bodies)},
        attrs={"status": OK},
    )
