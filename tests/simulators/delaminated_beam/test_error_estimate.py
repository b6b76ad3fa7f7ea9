"""The estimated error of the reduced kernel against the full one."""

import numpy as np
import pytest
from short_beam import beam, run

from calib.modelling.model import Model
from calib.modelling.simulator import Request
from calib.records.excitation import Excitation
from calib.simulators.delaminated_beam import DelaminatedBeam

PAPER = Excitation("centre", "displacement", frequency=26.51, amplitude=0.92e-3)
REQUEST = Request(periods=4, samples=400)


def test_without_a_tolerance_there_is_no_estimate():
    without, with_one = (run(beam(masters=8, **t)).attrs for t in ({}, {"tolerance": 0.9}))
    assert with_one.keys() - without.keys() == {"error_estimate"}


def test_a_tolerance_that_is_met_leaves_the_lowest_level():
    lowest, loose = run(beam(masters=8)), run(beam(masters=8, tolerance=0.9))
    assert loose.attrs["modes"] == lowest.attrs["modes"]
    assert 0.0 < loose.attrs["error_estimate"] <= 0.9
    np.testing.assert_array_equal(loose.displacement.values, lowest.displacement.values)


def test_levels_rise_until_the_tolerance_is_met_or_there_are_no_more():
    steps = [run(beam(masters=16, outer=8, tolerance=t), dt=1.4e-6).attrs for t in (0.9, 1e-9)]
    assert steps[0]["modes"] < steps[1]["modes"] == 128
    assert 1e-9 < steps[1]["error_estimate"] < 0.05


def test_a_motion_that_does_not_return_has_no_estimate():
    attrs = run(beam(tolerance=0.01, settle_limit=2), alpha=1.0).attrs
    assert attrs["stationary"] == 0
    assert np.isnan(attrs["error_estimate"])


def draw(seed):
    """Draw values of a motion at random."""
    rng = np.random.default_rng(seed)

    def between(low, high):
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    height = rng.uniform(0.1e-3, 0.8e-3)
    return {
        "alpha": between(20.0, 750.0),
        "beta": rng.uniform(0.0, 0.3),
        "f": between(0.003, 0.1),
        "c_con": between(0.5, 20.0),
        "g_max": height,
        "s": 1e-3 - height if rng.random() < 0.5 else rng.uniform(0.0, 1e-3),
        "dt": rng.uniform(2e-7, 3.1e-7),
        "amplitude": rng.uniform(0.75, 1.4),
    }


def difference(one, other):
    """As `loop_difference`, of the records' layers."""
    total = 0.0
    for channel in ("displacement", "velocity"):
        a, b = (record[channel].sel(body="layer").values for record in (one, other))
        total += 0.5 * np.mean((a - b) ** 2) / np.var(b)
    return np.sqrt(total)


@pytest.mark.slow
def test_the_estimate_is_right_within_a_factor_of_two():
    ratios, seed = [], 1000
    pairs = [
        (Model(DelaminatedBeam(layer=x, tolerance=0.9)), Model(DelaminatedBeam("full", layer=x, settle_limit=60)))
        for x in ("straight", "arched")
    ]
    while len(ratios) < 5:
        seed += 1
        reduced, full = pairs[seed % 2]
        values = draw(seed)
        found = reduced.run(values, PAPER, REQUEST)
        attrs = found.attrs
        if attrs["status"] != "ok" or not attrs["stationary"] or np.isnan(attrs["error_estimate"]):
            continue
        if attrs["contact_fraction"] == 0.0 or attrs["settled_periods"] > 30:
            continue
        truth = full.run(values, PAPER, REQUEST)
        if truth.attrs["status"] == "ok" and truth.attrs["stationary"] and truth.attrs["settled_periods"] < 60:
            ratios.append(attrs["error_estimate"] / difference(found, truth))
    assert (np.abs(np.log(ratios)) < np.log(2.0)).sum() >= 4, ratios
