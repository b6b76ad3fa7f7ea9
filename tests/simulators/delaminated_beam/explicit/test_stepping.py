"""The kernel's steps: order, stability, symmetry, and what the geometric stiffness does to the motion."""

import numpy as np
import pytest
from simulators.delaminated_beam.beams import AMPLITUDE, FIGURE_12, PERIOD, advance, beam, cosine, seen

from calib.modelling.laws import BoundLaw, force
from calib.simulators.delaminated_beam import explicit
from calib.simulators.delaminated_beam.layout import internal_force
from calib.simulators.delaminated_beam.structure import stable_step

HALF, WHOLE = beam(), beam(symmetric=False)


@force
def weight(t, x, v, p, z, dz):
    """A constant acceleration."""
    return p[0]


def smooth(times):
    """Drive from rest with four smooth derivatives  [m]."""
    return AMPLITUDE * np.sin(np.pi * times / PERIOD) ** 6


def test_central_differences_converge_with_order_two():
    """Up to the first contact, over a quarter of a period; beta is of first order by its nature and left out."""
    span, samples = 0.25 * PERIOD, 40
    curves = []
    for steps in (24_000, 48_000, 96_000):
        plan = HALF.plan(span / steps, alpha=20.0)
        state = HALF.begin(plan, np.zeros_like(HALF.nodes))
        drive = smooth(span / steps * np.arange(1, steps + 1))
        code, notes = advance(plan, state, drive, np.arange(samples) * (steps // samples))
        assert code == explicit.DONE
        curves.append(notes.samples[:, 1])
    coarse, fine = (np.abs(curves[k + 1] - curves[k]).max() for k in (0, 1))
    assert np.log2(coarse / fine) == pytest.approx(2.0, abs=0.05)


def free_decay(fraction, beta, alpha, steps=30_000):
    """Code of a free decay at a fraction of the stable step, and how much the largest velocity has grown."""
    plan = HALF.plan(fraction * stable_step(HALF.critical, beta), alpha=alpha, beta=beta)
    displacement = 1e-9 * np.random.default_rng(1).standard_normal(HALF.nodes.shape)
    displacement[HALF.structure.mesh.driven] = displacement[HALF.structure.mesh.supports] = 0.0
    displacement[np.abs(HALF.nodes[:, 0]) < 1e-12, 0] = 0.0
    state = HALF.begin(plan, displacement)
    code, _ = advance(plan, state, np.zeros(200))
    early = np.abs(state.v).max()
    code, _ = advance(plan, state, np.zeros(steps))
    return code, np.abs(state.v).max() / early


@pytest.mark.parametrize("alpha", [0.0, 500.0])
@pytest.mark.parametrize("beta", [0.0, 0.02, 0.1, 0.5, 1.0])
def test_the_stable_step_is_the_limit_of_stability(beta, alpha):
    code, growth = free_decay(0.999, beta, alpha)
    assert code == explicit.DONE
    assert growth < 2.0
    code, growth = free_decay(1.002, beta, alpha)
    assert code == explicit.UNSTABLE or growth > 1e3


@pytest.mark.parametrize("c_con", [0.0, 5.0])
def test_the_half_moves_as_the_whole(c_con):
    """With contact, over one period."""
    curves = []
    for b in (HALF, WHOLE):
        plan, state, steps = b.figure(*FIGURE_12[:3], c_con, *FIGURE_12[4:])
        code, notes = advance(plan, state, cosine(steps), np.linspace(1, steps - 1, 100).astype(int))
        assert code == explicit.DONE
        assert notes.total[2] > 0
        curves.append(notes.samples[:, :2])
    assert np.abs(curves[1] - curves[0]).max() < 1e-7 * np.abs(curves[0]).max()


def test_the_layers_axial_load_changes_its_motion():
    """Against the linear motion: that of a ten-thousandth of the amplitude, enlarged. Free of contact, alpha 500."""
    curves = []
    for scale in (1.0, 1e-4):
        steps = int(PERIOD / 4.4e-7)
        plan = HALF.plan(PERIOD / steps, alpha=500.0)
        state = HALF.begin(plan, scale * AMPLITUDE * HALF.structure.static_shape())
        at = np.linspace(1, 2 * steps - 1, 400).astype(int)
        _, notes = advance(plan, state, cosine(steps, 2, scale * AMPLITUDE), at)
        curves.append(notes.samples[:, 1] / scale)
    full, linear = curves
    difference = np.sqrt(np.mean((full - linear) ** 2) / np.mean(linear**2))
    assert difference > 0.05


def test_samples_lie_between_the_steps():
    plan, state, steps = HALF.figure(*FIGURE_12)
    again = HALF.begin(plan, HALF.displacement(plan, state))
    drive = cosine(steps)[:20_000]
    between = seen(plan, [15_000] * 3)._replace(shift=np.array([-0.5, 0.0, 0.5]))
    explicit.advance(plan, state, 0.0, drive, between)
    _, at = advance(plan, again, drive, [14_999, 15_000, 15_001])
    mean = 0.5 * (at.samples[1:, :4] + at.samples[:-1, :4])
    assert between.samples[[0, 2], :4] == pytest.approx(mean, rel=1e-4)
    assert np.array_equal(between.samples[1, :4], at.samples[1, :4])


def test_the_driven_node_stands_where_it_is_told():
    plan, state, steps = HALF.figure(*FIGURE_12)
    drive = cosine(steps)[:1000]
    advance(plan, state, drive)
    assert HALF.displacement(plan, state)[HALF.structure.mesh.driven, 1] == pytest.approx(drive[-1], rel=1e-12)
    assert HALF.velocity(state)[HALF.structure.mesh.driven, 1] == pytest.approx(
        (drive[-1] - drive[-2]) / plan.step, rel=1e-6
    )


def test_a_run_cut_in_two_is_the_same_run():
    """Bit for bit, also where the look for contact is due between the parts."""
    plan, state, steps = HALF.figure(*FIGURE_12)
    again = HALF.begin(plan, HALF.displacement(plan, state))
    drive = cosine(steps, 0.5)
    whole, _ = advance(plan, state, drive)
    for part in np.split(drive, [1, 77, 30_003]):
        advance(plan, again, part)
    assert np.array_equal(state.w, again.w)
    assert np.array_equal(state.v, again.v)
    assert np.array_equal(state.counters, again.counters)


@pytest.mark.parametrize("body", ["beam", "layer"])
def test_a_force_law_accelerates_its_body(body):
    """In free fall from rest, over the first step every node of the body gains g dt."""
    law = BoundLaw("force", weight.function, np.array([-9.81, 0, 0, 0, 0, 0, 0, 0]), (body,))
    plan = HALF.plan(3e-7, laws=(law,))
    state = HALF.begin(plan, np.zeros_like(HALF.nodes))
    advance(plan, state, np.zeros(1))
    mesh = HALF.structure.mesh
    gained = HALF.velocity(state)[:, 1]
    layer = np.zeros(len(gained), dtype=bool)
    layer[mesh.layer] = True
    moves = layer if body == "layer" else ~layer
    moves = moves & ~np.isin(np.arange(len(gained)), [mesh.driven, *mesh.supports])
    assert gained[moves] == pytest.approx(np.full(moves.sum(), -9.81 * 3e-7), rel=1e-12)
    assert not gained[~moves].any()


def test_without_drive_and_contact_one_step_is_newtons_law():
    plan = HALF.plan(3e-7, alpha=40.0)
    u = 1e-6 * np.random.default_rng(3).standard_normal(HALF.nodes.shape)
    v = 1e-2 * np.random.default_rng(4).standard_normal(HALF.nodes.shape)
    still = np.append(HALF.structure.held, HALF.structure.driven)
    u.ravel()[still] = v.ravel()[still] = 0.0
    state = HALF.begin(plan, u, v)
    advance(plan, state, np.zeros(1))
    half = 0.5 * 40.0 * 3e-7
    expected = (1.0 - half) * v - 3e-7 * internal_force(plan, HALF.layout, u) / HALF.structure.mass[:, None]
    expected /= 1.0 + half
    expected.ravel()[still] = 0.0
    assert HALF.velocity(state) == pytest.approx(expected, rel=1e-11, abs=1e-13)
    assert HALF.displacement(plan, state) == pytest.approx(u + 3e-7 * expected, rel=1e-12)


def test_velocities_beyond_the_limit_end_the_run():
    plan = HALF.plan(1.2 * HALF.critical)
    state = HALF.begin(plan, 1e-6 * np.random.default_rng(5).standard_normal(HALF.nodes.shape))
    code, _ = advance(plan, state, np.zeros(100_000))
    assert code == explicit.UNSTABLE
    assert state.counters[0] < 2000
