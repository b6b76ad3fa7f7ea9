"""Free fall against measured drops: the light balls need drag, the bowling ball nothing."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.parameter import Parameter
from calib.study_file import load

STUDIES = Path(__file__).parents[2] / "studies" / "falling_balls"


@force
def resistance(t, x, v, p, z, dz):
    """Return linear and quadratic drag per unit mass [m/s^2]: -p[0] v - p[1] v |v|."""
    return -p[0] * v - p[1] * v * abs(v)


DRAG = Effect(
    "drag", "force", resistance,
    (Parameter("c1", "1/s", 0.0, "linear", null=0.0), Parameter("c2", "1/m", 0.0, "quadratic", null=0.0)), "drag",
)  # fmt: skip


def fitted(measured, file, drop, *drag):
    """Root mean square [m] that the best fit of a drop leaves, and the values of `drag`."""
    measured("falling_balls/ball_drops.csv")
    study = load(STUDIES / f"{file}.toml")
    reference, model = study.reference(drop), study.study.model.extended(DRAG)
    height = reference.record.displacement.values[0]
    names = ("initial_displacement", "initial_velocity", *drag)

    def error(x):
        values = {k: v for k, v in study.study.space.fixed.items() if "@" not in k} | dict(zip(names, x, strict=True))
        return model.run(values, reference.excitation, reference.request).displacement.values[0] - height

    begin = [height[0], 0.0, *(0.1 if name == "c1" else 0.01 for name in drag)]
    fit = least_squares(error, begin, x_scale=[10.0, 1.0, *(0.1 for _ in drag)], ftol=1e-5)
    return np.sqrt(np.mean(fit.fun**2)), fit.x[2:]


@pytest.mark.parametrize(
    ("file", "drop", "none", "linear", "quadratic"),
    [
        ("study", "first", 3.02, 0.07, 0.18),  # a whiffle ball
        ("study", "second", 2.47, 0.06, 0.19),
        ("volleyball", "first", 0.93, 0.15, 0.23),
        ("volleyball", "second", 1.10, 0.06, 0.14),
        ("tennis", "first", 0.91, 0.09, 0.15),
        ("tennis", "second", 1.18, 0.14, 0.25),
    ],
)
def test_a_light_ball_needs_drag(measured, file, drop, none, linear, quadratic):
    found = [fitted(measured, file, drop, *drag)[0] for drag in ((), ("c1",), ("c2",))]
    assert found == pytest.approx([none, linear, quadratic], abs=0.006)


def test_drag_of_the_bowling_ball_has_another_sign_in_each_drop(measured):
    found = {drop: fitted(measured, "bowling", drop, "c1") for drop in ("first", "second")}
    assert found["first"][1] < 0.0 < found["second"][1]
    for drop, (left, _) in found.items():
        assert left > 0.7 * fitted(measured, "bowling", drop)[0]
