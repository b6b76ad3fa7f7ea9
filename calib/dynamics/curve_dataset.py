"""Curves of bifurcations as one Dataset."""

from collections.abc import Sequence

import numpy as np
import xarray as xr

from calib.dynamics.codimension import TEST_FUNCTIONS
from calib.dynamics.curves import BifurcationCurve
from calib.dynamics.defining import ParameterPlane


def curves_dataset(
    curves: Sequence[BifurcationCurve], plane: ParameterPlane, names: tuple[str, str], units: tuple[str, str]
) -> xr.Dataset:
    """Return curves over `names` [units], one or more, as a Dataset.

    Its dimensions are step (along the curves, one after another), curve, component, multiplier, test (a kind of point
    of codimension two) and special (a point of that kind); a test that a curve does not have is NaN.
    """
    kinds = [kind for kind in TEST_FUNCTIONS if any(kind in curve.tests for curve in curves)]
    begins = np.cumsum([0, *(curve.a.size for curve in curves)])
    specials = [(i, point) for i, curve in enumerate(curves) for point in curve.points]
    multipliers = np.concatenate([curve.multipliers for curve in curves])
    tests = [
        np.column_stack([curve.tests.get(kind, np.full(curve.a.size, np.nan)) for kind in kinds]) for curve in curves
    ]
    rows = {
        "curve_of_step": ("step", np.repeat(np.arange(len(curves)), np.diff(begins))),
        "state": (("step", "component"), np.concatenate([curve.states for curve in curves]), {
            "units": "that of the component"}),
        "multiplier_modulus": (("step", "multiplier"), np.abs(multipliers), {"units": "1"}),
        "multiplier_angle": (("step", "multiplier"), np.angle(multipliers), {"units": "rad"}),
        "bounding": ("step", np.concatenate([curve.bounding for curve in curves])),
        "impacts": ("step", np.concatenate([curve.impacts for curve in curves]), {"units": "1"}),
        "test_value": (("step", "test"), np.concatenate(tests), {"units": "1"}),
        "curve_kind": ("curve", np.array([curve.kind for curve in curves], dtype=str)),
        "curve_periods": ("curve", np.array([curve.periods for curve in curves]), {"units": "1"}),
        "curve_start": ("curve", np.array([curve.start for curve in curves]), {"units": units[0]}),
        "first_end": ("curve", np.array([curve.ends[0] for curve in curves], dtype=str)),
        "last_end": ("curve", np.array([curve.ends[1] for curve in curves], dtype=str)),
        "special_curve": ("special", np.array([i for i, _ in specials], dtype=int)),
        "special_kind": ("special", np.array([point.kind for _, point in specials], dtype=str)),
        "special_index": ("special", np.array([begins[i] + point.index for i, point in specials], dtype=int)),
        "special_test": ("special", np.array([point.test for _, point in specials], dtype=str)),
        "special_evidence": ("special", np.array([point.evidence for _, point in specials], dtype=str)),
    }  # fmt: skip
    for k, axis in enumerate("ab"):
        unit = {"units": units[k]}
        errors = np.concatenate([curve.errors[k] for curve in curves])
        rows[f"{axis}_error"] = ("step", errors, unit)
        rows[f"special_{axis}"] = ("special", np.array([getattr(p, axis) for _, p in specials], dtype=float), unit)
        rows[f"{axis}_window"] = ("end", np.array(getattr(plane, axis), dtype=float), unit)
    places = {
        axis: (
            "step",
            np.concatenate([getattr(curve, axis) for curve in curves]),
            {"units": units[k], "name": names[k]},
        )
        for k, axis in enumerate("ab")
    }
    components = {"component": list(curves[0].names), "component_unit": ("component", list(curves[0].units))}
    return xr.Dataset(rows, coords={**places, **components, "test": kinds})
