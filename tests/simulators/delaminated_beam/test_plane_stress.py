"""The elements: patch test, stiffness against quadrature, frequencies against a fine mesh and against beam theory."""

import dataclasses

import numpy as np
import pytest
import skfem
from scipy.sparse.linalg import eigsh
from simulators.delaminated_beam import qm6
from simulators.delaminated_beam.beams import ALUMINIUM, PAPER, WIDTH, beam
from skfem.helpers import ddot, eye, sym_grad, trace

from calib.simulators.delaminated_beam.mesh import Counts, mesh
from calib.simulators.delaminated_beam.plane_stress import elements, energy, masses, stiffness, turn

HALF, WHOLE = mesh(PAPER, Counts()), mesh(PAPER, Counts(), symmetric=False)
SPEED = np.sqrt(ALUMINIUM.plane / ALUMINIUM.density)  # of plane-stress waves, m/s


def turned(meshed, angle):
    """The same mesh, turned by an angle."""
    c, s = np.cos(angle), np.sin(angle)
    return dataclasses.replace(meshed, nodes=meshed.nodes @ np.array([[c, s], [-s, c]]))


def angles(seed, count):
    return np.random.default_rng(seed).uniform(-np.pi, np.pi, count)


def inner_nodes(meshed):
    """Nodes with elements all around."""
    quads = np.concatenate([meshed.quadrilaterals(strip) for strip in meshed.strips])
    edges = np.sort(np.stack([quads, np.roll(quads, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    edges, times = np.unique(edges, axis=0, return_counts=True)
    return np.setdiff1d(np.arange(len(meshed.nodes)), edges[times == 1])


def frequencies(k, m, count):
    """Lowest frequencies of free motion that are not zero  [Hz]."""
    root = 1.0 / np.sqrt(np.repeat(m, 2))
    scaled = k.multiply(root[:, None]).multiply(root[None, :])
    square = eigsh(scaled.tocsc(), count + 3, sigma=-1e4, which="LM", return_eigenvectors=False)
    return np.sqrt(np.sort(square)[3:]) / (2.0 * np.pi)


@pytest.mark.parametrize("angle", [0.0, *angles(1, 4)])
@pytest.mark.parametrize("bilinear", [False, True])
def test_the_patch_test_is_passed_exactly(angle, bilinear):
    """Under a linear displacement no force acts on inner nodes, and the energy is that of the constant strain."""
    meshed = turned(HALF, angle)
    gradient = 1e-3 * np.random.default_rng(2).standard_normal((2, 2))
    displacement = meshed.nodes @ gradient.T
    k = stiffness(meshed, ALUMINIUM, WIDTH, bilinear)
    force = (k @ displacement.ravel()).reshape(-1, 2)
    inner = inner_nodes(meshed)
    assert len(inner) > 50
    assert np.abs(force[inner]).max() < 1e-12 * np.abs(force).max()
    e11, e22, shear = gradient[0, 0], gradient[1, 1], gradient[0, 1] + gradient[1, 0]
    density = ALUMINIUM.plane * (e11**2 + e22**2 + 2.0 * ALUMINIUM.poisson * e11 * e22) + ALUMINIUM.shear * shear**2
    volume = masses(meshed, ALUMINIUM, WIDTH).sum() / ALUMINIUM.density
    assert np.vdot(displacement, force) == pytest.approx(density * volume, rel=1e-11)


@pytest.mark.parametrize("angle", [0.0, *angles(3, 3)])
@pytest.mark.parametrize("bilinear", [False, True])
def test_the_stiffness_is_that_of_quadrature_with_condensed_incompatible_modes(angle, bilinear):
    meshed = turned(mesh(PAPER, Counts(masters=8, slaves=4, outer=6)), angle)
    reference = qm6.assemble(meshed, ALUMINIUM, WIDTH, incompatible=not bilinear)
    difference = stiffness(meshed, ALUMINIUM, WIDTH, bilinear) - reference
    assert np.abs(difference).max() < 1e-12 * np.abs(reference).max()


def test_masses_add_up_to_the_beam_and_to_its_moment_of_inertia_along_x():
    m = masses(WHOLE, ALUMINIUM, WIDTH)
    total = 2700.0 * 1.386 * 10e-3 * WIDTH
    assert m.sum() == pytest.approx(total, rel=1e-12)
    assert m @ WHOLE.nodes == pytest.approx([0.0, 5e-3 * total], abs=1e-9 * total)
    assert m @ WHOLE.nodes[:, 0] ** 2 == pytest.approx(total * 1.386**2 / 12.0, rel=1e-3)


def test_a_turn_is_read_off_a_turned_stretch():
    a = 0.7
    rotation = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
    stretched = rotation @ np.array([[1.02, 0.01], [0.01, 0.97]])
    c, s = turn(stretched.T[:, :, None])
    assert np.arctan2(s, c) == pytest.approx([a], abs=1e-14)


def test_turning_costs_no_energy_and_stretching_costs_that_of_hookes_law():
    quads = HALF.quadrilaterals(0)
    e = elements(HALF.nodes, quads, ALUMINIUM, WIDTH)
    a = 1.1
    rotation = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
    far = HALF.nodes @ (rotation - np.eye(2)).T
    stretch = np.diag([1.001, 1.0 - 0.3e-3])
    both = HALF.nodes @ (rotation @ stretch - np.eye(2)).T
    expected = 0.5 * ALUMINIUM.young * 1e-6 * e.volume.sum()
    assert energy(e, far[quads], ALUMINIUM) < 1e-20 * ALUMINIUM.young * e.volume.sum()
    assert energy(e, both[quads], ALUMINIUM) == pytest.approx(expected, rel=1e-11)


def test_an_element_without_area_is_refused():
    flat = HALF.nodes * [1.0, 0.0]
    with pytest.raises(ValueError, match="no area"):
        elements(flat, HALF.quadrilaterals(0), ALUMINIUM, WIDTH)


def test_the_critical_step_is_the_time_of_a_wave_along_the_layers_height():
    for symmetric in (True, False):
        critical = beam(symmetric=symmetric).critical
        assert critical == pytest.approx(4.684e-7, rel=1e-4)
        assert critical == pytest.approx(2.5e-3 / SPEED, rel=1e-3)


def quadratic(length, delamination, columns, rows):
    """Lowest free frequency of the delaminated beam in biquadratic elements, by scikit-fem  [Hz].

    A grid whose nodes above the interface are doubled along the delamination; all have one size.
    """
    x, y = np.linspace(-0.5 * length, 0.5 * length, columns + 1), np.linspace(0.0, 10e-3, rows + 1)
    x = np.sort(np.concatenate([x[np.abs(x) > 0.5 * delamination + 1e-3], np.linspace(-0.5, 0.5, 57) * delamination]))
    grid = skfem.MeshQuad.init_tensor(x, y)
    p, t = grid.p, grid.t.copy()
    split = np.flatnonzero((np.abs(p[1] - 7.5e-3) < 1e-9) & (np.abs(p[0]) < 0.5 * delamination - 1e-9))
    doubled = np.arange(p.shape[1])
    doubled[split] = p.shape[1] + np.arange(len(split))
    above = p[1][t].mean(axis=0) > 7.5e-3
    t[:, above] = doubled[t[:, above]]
    basis = skfem.Basis(skfem.MeshQuad(np.hstack([p, p[:, split]]), t), skfem.ElementVector(skfem.ElementQuad2()))
    nu, shear = ALUMINIUM.poisson, ALUMINIUM.shear

    @skfem.BilinearForm
    def elastic(u, v, _):
        strain = sym_grad(u)
        stress = 2.0 * shear * (strain + nu / (1.0 - nu) * eye(trace(strain), 2))
        return ddot(stress, sym_grad(v))

    @skfem.BilinearForm
    def inertia(u, v, _):
        return ALUMINIUM.density * (u[0] * v[0] + u[1] * v[1])

    square = eigsh(
        elastic.assemble(basis), 4, M=inertia.assemble(basis), sigma=-1e4, which="LM", return_eigenvectors=False
    )
    return np.sqrt(np.sort(square)[3]) / (2.0 * np.pi)


def test_the_first_free_frequency_is_that_of_a_mesh_of_quadratic_elements():
    found = frequencies(stiffness(WHOLE, ALUMINIUM, WIDTH), masses(WHOLE, ALUMINIUM, WIDTH), 1)[0]
    assert found == pytest.approx(26.49, abs=0.01)
    assert found == pytest.approx(quadratic(1.386, 0.56, 138, 8), rel=5e-3)


def test_whole_and_half_have_the_same_first_frequency():
    k, m = stiffness(HALF, ALUMINIUM, WIDTH), masses(HALF, ALUMINIUM, WIDTH)
    middle = np.flatnonzero(np.abs(HALF.nodes[:, 0]) < 1e-12)
    free = np.setdiff1d(np.arange(2 * len(m)), 2 * middle)
    root = 1.0 / np.sqrt(np.repeat(m, 2)[free])
    scaled = k[free][:, free].multiply(root[:, None]).multiply(root[None, :]).tocsc()
    square = np.sort(eigsh(scaled, 2, sigma=-1e4, which="LM", return_eigenvectors=False))
    whole = frequencies(stiffness(WHOLE, ALUMINIUM, WIDTH), masses(WHOLE, ALUMINIUM, WIDTH), 1)[0]
    assert np.sqrt(square[1]) / (2.0 * np.pi) == pytest.approx(whole, rel=1e-7)


def test_full_integration_locks():
    k = stiffness(WHOLE, ALUMINIUM, WIDTH, bilinear=True)
    assert frequencies(k, masses(WHOLE, ALUMINIUM, WIDTH), 1)[0] == pytest.approx(30.6, abs=0.1)


def timoshenko(length, height, order):
    """Frequency of a slender free-free beam: Euler-Bernoulli's, corrected once for shear and rotation  [Hz]."""
    wave = (np.array([4.730040745, 7.853204624, 10.995607838])[order] / length) ** 2
    inertia = height**2 / 12.0
    bernoulli = wave * np.sqrt(ALUMINIUM.young * inertia / ALUMINIUM.density) / (2.0 * np.pi)
    return bernoulli * (1.0 - 0.5 * wave * inertia * (1.0 + ALUMINIUM.young / (5.0 / 6.0 * ALUMINIUM.shear)))


def test_an_intact_beam_vibrates_as_beam_theory_says():
    intact = mesh(dataclasses.replace(PAPER, delamination=0.02), Counts(masters=2, slaves=4, outer=68), symmetric=False)
    found = frequencies(stiffness(intact, ALUMINIUM, WIDTH), masses(intact, ALUMINIUM, WIDTH), 3)
    for order in range(3):
        assert found[order] == pytest.approx(timoshenko(1.386, 10e-3, order), rel=5e-3)
    assert found[0] == pytest.approx(timoshenko(1.386, 10e-3, 0), rel=1e-3)
