"""What models leave beside impacts, whose instants they have wrong, in a velocity that an impact turns."""

import numpy as np
import pytest

from calib.diagnosis.bench import SimulatedRows
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.excess import chi2_rise, chi2_std, excess_chi2, significant
from calib.diagnosis.fit import Fit
from calib.diagnosis.noise import STATED, Noise
from calib.diagnosis.part import Part
from calib.diagnosis.signature import Point

SIZE, IMPACT, SIGMA = 2000, 1000, 0.01  # samples, the number of that before which it is, m/s
SAMPLE = np.arange(SIZE)
REACH = 3  # samples beside a simulated impact in which its velocity is not reliable


def velocity(impact):
    """Velocity (1, n) that an impact turns from 1 to -1 m/s."""
    return np.where(impact > SAMPLE, 1.0, -1.0)[None]


def simulated(impact, error=0.0):
    trust = (np.abs(SAMPLE - impact + 0.5) > REACH).astype(float)
    return {"decay": SimulatedRows(velocity(impact) + error, trust)}


def evidence(calibrated):
    """Evidence about a calibrated model with its impact at this sample."""
    noise = np.random.default_rng(3).normal(0.0, SIGMA, (1, SIZE))
    [view], used = simulated(calibrated).values(), np.ones((1, SIZE), dtype=bool)
    rows = (("mass", "velocity"),)
    kinds = {"period": None, "cycle": 1, "nuisance": (), "noise": (Noise(SIGMA, np.array([]), STATED),)}
    weight = used * view.trust
    return Evidence((Part("decay", rows, 1e-3 * SAMPLE, velocity(IMPACT) + noise, used=used, weight=weight, **kinds),))


def fit(known, views):
    none = np.zeros((SIZE, 0))
    return Fit(Point({}, (), views), (), known.residual(views), none, (), (), none, known.rows())


def test_an_impact_at_an_instant_that_is_off_by_a_sample_is_no_misfit():
    known = evidence(calibrated=IMPACT + 20)
    model = fit(known, simulated(IMPACT + 1))
    assert model.chi2 > SIZE + 3e4  # (2 m/s / 0.01 m/s)^2 in one sample
    assert not significant(excess_chi2(known, model), chi2_std(known))
    assert excess_chi2(known, fit(known, simulated(IMPACT + 1, SIGMA))) == pytest.approx(SIZE, rel=0.2)


def test_two_models_are_compared_where_both_are_reliable():
    known = evidence(calibrated=IMPACT + 20)
    near, far = fit(known, simulated(IMPACT + 1)), fit(known, simulated(IMPACT - 2, SIGMA))
    assert near.chi2 < far.chi2 - 3e4  # of two samples beside one
    assert chi2_rise(known, near, far) == pytest.approx(SIZE, rel=0.2)
    assert chi2_rise(known, far, near) == -chi2_rise(known, near, far)


def test_no_sample_weighs_more_than_in_the_evidence_itself():
    known = evidence(calibrated=IMPACT + 20)
    [own], [part] = known.where_reliable([simulated(IMPACT)]).parts, known.parts
    assert np.flatnonzero(own.weight[0] == 0.0).tolist() == [*range(997, 1003), *range(1017, 1023)]
    assert (own.weight <= part.weight).all()
    assert (known.where_reliable([simulated(IMPACT + 20)]).parts[0].weight == part.weight).all()
