"""Elastic slip on the friction device: its play is the same in tests that are not fitted together."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from calib.plugins import load as thing
from calib.study_file import load

STUDY = Path(__file__).parents[2] / "studies" / "backlash_damper" / "study.toml"


@pytest.fixture(scope="module")
def study(measured):
    for name in ("0.5Hz36lbtension1amplitude", "1Hz36lbtension1amplitude"):
        measured(f"backlash_damper/{name}.json")
    return load(STUDY)


def fitted(study, record, *play):
    """Residual force (n,) [N] of the best fit, relative to the measured force (n,) [N], and the values found."""
    reference = study.reference(record)
    model = study.study.model.extended(thing("calib.effects", "gap_offset"))
    force = reference.record.force.values[0]
    names = (*study.study.space.names, *play)
    scale = np.array([1e6, 1e4, 1e4, 1e-3][: len(names)])

    def error(x):
        values = dict(zip(names, np.abs(x) * scale, strict=True))
        return (model.run(values, reference.excitation, reference.request).force.values[0] - force) / force.std()

    fit = least_squares(error, [4.0, 1.3, 1.5, 2.0][: len(names)], diff_step=1e-3)
    return fit.fun, dict(zip(names, np.abs(fit.x) * scale, strict=True))


@pytest.mark.parametrize(("record", "left", "ratio"), [("one_hertz", 0.175, 3.0), ("half_hertz", 0.158, 4.5)])
def test_the_play_of_the_device_is_what_elastic_slip_lacks(study, record, left, ratio):
    without, _ = fitted(study, record)
    with_play, values = fitted(study, record, "dg")
    assert without.std() == pytest.approx(left, abs=0.005)
    assert without.var() / with_play.var() == pytest.approx(ratio, rel=0.1)
    assert values["dg"] == pytest.approx(2.3e-3, abs=0.05e-3)
    assert values["stiffness"] == pytest.approx(6.7e6, rel=0.1)
