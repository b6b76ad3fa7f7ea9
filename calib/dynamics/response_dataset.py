"""A frequency response as one Dataset."""

from typing import Any

import numpy as np
import xarray as xr

from calib.dynamics.response import FrequencyResponse, Truncation


def response_dataset(response: FrequencyResponse) -> xr.Dataset:
    """Return the branches of all levels, one after another, as a Dataset.

    Its dimensions are body, harmonic, point (along the branches), branch, special (points at which the motion changes)
    and irregular (motions of the sweep that no branch follows). `frequency`, `level`, `branch` and `stable` lie over
    point; `amplitude` and `phase` of each harmonic of the displacement over (body, harmonic, point), the phase against
    the excitation; the amplitude of harmonic 0 is the mean, with its sign. Effects at the site "response" are in
    the harmonics above it, as they are in what is measured; in that mean and in `peak` they are not.
    """
    branches = response.branches
    sizes = [one.frequency.size for one in branches]
    begins = np.cumsum([0, *sizes])
    harmonics = np.concatenate([one.harmonics for one in branches], axis=-1)
    amplitude = np.abs(harmonics)
    amplitude[:, 0] = harmonics[:, 0].real
    specials = [(i, point) for i, one in enumerate(branches) for point in one.branch.points]
    of_unit, hertz, metre = {"units": response.unit}, {"units": "Hz"}, {"units": "m"}
    rows = {
        "amplitude": (("body", "harmonic", "point"), amplitude, metre),
        "phase": (("body", "harmonic", "point"), np.angle(harmonics), {"units": "rad"}),
        "peak": (("body", "point"), np.concatenate([one.peak for one in branches], axis=-1), metre),
        "stable": ("point", np.concatenate([one.branch.stable for one in branches])),
        "multiplier_modulus": (
            "point", np.concatenate([np.abs(one.branch.multipliers).max(axis=1) for one in branches]), {"units": "1"}),
        "impacts": ("point", np.concatenate([one.branch.impacts for one in branches]), {"units": "1"}),
        "branch_of_point": ("point", np.repeat(np.arange(len(branches)), sizes)),
        "branch_level": ("branch", np.array([one.level for one in branches]), of_unit),
        "branch_periods": ("branch", np.array([one.branch.periods for one in branches]), {"units": "1"}),
        "branch_isolated": ("branch", np.array([one.isolated for one in branches])),
        "first_end": ("branch", np.array([one.branch.ends[0] for one in branches], dtype=str)),
        "last_end": ("branch", np.array([one.branch.ends[1] for one in branches], dtype=str)),
        "special_branch": ("special", np.array([i for i, _ in specials], dtype=int)),
        "special_kind": ("special", np.array([point.kind for _, point in specials], dtype=str)),
        "special_frequency": ("special", np.array([point.parameter for _, point in specials], dtype=float), hertz),
        "special_point": ("special", np.array([begins[i] + point.index for i, point in specials], dtype=int)),
        "special_evidence": ("special", np.array([point.evidence for _, point in specials], dtype=str)),
        "irregular_level": ("irregular", np.array([one.level for one in response.irregular], dtype=float), of_unit),
        "irregular_frequency": (
            "irregular", np.array([one.frequency for one in response.irregular], dtype=float), hertz),
        "irregular_kind": ("irregular", np.array([one.kind for one in response.irregular], dtype=str)),
        "irregular_evidence": ("irregular", np.array([one.evidence for one in response.irregular], dtype=str)),
    }  # fmt: skip
    return xr.Dataset(
        rows,
        coords={
            "frequency": ("point", np.concatenate([one.frequency for one in branches]), hertz),
            "level": ("point", np.repeat([one.level for one in branches], sizes), of_unit),
            "body": list(response.bodies),
            "harmonic": np.arange(harmonics.shape[1]),
        },
        attrs={
            "lowest_frequency": response.window[0],
            "highest_frequency": response.window[1],
            **_method(response.truncation),
        },
    )


def _method(truncation: Truncation | None) -> dict[str, Any]:
    """Attributes that say how the motions were found."""
    if truncation is None:
        return {"method": "shooting"}
    return {
        "method": "harmonic balance",
        "balanced_harmonics": truncation.harmonics,
        "largest_change_by_shooting": truncation.largest,
    }
