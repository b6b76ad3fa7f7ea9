"""Component modes of the beam against the assembled structure."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import eigvalsh
from scipy.sparse.linalg import spsolve
from short_beam import EXCITATION, VALUES, beam, run

from calib.records.excitation import Excitation
from calib.simulators.delaminated_beam import DelaminatedBeam, reduction
from calib.simulators.delaminated_beam.drive import centre_displacement
from calib.simulators.delaminated_beam.modes import modes
from calib.simulators.delaminated_beam.reduced.stepping import drift_modes, membrane_force
from calib.simulators.delaminated_beam.reduction import Fineness
from calib.simulators.delaminated_beam.stationary import StationaryMotion, stationary
from calib.simulators.delaminated_beam.structure import elastic_energy

COUNT = 16
LEVEL = Fineness(24, 512, 8, 2)  # error of a motion without contact: 0.01 %


def case(**options):
    """Return the numbers of the short beam."""
    made = beam(**options)
    values = {p.name: p.nominal for p in made.parameters}
    return made._case({**values, **VALUES}, centre_displacement(EXCITATION), ())


@pytest.fixture(scope="module", params=[{}, {"symmetric": False}, {"layer": "arched"}], ids=["half", "whole", "arched"])
def structure(request):
    return case(**request.param).structure


@pytest.fixture(scope="module")
def basis(structure):
    return modes(structure, COUNT)


@pytest.fixture(scope="module")
def paper():
    """Numbers of the paper's beam with a gap too wide for contact."""
    values = {p.name: p.nominal for p in DelaminatedBeam().parameters}
    excitation = Excitation("centre", "displacement", frequency=26.51, amplitude=0.92e-3)
    return DelaminatedBeam()._case({**values, "s": 5e-3, "dt": 4e-7}, centre_displacement(excitation), ())


def opening(structure):
    """Rows (m, 2 n) that take nodal displacements to the opening of the pairs."""
    pairs, rows = structure.pairs, np.zeros((len(structure.pairs.slave), structure.stiffness.shape[0]))
    for row, slave, master, following, weight in zip(
        rows, pairs.slave, pairs.master, pairs.following, pairs.weight, strict=True
    ):
        row[2 * slave + 1] += 1.0
        row[2 * master + 1] -= 1.0 - weight
        row[2 * following + 1] -= weight
    return rows


def test_frequencies_are_the_lowest_of_the_structure(structure, basis):
    free = structure.free
    root = np.sqrt(np.repeat(structure.mass, 2)[free])
    squares = eigvalsh(structure.stiffness[free][:, free].toarray() / np.outer(root, root))
    np.testing.assert_allclose(basis.omega**2, squares[:COUNT], rtol=1e-8)


def test_shapes_are_normal_to_mass_and_stiffness(structure, basis):
    mass, shape = np.repeat(structure.mass, 2), basis.shape[:, :COUNT]
    np.testing.assert_allclose(shape.T @ (mass[:, None] * shape), np.eye(COUNT), atol=1e-10)
    scale = np.outer(basis.omega, basis.omega)
    np.testing.assert_allclose(shape.T @ (structure.stiffness @ shape) / scale, np.eye(COUNT), atol=1e-8)
    assert not shape[np.append(structure.held, structure.driven)].any()


def test_the_last_shape_is_the_static_one_without_force_on_the_modes(structure, basis):
    static = basis.shape[:, COUNT]
    np.testing.assert_array_equal(static, structure.static_shape().ravel())
    assert static[structure.driven] == 1.0
    coupling = basis.shape[:, :COUNT].T @ (structure.stiffness @ static)
    assert np.abs(coupling).max() < 1e-6 * np.abs(structure.stiffness @ static).max()


def test_inertia_is_the_force_on_each_mode_of_an_accelerated_drive(structure, basis):
    mass = np.repeat(structure.mass, 2)
    expected = basis.shape[:, :COUNT].T @ (mass * structure.static_shape().ravel())
    np.testing.assert_allclose(basis.inertia, expected, atol=1e-10 * np.abs(expected).max())


def test_across_is_the_opening_of_the_pairs(structure, basis):
    np.testing.assert_allclose(basis.across, opening(structure) @ basis.shape, atol=1e-12)


def test_compliance_is_the_static_one_without_what_the_modes_yield(structure, basis):
    free, rows = structure.free, opening(structure)[:, structure.free]
    whole = rows @ spsolve(structure.stiffness[free][:, free].tocsc(), rows.T)
    modal = basis.across[:, :COUNT] / basis.omega
    np.testing.assert_allclose(basis.compliance, whole - modal @ modal.T, atol=1e-7 * np.abs(whole).max())
    np.testing.assert_array_equal(basis.compliance, basis.compliance.T)
    values = np.linalg.eigvalsh(basis.compliance)
    assert values.min() > -1e-6 * values.max()


def test_the_stiffness_against_elongation_is_what_the_modes_leave_of_the_layer_s(structure):
    kappas = [modes(structure, count).kappa for count in (8, 16, 32)]
    layer = structure.material.young * structure.width * 0.010 / (0.28 * len(structure.mesh.supports))
    assert 0.0 < kappas[0] <= layer * 1.01
    assert all(kappa > 0.0 for kappa in kappas)


def test_tension_is_the_force_in_the_layer_of_a_bent_beam():
    structure = case().structure
    basis = modes(structure, 40)
    static = structure.static_shape()
    mesh, material = structure.mesh, structure.material
    low, up = mesh.lines[-2], mesh.lines[-1]
    within = slice(mesh.first, mesh.last + 1)
    mid = 0.5 * (static[low[within], 0] + static[up[within], 0])
    x = mesh.nodes[up[within], 0]
    expected = material.young * structure.width * 0.010 * (mid[-1] - mid[0]) / (x[-1] - x[0])
    assert basis.tension[-1] == pytest.approx(expected, rel=1e-9)


def elastic(basis, q):
    """Potential of the membrane (see `modes`) at the coordinates q  [J]."""
    bent = 0.5 * q @ basis.quadratic @ q
    return (basis.tension @ q) * bent + 0.5 * basis.kappa * bent**2


def test_the_kick_is_the_slope_of_the_membrane_s_energy():
    numbers = case()
    engine = numbers.reduced(Fineness(COUNT, 2**18, 1), None, 10)  # all modes far below the step
    basis = modes(numbers.structure, COUNT)
    rng = np.random.default_rng(3)
    q = 1e-3 * rng.normal(size=COUNT + 1) / np.append(basis.omega / basis.omega[0], 1.0)
    engine.now.q[:] = q
    membrane_force(engine.plan, engine.now)
    step = 1e-8
    slope = [
        (elastic(basis, q + step * e) - elastic(basis, q - step * e)) / (2.0 * step) for e in np.eye(COUNT + 1)[:COUNT]
    ]
    np.testing.assert_allclose(-engine.now.kick, slope, rtol=1e-5, atol=1e-5 * np.abs(slope).max())


@pytest.mark.parametrize("q", [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.3, -0.2]])
def test_the_membrane_is_the_odd_part_of_the_elements_energy(paper, q):
    basis = modes(paper.structure, COUNT)
    q = np.append(q, np.zeros(COUNT - 2))
    q *= 1e-3 / np.abs(basis.shape @ q).max()
    shape = (basis.shape @ q).reshape(-1, 2)
    odd = 0.5 * (elastic_energy(paper.structure, shape) - elastic_energy(paper.structure, -shape))
    assert (basis.tension @ q) * (0.5 * q @ basis.quadratic @ q) == pytest.approx(odd, rel=2e-3)


# --- the modes in motion


def test_drift_is_the_exact_motion_under_a_drive_that_is_linear_in_time():
    omega, decay = np.array([30.0, 900.0, 4e4]), np.array([1.5, 800.0, 2000.0])
    inertia, h = np.array([1.0, -0.3, 0.2]), 4e-5
    q, v, before, after = np.array([1e-3, -2e-4, 1e-6]), np.array([0.3, 0.1, -0.05]), 25.0, -11.0

    def rate(t, y):
        force = before + (after - before) * t / h
        return np.concatenate([y[3:], -decay * y[3:] - omega**2 * y[:3] - inertia * force])

    exact = solve_ivp(rate, (0.0, h), np.concatenate([q, v]), method="DOP853", rtol=1e-12, atol=1e-18).y[:, -1]
    drift_modes(reduction.drift(omega, decay, inertia, h), q, v, before, after)
    np.testing.assert_allclose(np.concatenate([q, v]), exact, rtol=1e-10)


def test_the_kick_s_filter_is_the_mean_of_a_steady_force_in_a_mode():
    omega, h = np.array([10.0, 4e3, 9e4]), 1e-4
    found = reduction.drift(omega, 0.0 * omega, 0.0 * omega, h).kick
    steps = (np.arange(100_000) + 0.5) / 100_000 * h
    np.testing.assert_allclose(found, np.cos(np.outer(omega, steps - 0.5 * h)).mean(axis=1), atol=1e-9)


@pytest.mark.parametrize("layer", ["straight", "arched"])
def test_without_contact_the_reduced_kernel_is_the_full_one(layer):
    full = run(beam(fidelity="full", layer=layer), s=8e-3)
    x = full.displacement.sel(body="layer").values
    error = [
        np.sqrt(np.mean((run(beam(layer=layer, modes=n, steps=s), s=8e-3).displacement.values[1] - x) ** 2)) / x.std()
        for n, s in ((6, 256), (24, 512), (40, 2048))
    ]
    assert error[1] < 3e-3
    assert error[2] < 1e-3


def test_without_contact_the_reduced_kernel_is_the_full_one_on_the_paper_s_beam(paper):
    engines = paper.reduced(LEVEL, None, 10**9), paper.full(None, 10**9)
    motions = [stationary(engine, 1, 400, 6, 6) for engine in engines]
    assert all(isinstance(motion, StationaryMotion) for motion in motions)
    x, full = (motion.samples[:, 1] for motion in motions)
    assert np.sqrt(np.mean((x - full) ** 2)) < 5e-4 * full.std()


def test_a_beam_without_its_membrane_moves_otherwise(paper):
    motions = []
    for factor in (1.0, 0.0):
        engine = paper.reduced(LEVEL, None, 10**9)
        engine.plan.quadratic[:] *= factor
        motions.append(stationary(engine, 1, 400, None, 200).samples)
    x, linear = (samples[:, 1] for samples in motions)
    assert np.sqrt(np.mean((linear - x) ** 2)) > 0.05 * x.std()
