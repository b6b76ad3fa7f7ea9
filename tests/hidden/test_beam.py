"""The hider's beam: it moves in all its elements, and has what no parameter and no effect of the seeker is."""

import numpy as np
import pytest
from hidden.beam import PLANS, REDUCED, TRUTH, system
from hidden.drawn import SHARES
from hidden.hider import bench
from hidden.remainder import change, expressed_by, scaled

from calib.modelling.model import Model
from calib.modelling.simulator import Request
from calib.records.excitation import Excitation
from calib.simulators.delaminated_beam import DelaminatedBeam


def test_without_anything_hidden_it_is_the_model_of_the_seeker():
    beam = system()
    excitation = Excitation("centre", "displacement", frequency=PLANS[0].frequency, amplitude=PLANS[0].amplitude)
    record = Model(DelaminatedBeam(**REDUCED)).run(TRUTH, excitation, Request(periods=1, samples=200))
    displacement, _ = beam.moved(PLANS[0], TRUTH, {}).look(record.time.values)
    assert displacement[1] == pytest.approx(record.displacement.values[1], abs=1e-7)


def test_a_gap_of_its_own_is_that_of_the_model_where_it_does_not_depart():
    beam, times = system(), np.linspace(0.0, 0.009, 50)
    one, other = (beam.moved(PLANS[0], TRUTH, hidden) for hidden in ({}, {"wave": 1e-15, "wave_order": 3.0}))
    np.testing.assert_allclose(one.look(times)[0], other.look(times)[0], atol=1e-7)


@pytest.mark.slow
def test_all_elements_and_what_else_the_beam_has_are_no_effect(tmp_path):
    at = bench("delaminated_beam", tmp_path)
    assert 0.0 < change(at, {"full": 1.0}) < SHARES[0]
    for kind in at.system.remainders:
        values = scaled(at, kind, SHARES[2], np.random.default_rng(0))
        assert values["full"] == 1.0
        assert expressed_by(at, values, 1)[1] < 0.7
