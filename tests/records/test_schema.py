import numpy as np
import pytest

from calib.errors import CalibError
from calib.records import check, make

TIME = np.linspace(0.0, 0.1, 50)


def swing(**attrs):
    x = np.array([np.cos(60 * TIME), np.sin(60 * TIME)])
    attrs = {"frequency": 60 / (2 * np.pi), "amplitude": 1e-3, "place": "end", "quantity": "displacement", **attrs}
    return make(TIME, ["beam", "layer"], {"displacement": x, "velocity": 60 * x}, **attrs)


def broken(r, what):
    if what == "nan":
        r.displacement.values[1, 7] = np.nan
    if what == "time":
        r = r.assign_coords(time=("time", r.time.values[::-1], {"units": "s"}))
    if what == "turned":
        r = r.transpose("time", "body")
    if what == "unit":
        r.velocity.attrs["units"] = "mm"
    if what == "no unit":
        del r.velocity.attrs["units"]
    if what == "empty":
        r = r.drop_vars(["displacement", "velocity"])
    if what == "sigma":
        r["velocity_sigma"] = ("body", [0.1, 0.0], {"units": "m/s"})
    if what == "axes":
        r.attrs["nuisance_sigma"] = "shear: 1e-6"
    if what == "frequency":
        r.attrs["frequency"] = "26 Hz"
    return r


@pytest.mark.parametrize(
    ("what", "said"),
    [
        ("nan", "displacement of body 'layer' is not a number at sample 7"),
        ("time", "time must increase"),
        ("turned", "transpose it"),
        ("unit", "velocity is expected in 'm/s' or a unit of its dimension, got 'mm'"),
        ("no unit", "states no unit"),
        ("empty", "no channel"),
        ("sigma", "must be positive"),
        ("axes", "record: attribute nuisance_sigma: expected a JSON object"),
        ("frequency", "frequency: expected a number in SI from 1e-09 to 1e\\+09 Hz, got '26 Hz'"),
    ],
)
def test_what_breaks_the_schema_is_named(what, said):
    with pytest.raises(CalibError, match=said):
        check(broken(swing(), what))
