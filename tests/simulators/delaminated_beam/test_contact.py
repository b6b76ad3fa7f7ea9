"""Contact pairs, gaps, stiffnesses and damping: of the whole beam, of its half, and by their formulas."""

import numpy as np
import pytest
from simulators.delaminated_beam.beams import ALUMINIUM, LAYER, WIDTH, beam

from calib.modelling.laws import BoundLaw, gap
from calib.simulators.delaminated_beam.contact import clearance, critical_damping, penalty

HALF, WHOLE = beam().structure, beam(symmetric=False).structure
PAIRS, ALL = HALF.pairs, WHOLE.pairs
STEP = 3.1e-7  # s


@gap
def linear_gap(place, p):
    """A gap that grows along the delamination."""
    return p[0] * place


def bulk(pairs, factor=0.01):
    return penalty(pairs, "bulk", factor, ALUMINIUM, WIDTH, LAYER, STEP)


@pytest.mark.parametrize("structure", [HALF, WHOLE])
def test_every_node_of_the_layer_faces_the_point_of_the_beam_below_it(structure):
    pairs, nodes = structure.pairs, structure.mesh.nodes
    faced = (1.0 - pairs.weight)[:, None] * nodes[pairs.master] + pairs.weight[:, None] * nodes[pairs.following]
    assert faced == pytest.approx(nodes[pairs.slave], abs=1e-12)
    assert pairs.place == pytest.approx(nodes[pairs.slave, 0] / 0.28, abs=1e-12)
    assert ((pairs.weight >= 0.0) & (pairs.weight <= 1.0)).all()


def test_the_lengths_add_up_to_the_delamination():
    """But for the ends, where layer and beam are one node: half a spacing at each."""
    assert (ALL.share * ALL.length).sum() == pytest.approx(0.56 - 2.5e-3, rel=1e-12)
    assert (PAIRS.share * PAIRS.length).sum() == pytest.approx(0.28 - 1.25e-3, rel=1e-12)


def test_the_pairs_of_the_half_are_those_of_the_whole():
    right = ALL.place > -1e-12
    assert PAIRS.mass == pytest.approx(ALL.mass[:, right], rel=1e-12)
    middle = PAIRS.share == 0.5
    assert np.flatnonzero(middle).tolist() == [0]
    assert bulk(PAIRS)[~middle] == pytest.approx(bulk(ALL)[right][~middle], rel=1e-12)
    assert bulk(PAIRS)[0] == pytest.approx(0.5 * bulk(ALL)[right][0], rel=1e-12)
    critical = [critical_damping(pairs, bulk(pairs)) for pairs in (PAIRS, ALL)]
    assert critical[0][1:] == pytest.approx(critical[1][right][1:], rel=1e-12)
    assert critical[0][0] == pytest.approx(0.5 * critical[1][right][0], rel=1e-12)


def test_nothing_pushes_where_layer_and_beam_are_one():
    assert np.flatnonzero(bulk(PAIRS) == 0.0).tolist() == [112]
    assert np.flatnonzero(bulk(ALL) == 0.0).tolist() == [0, 224]


def test_the_bulk_stiffness_is_that_of_the_layers_material():
    assert ALUMINIUM.bulk == pytest.approx(58.33e9, rel=1e-4)
    assert bulk(PAIRS, 0.1)[50] == pytest.approx(0.1 * ALUMINIUM.bulk * 2.5e-3 * WIDTH / LAYER, rel=1e-12)


def test_the_stiffness_by_mass_and_step_gives_every_pair_one_frequency():
    k = penalty(PAIRS, "mass_dt", 0.1, ALUMINIUM, WIDTH, LAYER, STEP)
    inner = PAIRS.share == 1.0
    frequency = np.sqrt(k / PAIRS.reduced_mass)[inner]
    assert frequency * STEP == pytest.approx(np.full(inner.sum(), np.sqrt(0.1 / 2.0)), rel=1e-12)


def test_c_crit_is_between_the_true_critical_damping_and_twice_that():
    k = bulk(ALL)
    inner = ALL.share == 1.0
    true = 2.0 * np.sqrt(k * ALL.reduced_mass)[inner]
    ratio = critical_damping(ALL, k)[inner] / true
    assert (ratio > 1.0).all()
    assert (ratio < 2.0).all()
    assert np.median(ratio) == pytest.approx(1.25, abs=0.1)


def test_the_gap_is_highest_in_the_middle_and_closed_at_the_ends():
    gap_at_rest = clearance(ALL, 0.2e-3, 0.8e-3)
    assert gap_at_rest[112] == pytest.approx(1e-3)
    assert gap_at_rest[[0, 224]] == pytest.approx([0.8e-3, 0.8e-3])
    assert gap_at_rest == pytest.approx(gap_at_rest[::-1])
    assert clearance(ALL, 1e-3, 0.0)[56] == pytest.approx(0.5e-3)  # half-way, a cubic step is at one half


def test_a_table_of_the_gap_is_mirrored_and_interpolated():
    half = np.array([[0.0, 1e-3], [0.5, 0.4e-3], [1.0, 0.0]])
    found = clearance(ALL, 0.0, 0.1e-3, table=half)
    assert found[[0, 56, 112, 168, 224]] == pytest.approx([0.1e-3, 0.5e-3, 1.1e-3, 0.5e-3, 0.1e-3])
    skew = np.array([[-1.0, 0.0], [1.0, 1e-3]])
    assert clearance(ALL, 0.0, 0.0, table=skew)[56] == pytest.approx(0.25e-3)


def test_a_law_adds_to_the_gap():
    law = BoundLaw("gap", linear_gap.function, np.array([1e-4, 0, 0, 0, 0, 0, 0, 0]))
    change = clearance(ALL, 1e-3, 0.0, [law]) - clearance(ALL, 1e-3, 0.0)
    assert change == pytest.approx(1e-4 * ALL.place, abs=1e-18)
