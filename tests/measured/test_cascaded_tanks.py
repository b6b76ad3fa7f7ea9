"""Two tanks that never spill, against two that do."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from third_party.cascaded_tanks import OVERFLOW

from calib.study_file import load

STUDY = Path(__file__).parents[2] / "studies" / "cascaded_tanks" / "study.toml"
DRY = [0.05, 0.09, 0.075, 14.0, 5.1]
SPILLING = [0.05, 0.05, 0.042, 4.8, 5.2, 1.0, 10.0]


@pytest.fixture(scope="module")
def study(measured):
    measured("cascaded_tanks/dataBenchmark.csv")
    return load(STUDY)


def errors(study, begin, *extra):
    """Error (n,) [m] of the best fit of the estimation record, that of the same values on the other one, the values."""
    model, names = study.study.model.extended(OVERFLOW), (*study.study.space.names, *extra)

    def error(x, record="estimation"):
        reference = study.reference(record)
        run = model.run(dict(zip(names, x, strict=True)), reference.excitation, reference.request)
        return run.displacement.sel(body="lower").values - reference.record.displacement.values[0]

    most = [*5.0 * np.array(begin[:5]), *(p.high for p in OVERFLOW.parameters if p.name in extra)]
    fit = least_squares(error, begin, x_scale=begin, bounds=(0.0, most), ftol=1e-4)
    return fit.fun, error(fit.x, "validation"), dict(zip(names, fit.x, strict=True))


def rms(values):
    return float(np.sqrt(np.mean(values**2)))


def test_spill_brings_both_records_nearer(study):
    dry, spilling = errors(study, DRY), errors(study, SPILLING, "spill_rate", "brim")
    assert [rms(e) for e in dry[:2]] == pytest.approx([0.603, 0.669], abs=0.005)
    assert [rms(e) for e in spilling[:2]] == pytest.approx([0.496, 0.56], abs=0.01)
    level = study.reference("estimation").record.displacement.values[0]
    full = level > 9.99
    assert full.mean() == pytest.approx(0.047, abs=0.001)
    assert rms(dry[0][full]) == pytest.approx(1.18, abs=0.02)
    assert rms(spilling[0][full]) < 0.7 * rms(dry[0][full])
