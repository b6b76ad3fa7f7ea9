"""The kernel's contact: action and reaction, one pair's restitution, and which dampers are stable."""

import numpy as np
import pytest
from simulators.delaminated_beam.beams import WIDE, advance, beam

from calib.modelling.laws import BoundLaw, contact
from calib.simulators.delaminated_beam import explicit
from calib.simulators.delaminated_beam.contact import critical_damping
from calib.simulators.delaminated_beam.explicit.contact import add_mobilities, apply_contact_forces, find_contact
from calib.simulators.law_calls import addresses

HALF, WHOLE = beam(), beam(symmetric=False)
STEP = 3.1e-7  # s, as the paper's; 0.66 of the critical one


@contact
def suction(place, clearance, rate, pressure, p):
    """A constant pull."""
    return -p[0]


def pushed(b, plan, displacement, velocity):
    """Nodal forces (n,) in y of one look for contact and the push after it [N], and how many pairs were closed."""
    state = b.begin(plan, displacement, velocity)
    before = b.velocity(state)[:, 1]
    closed, _ = find_contact(plan, state)
    apply_contact_forces(plan, state, closed)
    inverse = b.layout.gather(plan.inverse_mass)[:, 1]
    change = b.velocity(state)[:, 1] - before
    gain = plan.step / (1.0 + 0.5 * plan.alpha * plan.step)
    return np.divide(change, gain * inverse, out=np.zeros_like(change), where=inverse > 0.0), state, closed


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("lagged", [False, True])
def test_action_is_reaction(seed, lagged):
    """Resultant and moment of the forces on layer and beam; off the middle, where the drive would carry them."""
    rng = np.random.default_rng(seed)
    clearance = np.where(np.abs(WHOLE.structure.pairs.place) > 0.1, 1e-5, WIDE)
    plan = WHOLE.plan(STEP, alpha=50.0, beta=0.1, c_con=2.0, clearance=clearance, lagged=lagged)
    displacement = 1e-5 * rng.standard_normal(WHOLE.nodes.shape)
    force, state, closed = pushed(WHOLE, plan, displacement, 1e-3 * rng.standard_normal(WHOLE.nodes.shape))
    assert closed > 20
    layer = np.isin(np.arange(len(force)), WHOLE.structure.mesh.layer)
    size, x = np.abs(force).sum(), WHOLE.nodes[:, 0]
    assert force[layer].sum() == pytest.approx(state.push[:closed].sum(), rel=1e-12)
    assert (force[layer] >= -1e-12 * size).all()
    assert abs(force.sum()) < 1e-10 * size
    assert abs((x * force).sum()) < 1e-10 * size * 0.28


def test_a_pair_pushes_by_stiffness_and_damping_on_its_nodes_by_their_weights():
    """F = k p + c p' with p' the mean of the rates before and after the push."""
    plan = HALF.plan(STEP, c_con=0.7, clearance=np.where(np.arange(113) == 41, -1e-7, WIDE))
    pairs = HALF.structure.pairs
    velocity = np.zeros_like(HALF.nodes)
    velocity[pairs.slave[41], 1] = -1e-2
    force, state, closed = pushed(HALF, plan, np.zeros_like(HALF.nodes), velocity)
    assert (closed, state.active[0], pairs.weight[41]) == (1, 41, 0.25)
    after = HALF.velocity(state)[:, 1]
    rate = after[pairs.slave[41]] - 0.75 * after[pairs.master[41]] - 0.25 * after[pairs.following[41]]
    expected = plan.stiffness[41] * 1e-7 - plan.damping[41] * 0.5 * (-1e-2 + rate)
    assert force[pairs.slave[41]] == pytest.approx(expected, rel=1e-11)
    assert force[pairs.master[41]] == pytest.approx(-0.75 * expected, rel=1e-11)
    assert force[pairs.following[41]] == pytest.approx(-0.25 * expected, rel=1e-11)


@pytest.mark.parametrize(("clipped", "sign"), [(True, 0.0), (False, -1.0)])
def test_a_pair_that_parts_pulls_only_where_the_force_is_not_clipped(clipped, sign):
    clearance = np.where(np.arange(113) == 40, -1e-9, WIDE)
    plan = HALF.plan(STEP, c_con=1.0, clearance=clearance, clipped=clipped)
    velocity = np.zeros_like(HALF.nodes)
    velocity[HALF.structure.pairs.slave[40], 1] = 1e-2
    force, _, closed = pushed(HALF, plan, np.zeros_like(HALF.nodes), velocity)
    assert closed == 1
    assert np.sign(force[HALF.structure.pairs.slave[40]]) == sign


def test_an_open_pair_pushes_nothing():
    force, _, closed = pushed(HALF, HALF.plan(STEP, clearance=1e-3), np.zeros_like(HALF.nodes), 0.0)
    assert closed == 0
    assert not force.any()


def restitution(z):
    """Of a pair with stiffness and damping ratio z, released at zero force: the closed form  [1]."""
    if z < 1.0:
        w = np.sqrt(1.0 - z * z)
        return np.exp(-(z / w) * (np.pi - np.arctan2(2.0 * z * w, w * w - z * z)))
    if z == 1.0:
        return np.exp(-2.0)
    w = np.sqrt(z * z - 1.0)
    return np.exp(-(z / w) * np.log((z + w) / (z - w)))


@pytest.mark.parametrize(
    ("z", "table"), [(0.0, 1.0), (0.2, 0.572), (0.5, 0.298), (0.9, 0.155), (1.0, 0.135), (5.0, 0.0093), (20.0, 0.0006)]
)
@pytest.mark.parametrize("lagged", [False, True])
def test_one_pair_rebounds_as_the_closed_form_says(z, table, lagged):
    """A node of the layer over a master node, the elements taken away; C_con = z m_reduced / m_smaller."""
    pair, pairs = 40, HALF.structure.pairs
    assert pairs.weight[pair] == 0.0
    k = HALF.plan(STEP).stiffness
    step = 1e-3 / (np.sqrt(k[pair] / pairs.reduced_mass[pair]) * (1.0 + 2.0 * z))
    c_con = z * pairs.reduced_mass[pair] / pairs.mass[:, pair].min()
    clearance = np.where(np.arange(113) == pair, 0.0, WIDE)
    plan = HALF.plan(step, c_con=c_con, clearance=clearance, lagged=lagged)
    plan = plan._replace(factors=np.zeros_like(plan.factors))
    approach = np.zeros_like(HALF.nodes)
    approach[pairs.slave[pair], 1] = -0.1
    state = HALF.begin(plan, np.zeros_like(HALF.nodes), approach)
    _, notes = advance(plan, state, np.zeros(20_000))
    velocity = HALF.velocity(state)[:, 1]
    assert (velocity[pairs.slave[pair]] - velocity[pairs.master[pair]]) / 0.1 == pytest.approx(restitution(z), rel=5e-3)
    assert restitution(z) == pytest.approx(table, rel=0.06 if z > 10.0 else 6e-3)
    assert HALF.structure.mass @ velocity == pytest.approx(-0.1 * HALF.structure.mass[pairs.slave[pair]], rel=1e-9)
    assert notes.impacts[0] == pytest.approx([2.0, 0.1])  # the second step is the first that starts in penetration
    assert notes.total[:2].tolist() == [1.0, 0.0]  # one impact, none of them in the middle


def test_the_paper_s_c_crit_is_the_damping_ratio_up_to_the_masses():
    pairs, plan = HALF.structure.pairs, HALF.plan(STEP)
    inner = pairs.share == 1.0
    true = 2.0 * np.sqrt(plan.stiffness * pairs.reduced_mass)[inner]
    ratio = (pairs.mass.min(axis=0) / pairs.reduced_mass)[inner]
    assert critical_damping(pairs, plan.stiffness)[inner] == pytest.approx(true * ratio, rel=1e-12)


def growth(c_con, factor, lagged, steps=20_000):
    """How much the velocities of the layer, closed throughout, grow from a random start.

    The layer lies deep in the beam and a constant suction carries the penalty's force: what is left is the linear
    motion about closed contact, neither opening nor clipped.
    """
    depth = 1e-3 * np.ones(113)
    plan = HALF.plan(STEP, beta=0.02, factor=factor, c_con=c_con, clearance=-depth, lagged=lagged, clipped=False)
    pressure = 1e-3 * plan.stiffness[50] / plan.area[50]
    if not lagged:  # an implicit damper lessens the force, before the law is added
        state = HALF.begin(plan, np.zeros_like(HALF.nodes))
        closed, _ = find_contact(plan, state)
        add_mobilities(plan, state, closed)
        depth[state.active[:closed]] *= 1.0 + 0.5 * plan.damping[:closed] * STEP * state.mobility[:closed]
    law = BoundLaw("contact", suction.function, np.array([pressure, 0, 0, 0, 0, 0, 0, 0]))
    contacts, parameters, number = addresses([law], "contact")
    plan = plan._replace(
        clearance=-depth, contact=contacts, contact_p=parameters, counts=np.array([plan.counts[0], number])
    )
    # a motion of 1e-9 m is far above the rounding of the two forces that cancel
    displacement = 1e-9 * np.random.default_rng(1).standard_normal(HALF.nodes.shape)
    displacement.ravel()[[*HALF.structure.held, HALF.structure.driven]] = 0.0
    state = HALF.begin(plan, displacement)
    advance(plan, state, np.zeros(100))
    early = np.abs(state.v).max()
    code, _ = advance(plan, state, np.zeros(steps))
    return np.inf if code == explicit.UNSTABLE else np.abs(state.v).max() / early


@pytest.mark.parametrize("c_con", [1.0, 5.0, 20.0, 100.0])
@pytest.mark.parametrize("factor", [0.01, 0.1])
def test_the_implicit_damper_is_stable_for_any_damping(c_con, factor):
    assert growth(c_con, factor, lagged=False) < 2.0


@pytest.mark.parametrize(("factor", "limit"), [(0.01, 3.9), (0.1, 1.2)])
def test_the_lagged_damper_is_stable_up_to_a_limit_only(factor, limit):
    assert growth(0.9 * limit, factor, lagged=True) < 2.0
    assert growth(1.1 * limit, factor, lagged=True) > 1e3
