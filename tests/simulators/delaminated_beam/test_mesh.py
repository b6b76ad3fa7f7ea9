"""The mesh: counts, places, and the half as the right side of the whole."""

import dataclasses

import numpy as np
import pytest
from simulators.delaminated_beam.beams import PAPER

from calib.simulators.delaminated_beam.mesh import Counts, mesh, smooth_step

WHOLE, HALF = mesh(PAPER, Counts(), symmetric=False), mesh(PAPER, Counts())


def corners(meshed):
    """Corners of all elements (m, 4, 2), strip after strip  [m]."""
    return np.concatenate([meshed.nodes[meshed.quadrilaterals(strip)] for strip in meshed.strips])


def areas(quads):
    x, y = np.moveaxis(quads, 2, 0)
    return 0.5 * ((x[:, 2] - x[:, 0]) * (y[:, 3] - y[:, 1]) - (x[:, 3] - x[:, 1]) * (y[:, 2] - y[:, 0]))


def test_the_whole_beam_has_the_papers_counts():
    assert len(corners(WHOLE)) == 582
    assert WHOLE.masters.size - 1 == 56
    assert WHOLE.slaves.size - 1 == 224


def test_the_half_has_half_the_elements():
    assert len(corners(HALF)) == 291
    assert (HALF.masters.size - 1, HALF.slaves.size - 1) == (28, 112)


def test_the_smallest_size_is_2_5_mm():
    sides = np.linalg.norm(np.diff(corners(WHOLE), axis=1, append=corners(WHOLE)[:, :1]), axis=2)
    assert sides.min() == pytest.approx(2.5e-3, rel=1e-12)


def test_the_elements_fill_the_beam():
    assert areas(corners(WHOLE)).sum() == pytest.approx(1.386 * 10e-3, rel=1e-12)
    assert areas(corners(HALF)).sum() == pytest.approx(0.5 * 1.386 * 10e-3, rel=1e-12)


def test_the_support_is_the_node_at_mid_height_nearest_the_nodal_line():
    assert HALF.nodes[HALF.supports] == pytest.approx(np.array([[0.371, 5e-3]]), abs=1e-3)
    assert abs(HALF.nodes[HALF.supports[0], 0] - 0.371) < 5e-4
    mirrored = HALF.nodes[HALF.supports] * [[-1.0, 1.0], [1.0, 1.0]]
    assert WHOLE.nodes[WHOLE.supports] == pytest.approx(mirrored, abs=1e-12)


def test_the_driven_node_is_on_the_beam_in_the_middle_below_the_layer():
    for meshed in (WHOLE, HALF):
        assert meshed.nodes[meshed.driven] == pytest.approx([0.0, 7.5e-3], abs=1e-12)
        centre = meshed.slaves[np.argmin(np.abs(meshed.place))]
        assert meshed.nodes[centre] == pytest.approx([0.0, 7.5e-3], abs=1e-12)
        assert centre != meshed.driven


def test_the_half_is_the_right_side_of_the_whole():
    right = WHOLE.nodes[WHOLE.nodes[:, 0] > -1e-9]
    assert len(right) == len(HALF.nodes)
    right, half = (nodes[np.lexsort(nodes.T.round(9))] for nodes in (right, HALF.nodes))
    assert right == pytest.approx(half, abs=1e-12)


@pytest.mark.parametrize("meshed", [WHOLE, HALF])
def test_layer_and_beam_share_their_nodes_beside_the_delamination_only(meshed):
    shared = np.intersect1d(meshed.lines[meshed.interface], meshed.lines[meshed.interface + 1])
    assert np.abs(meshed.nodes[shared, 0]).min() == pytest.approx(meshed.half_delamination, rel=1e-12)
    assert np.intersect1d(meshed.slaves, meshed.masters).size == (1 if meshed.symmetric else 2)
    assert np.intersect1d(meshed.layer, meshed.lines[meshed.interface]).size == 0


def test_refining_cuts_every_element():
    fine = mesh(PAPER, Counts().refined(3))
    assert len(corners(fine)) == 9 * 291
    assert np.sort(areas(corners(fine))) == pytest.approx(np.sort(np.repeat(areas(corners(HALF)) / 9.0, 9)), rel=1e-9)
    assert {tuple(node) for node in HALF.nodes.round(9)} <= {tuple(node) for node in fine.nodes.round(9)}


def test_the_arch_is_a_cubic_with_horizontal_tangents_of_constant_thickness():
    arched = mesh(dataclasses.replace(PAPER, arch=1e-3), Counts(), symmetric=False)
    low, high = (arched.nodes[line[arched.first : arched.last + 1]] for line in arched.lines[arched.interface + 1 :])
    x, y = (0.5 * (low + high)).T
    straight = np.linspace(-1.0, 1.0, len(x))
    assert x == pytest.approx(0.28 * straight, abs=1e-12)
    assert y - 8.75e-3 == pytest.approx(1e-3 * smooth_step(straight), abs=1e-12)
    assert np.linalg.norm(high - low, axis=1) == pytest.approx(np.full(len(x), 2.5e-3), rel=1e-12)


@pytest.mark.parametrize("change", [{"delamination": 2.0}, {"delamination": 0.0}, {"support": 0.2}, {"support": 0.7}])
def test_an_impossible_shape_is_refused(change):
    with pytest.raises(ValueError, match="m"):
        mesh(dataclasses.replace(PAPER, **change), Counts())
