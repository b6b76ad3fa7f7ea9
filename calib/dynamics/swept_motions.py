"""The motions that the sweeps of a measured response run through, whichever way they were controlled."""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import xarray as xr

from calib.dynamics.held_curve import HeldBranch
from calib.dynamics.held_sweeps import held_sweeps
from calib.dynamics.response import sampled
from calib.dynamics.setting import Setting
from calib.dynamics.swept_path import harmonics_of_piece
from calib.dynamics.swept_paths import KnownSweeps, swept_paths
from calib.dynamics.swept_series import SeriesStretch
from calib.errors import CalibError
from calib.modelling.model import Model
from calib.records import failed
from calib.records.excitation import Excitation
from calib.records.held_response import is_held
from calib.records.response import sweeps

NOT_PERIODIC = "not periodic"  # status of a response one of whose sweeps meets no periodic motion
NOT_HELD = "not held"  # the same where no motion has the amplitude that was held


class Stretch(NamedTuple):
    """Motions of one branch that a sweep runs through, m of them.

    Attributes
    ----------
    sweep, direction : its number, and 1.0 up or -1.0 down
    frequency, level : (m,) of the excitation  [Hz], [its unit]
    harmonics : (m, body, k) complex amplitudes of the displacement, the first of which is the mean  [m]
    """

    sweep: float
    direction: float
    frequency: np.ndarray
    level: np.ndarray
    harmonics: np.ndarray


class SweptMotions(NamedTuple):
    """Motions of all sweeps.

    Attributes
    ----------
    bodies : in the order of the harmonics
    stretches : in the order swept
    jumps : what ends the stretches, a sentence each
    curves : of those sweeps that are one stretch of series, and of those at a held amplitude
    failure : (status, reason) where there are none; None else
    """

    bodies: tuple[str, ...]
    stretches: tuple[Stretch, ...] = ()
    jumps: tuple[str, ...] = ()
    curves: KnownSweeps = MappingProxyType({})
    failure: tuple[str, str] | None = None

    @property
    def failed(self) -> xr.Dataset:
        """The record of a failure."""
        assert self.failure is not None
        return failed(self.bodies, *self.failure)


def swept_motions(
    model: Model,
    values: Mapping[str, float],
    excitation: Excitation,
    measured: xr.Dataset,
    highest: int,
    known: KnownSweeps = MappingProxyType({}),
    to_first_order: bool = False,
) -> SweptMotions:
    """Motions that sweeps of the levels and directions of a measured response run through, beyond its ends by a margin.

    Parameters
    ----------
    values : SI; the nominal value stands in for what they lack
    excitation : its place and quantity count; frequency and level are those of the record
    measured : frequency response, see `calib.records.response` and `calib.records.held_response`
    highest : harmonic, at most the lowest of `calib.dynamics.swept_series.SERIES_HARMONICS`
    known : curves that this function gave for other values: those of these values are sought beside them
    to_first_order : whether they are wanted to first order in what differs from the known ones, for a derivative

    Raises
    ------
    CalibError : an unknown parameter, or a simulator without a period map that samples its motion
    """
    frequency, level = float(measured["frequency"][0]), float(measured["level"][0])
    setting = Setting(model, replace(excitation, frequency=frequency, amplitude=level, phase=0.0), values)
    try:
        bodies = tuple(sampled(setting, setting.map()).bodies)
    except ValueError as error:  # nothing that could move
        return SweptMotions(tuple(model.bodies), failure=("impossible value", str(error)))
    if is_held(measured):
        return _at_held_amplitude(setting, bodies, measured, highest, known, to_first_order)
    stretches, jumps, curves = list[Stretch](), list[str](), dict[float, SeriesStretch]()
    for sweep, direction, curve, path in swept_paths(setting, bodies, measured, known, to_first_order):
        if path.reason:
            return SweptMotions(bodies, failure=(NOT_PERIODIC, f"sweep {sweep:g}: {path.reason}"))
        if len(path.pieces) == 1 and isinstance(path.pieces[0], SeriesStretch):
            curves[sweep] = path.pieces[0]
        jumps += [f"sweep {sweep:g}: {kind} at {at:.9g} Hz" for kind, at in path.jumps]
        for piece in path.pieces:
            levels = np.array([curve(own) for own in piece.frequency.tolist()])
            harmonics = harmonics_of_piece(setting, curve, piece, highest)
            stretches.append(Stretch(sweep, direction, piece.frequency, levels, harmonics))
    return SweptMotions(bodies, tuple(stretches), tuple(jumps), curves)


def _at_held_amplitude(
    setting: Setting, bodies: tuple[str, ...], measured: xr.Dataset, highest: int, known: KnownSweeps,
    to_first_order: bool,
) -> SweptMotions:  # fmt: skip
    stretches, curves = list[Stretch](), dict[float, HeldBranch]()
    near = {sweep: curve for sweep, curve in known.items() if isinstance(curve, HeldBranch)}
    try:
        for sweep, direction, branch in held_sweeps(setting, measured, near, to_first_order):
            way = slice(None, None, int(direction))
            harmonics = np.moveaxis(branch.harmonics[:, : highest + 1], -1, 0)
            stretches.append(Stretch(sweep, direction, branch.frequency[way], branch.level[way], harmonics[way]))
            curves[sweep] = branch
    except CalibError as error:
        number = sweeps(measured)[len(stretches)][0]
        return SweptMotions(bodies, failure=(NOT_HELD, f"sweep {number:g}: {error}"))
    return SweptMotions(bodies, tuple(stretches), curves=curves)
