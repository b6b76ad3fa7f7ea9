"""Backbones and constant-response curves of a body as one Dataset."""

from collections.abc import Sequence

import numpy as np
import xarray as xr

from calib.dynamics.held_curve import HeldBranch

PHASE_RESONANCE, CONSTANT_RESPONSE = "phase resonance", "constant response"


def backbone_dataset(backbones: Sequence[HeldBranch], held: Sequence[HeldBranch], unit: str) -> xr.Dataset:
    """Return curves of one body, one after another, as a Dataset.

    Its dimensions are body, harmonic, point (along the curves) and curve. `frequency`, `level`, `curve_of_point`,
    `stable` and `left_out` lie over point; `amplitude` and `phase` of each harmonic of the displacement over (body,
    harmonic, point), the phase against the excitation; the amplitude of harmonic 0 is the mean, with its sign.

    unit : of the level
    """
    curves = [*backbones, *held]
    harmonics = np.concatenate([one.harmonics for one in curves], axis=-1)
    amplitude = np.abs(harmonics)
    amplitude[:, 0] = harmonics[:, 0].real
    kinds = [PHASE_RESONANCE] * len(backbones) + [CONSTANT_RESPONSE] * len(held)
    return xr.Dataset(
        {
            "amplitude": (("body", "harmonic", "point"), amplitude, {"units": "m"}),
            "phase": (("body", "harmonic", "point"), np.angle(harmonics), {"units": "rad"}),
            "stable": ("point", np.concatenate([one.stable for one in curves])),
            "left_out": ("point", np.concatenate([one.left_out for one in curves]), {"units": "1"}),
            "curve_of_point": ("point", np.repeat(np.arange(len(curves)), [one.level.size for one in curves])),
            "kind": ("curve", np.array(kinds, dtype=str)),
            "end": ("curve", np.array([one.end for one in curves], dtype=str)),
        },
        coords={
            "frequency": ("point", np.concatenate([one.frequency for one in curves]), {"units": "Hz"}),
            "level": ("point", np.concatenate([one.level for one in curves]), {"units": unit}),
            "body": list(curves[0].bodies),
            "harmonic": np.arange(harmonics.shape[1]),
        },
        attrs={"held_body": curves[0].body},
    )
