"""From a mesh to the kernel's arrays: nothing is lost, and the kernel's forces are those of the energy."""

import dataclasses

import numpy as np
import pytest
from simulators.delaminated_beam.beams import ALUMINIUM, AMPLITUDE, PAPER, WIDTH, beam
from simulators.delaminated_beam.test_plane_stress import angles, inner_nodes, turned

from calib.simulators.delaminated_beam.layout import Layout, internal_force
from calib.simulators.delaminated_beam.mesh import Counts, mesh
from calib.simulators.delaminated_beam.structure import assemble, elastic_energy

HALF, WHOLE = beam(), beam(symmetric=False)
LOCKING = beam(bilinear=True)
ARCHED = beam(dataclasses.replace(PAPER, arch=1e-3), symmetric=False)
STEP = 3.1e-7  # s
BEAMS = pytest.mark.parametrize("b", [HALF, WHOLE, LOCKING, ARCHED], ids=["half", "whole", "bilinear", "arched"])


def turned_beam(angle, bilinear=False):
    structure = assemble(turned(HALF.structure.mesh, angle), ALUMINIUM, WIDTH, bilinear)
    structure = dataclasses.replace(structure, pairs=HALF.structure.pairs)  # those of a turned beam have no meaning
    return HALF._replace(structure=structure, layout=Layout(structure.mesh))


def rotated(nodes, angle):
    """Displacements (n, 2) of a turn about the origin  [m]."""
    c, s = np.cos(angle), np.sin(angle)
    return nodes @ np.array([[c, s], [-s, c]]) - nodes


def drawn(b, seed, size=1e-6):
    """Displacements (n, 2) of all nodes, each for itself  [m]."""
    return size * np.random.default_rng(seed).standard_normal(b.nodes.shape)


def bent(b, depth=5e-3):
    """A smooth large displacement: the beam bent to a sine, sections kept upright to it  [m]."""
    x, y = b.nodes.T
    wave = 2.0 * np.pi / 1.386
    return depth * np.stack([wave * (y - 5e-3) * np.sin(wave * x), np.cos(wave * x)], axis=1)


def gradient(b, displacement, direction, size):
    """Derivative of the elastic energy in a direction, by five points  [J]."""
    at = [elastic_energy(b.structure, displacement + k * size * direction) for k in (-2, -1, 1, 2)]
    return (8.0 * (at[2] - at[1]) - (at[3] - at[0])) / (12.0 * size)


@BEAMS
def test_nodes_come_back_from_the_kernels_order(b):
    values = drawn(b, 1)
    assert np.array_equal(b.layout.gather(b.layout.spread(values)), values)


@BEAMS
def test_every_free_node_is_stepped_once(b):
    plan = b.plan(STEP)
    inverse = b.layout.gather(plan.inverse_mass)
    still = np.unique([*b.structure.held, b.structure.driven])
    assert np.flatnonzero(inverse.ravel() == 0.0).tolist() == still.tolist()
    assert plan.inverse_mass.astype(bool).sum() == inverse.size - len(still)
    assert 1.0 / inverse.ravel()[b.structure.free] == pytest.approx(np.repeat(b.structure.mass, 2)[b.structure.free])


@BEAMS
def test_the_bodies_are_the_layer_between_the_ends_of_the_delamination_and_the_rest(b):
    plan, mesh_ = b.plan(STEP), b.structure.mesh
    body = np.full(2 * b.layout.size, -1)
    for first, count, which in plan.bodies:
        body[first : first + count] = which
    found = b.layout.gather(body)[:, 1]
    assert np.flatnonzero(found == 1).tolist() == np.sort(mesh_.layer).tolist()
    assert (found >= 0).all()


@BEAMS
def test_small_displacements_meet_the_assembled_stiffness(b):
    plan, u = b.plan(STEP), drawn(b, 2, 1e-8)
    odd = 0.5 * (internal_force(plan, b.layout, u) - internal_force(plan, b.layout, -u))
    expected = (b.structure.stiffness @ u.ravel()).reshape(-1, 2)
    assert np.abs(odd - expected).max() < 1e-10 * np.abs(expected).max()


@BEAMS
def test_the_stress_free_shape_is_free_of_force(b):
    force = internal_force(b.plan(STEP), b.layout, np.zeros_like(b.nodes))
    assert np.abs(force).max() < 1e-14 * np.abs(b.structure.stiffness).max() * 1e-3
    assert elastic_energy(b.structure, np.zeros_like(b.nodes)) < 1e-20


@BEAMS
@pytest.mark.parametrize("angle", [0.05, 0.5])
def test_a_rigid_turn_causes_no_force(b, angle):
    u = rotated(b.nodes, angle)
    force = internal_force(b.plan(STEP), b.layout, u)
    linear = b.structure.stiffness @ u.ravel()
    left_out = 1e-6 if b is ARCHED else 2e-11  # an arch's elements are taken as rectangles, see `Elements`
    assert np.abs(force).max() < left_out * np.abs(linear).max()


@BEAMS
@pytest.mark.parametrize("seed", range(3))
def test_the_forces_are_the_gradient_of_the_elastic_energy(b, seed):
    u = rotated(b.nodes, 0.03) + bent(b) + drawn(b, seed, 1e-5)
    direction = np.random.default_rng(10 + seed).standard_normal(u.shape)
    force = internal_force(b.plan(STEP), b.layout, u)
    assert np.vdot(force, direction) == pytest.approx(gradient(b, u, direction, 2e-7), rel=1e-8)


@BEAMS
def test_the_forces_of_a_bent_beam_are_in_equilibrium(b):
    """Resultant and moment about the origin, in the deformed place."""
    u = bent(b)
    force = internal_force(b.plan(STEP), b.layout, u)
    x, y = (b.nodes + u).T
    largest = np.abs(force).max()
    assert np.abs(force.sum(axis=0)).max() < 1e-10 * largest
    assert abs((x * force[:, 1] - y * force[:, 0]).sum()) < 1e-10 * largest * 1.386


@pytest.mark.parametrize("angle", [0.0, *angles(4, 3)])
@pytest.mark.parametrize("bilinear", [False, True])
def test_the_kernel_passes_the_patch_test_at_any_strain(angle, bilinear):
    b = turned_beam(angle, bilinear)
    gradient_ = 0.05 * np.random.default_rng(5).standard_normal((2, 2))
    force = internal_force(b.plan(STEP), b.layout, b.nodes @ gradient_.T)
    inner = inner_nodes(b.structure.mesh)
    assert np.abs(force[inner]).max() < 1e-12 * np.abs(force).max()


@pytest.mark.parametrize("angle", angles(6, 3))
def test_a_turned_mesh_has_the_turned_forces(angle):
    b, u = turned_beam(angle), bent(HALF) + drawn(HALF, 7, 1e-6)
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, s], [-s, c]])
    found = internal_force(b.plan(STEP), b.layout, u @ turn)
    expected = internal_force(HALF.plan(STEP), HALF.layout, u) @ turn
    assert np.abs(found - expected).max() < 1e-11 * np.abs(expected).max()


def test_the_static_shape_lifts_the_beam_between_its_supports():
    shape = HALF.structure.static_shape()
    assert shape[HALF.structure.mesh.driven, 1] == 1.0
    assert shape[HALF.structure.mesh.supports, 1] == pytest.approx([0.0], abs=1e-15)
    residual = HALF.structure.stiffness @ shape.ravel()
    assert np.abs(residual[HALF.structure.free]).max() < 1e-9 * abs(residual[HALF.structure.driven])


def test_the_static_force_is_nearly_the_linear_one_at_the_papers_amplitude():
    """The axial load of the layer enters at second order: small, but not rounding."""
    shape = AMPLITUDE * HALF.structure.static_shape()
    force = internal_force(HALF.plan(STEP), HALF.layout, shape).ravel()
    driven = HALF.structure.driven
    linear = (HALF.structure.stiffness @ shape.ravel())[driven]
    assert 1e-6 < abs(force[driven] / linear - 1.0) < 1e-2


def test_a_line_too_long_for_the_kernel_is_refused():
    long = mesh(PAPER, Counts(masters=400, slaves=4, outer=400), symmetric=False)
    with pytest.raises(ValueError, match="a line of"):
        Layout(long)
