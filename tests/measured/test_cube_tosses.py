"""A tossed cube: where the ground is, how late the velocity comes, how fast it falls."""

import importlib.util
import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from calib.plugins import load as thing
from calib.study_file import load

STUDY = Path(__file__).parents[2] / "studies" / "cube_tosses"
FILE = "cube_tosses/cube_tosses_000_079.csv"


@pytest.fixture(scope="module")
def study(measured, tmp_path_factory):
    folder = tmp_path_factory.mktemp("cube_tosses")
    shutil.copy(STUDY / "study.toml", folder)
    spec = importlib.util.spec_from_file_location("make_records", STUDY / "make_records.py")
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    script.make_records(measured(FILE), folder / "out")
    return load(folder)


@pytest.fixture(scope="module")
def flights(measured):
    measured(FILE)
    study = load(STUDY / "flight.toml")
    return [study.reference(name).record for name in ("toss_04", "toss_12", "toss_05")]


def fitted(study, record, restitution, *gap):
    """Error (n,) [m] of the height of the best fit of one toss from a start at `restitution`, and the values."""
    reference = study.reference(record)
    model = study.study.model.extended(thing("calib.effects", "gap_offset"))
    height = reference.record.displacement.values[0]
    names = ("restitution", "initial_height", "initial_velocity", *gap)

    def error(x):
        values = dict(zip(names, [min(max(x[0], 0.0), 1.0), *x[1:]], strict=True))
        return model.run(values, reference.excitation, reference.request).displacement.values[0] - height

    begin = [restitution, height[0], reference.record.velocity.values[0, 0] - 0.03, *(0.002 for _ in gap)]
    fit = least_squares(error, begin, x_scale=[0.1, 0.01, 0.1, 0.001][: len(begin)], diff_step=1e-4)
    return fit.fun, dict(zip(names, fit.x, strict=True))


@pytest.mark.parametrize("record", ["toss_04", "toss_12", "toss_05"])
def test_the_ground_lies_two_millimetres_lower_than_stated(study, record):
    plain = min((fitted(study, record, e)[0] for e in (0.0, 0.15)), key=np.linalg.norm)
    lower, values = min((fitted(study, record, e, "dg") for e in (0.0, 0.15)), key=lambda f: np.linalg.norm(f[0]))
    assert 1.5e-3 < values["dg"] < 3.2e-3
    assert np.linalg.norm(lower) < 0.6 * np.linalg.norm(plain)


@pytest.mark.parametrize("name", ["toss_04", "toss_12", "toss_05"])
def test_the_lowest_corner_rests_below_the_table(study, name):
    record = study.reference(name).record
    rest = (record.displacement.values[0] - record.excitation.values)[-20:]
    assert np.ptp(rest) < 1e-4
    assert -2.7e-3 < rest.mean() < -1.2e-3  # over all tosses -1.8 mm


def test_the_velocity_is_the_backward_difference_of_the_position(flights):
    for record in flights:
        x, v = record.displacement.values[0], record.velocity.values[0]
        rate = np.diff(x) / np.diff(record.time.values)
        backward, central = v[1:] - rate, v[1:-1] - 0.5 * (rate[1:] + rate[:-1])
        assert np.abs(backward).mean() < 0.5 * np.abs(central).mean()


def test_the_cube_falls_two_per_cent_slower_than_gravity(flights):
    fall = [np.polyfit(r.time, 2 * r.displacement.values[0], 2)[0] for r in flights]
    np.testing.assert_allclose(fall, -9.62, atol=0.06)  # 183.6 half widths per s^2
