"""The reduced kernel: its implicit contact, its equations."""

import numpy as np
import pytest
from short_beam import EXCITATION, VALUES, beam

from calib.simulators.delaminated_beam import reduction
from calib.simulators.delaminated_beam.drive import centre_displacement
from calib.simulators.delaminated_beam.reduced.contact import apply_contact_forces, find_near_pairs
from calib.simulators.delaminated_beam.reduced.engine import ReducedEngine
from calib.simulators.delaminated_beam.reduced.linear_algebra import cholesky_factorise, cholesky_solve
from calib.simulators.delaminated_beam.reduced.stepping import drift_modes
from calib.simulators.delaminated_beam.reduction import Fineness

FINENESS = Fineness(24, 512, 8)
SEEDS = pytest.mark.parametrize("seed", range(8))


def engine(fineness=FINENESS, budget=10**9, **changes):
    """Return the reduced kernel of the short beam; options of the simulator and values may be changed."""
    options = {name: changes.pop(name) for name in ("clipped", "symmetric", "masters") if name in changes}
    sim = beam(**options)
    values = {p.name: p.nominal for p in sim.parameters}
    return sim._case({**values, **VALUES, **changes}, centre_displacement(EXCITATION), ()).reduced(
        fineness, None, budget
    )


def shaken(seed, **changes):
    """Return a kernel with random coordinates and rates, many of its pairs closed, and all of them near."""
    made, rng = engine(masters=16, **{"s": -5e-4, "g_max": 0.0, **changes}), np.random.default_rng(seed)
    plan, now = made.plan, made.now
    n, omega = len(now.kick), np.sqrt(np.arange(1.0, len(now.kick) + 1))
    now.q[:n] = rng.normal(size=n) / omega**2
    now.v[:n] = rng.normal(size=n) / omega
    now.q[:n] *= 1e-3 / np.abs(plan.opening[:, :n] @ now.q[:n]).max()
    now.v[:n] *= 0.5 / np.abs(plan.opening[:, :n] @ now.v[:n]).max()
    near = np.flatnonzero(plan.stiffness > 0.0)
    now.near[: len(near)] = near
    return made, len(near)


def kicked(made, near, part=None):
    """Push apart once; return gaps and opening rates before and after, and the number of closed pairs."""
    plan, now = made.plan, made.now
    m, n = len(plan.clearance), len(now.kick)
    gap = plan.clearance + plan.opening @ now.q
    before = plan.opening @ now.v
    room = np.zeros(m), np.zeros(m), np.zeros(m), np.zeros(m, dtype=np.int64), np.zeros((2, m, m))
    room += np.zeros((2, m + 1), dtype=np.int64), np.zeros(m), np.zeros(n)
    closed = apply_contact_forces(plan, now, near, part or plan.step / plan.parts, *room)
    return gap, before, plan.opening @ now.v, closed


def test_the_solver_is_that_of_linear_algebra():
    rng = np.random.default_rng(5)
    for count in (1, 2, 7, 40):
        root = rng.normal(size=(count, count + 3))
        matrix, right = root @ root.T, rng.normal(size=count)
        expected = np.linalg.solve(matrix, right)
        room, solution = np.zeros((64, 64)), np.zeros(64)
        room[:count, :count], solution[:count] = np.tril(matrix), right
        first = count // 2
        cholesky_factorise(room, 0, first)
        cholesky_factorise(room, first, count)
        cholesky_solve(room, solution, count)
        np.testing.assert_allclose(solution[:count], expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@SEEDS
@pytest.mark.parametrize("changes", [{}, {"c_con": 0.0}, {"c_con": 100.0, "f": 1.0}], ids=["plain", "springs", "hard"])
def test_pushes_are_none_that_pull_and_fulfil_their_equations(seed, changes):
    made, near = shaken(seed, **changes)
    plan, now = made.plan, made.now
    part = plan.step / plan.parts
    gap, before, after, closed = kicked(made, near)
    push = now.push
    assert closed == (gap[plan.stiffness > 0.0] < 0.0).sum() > 3
    assert (push >= 0.0).all()
    assert not push[gap >= 0.0].any()
    held = np.flatnonzero(push)
    # the force of a closed pair: its spring and its damper, at the end of the part
    yielded = plan.compliance[np.ix_(held, held)] @ push[held]
    depth = -(gap[held] + part * after[held] + yielded)
    rate = -(after[held] + yielded / part)
    expected = plan.stiffness[held] * depth + plan.damping[held] * rate
    np.testing.assert_allclose(push[held], expected, rtol=1e-6, atol=1e-6 * push.max())


def test_factors_that_are_kept_are_those_that_would_be_made_anew():
    made, near = shaken(2)
    plan, now, start = made.plan, made.now, {}
    m, n, part = len(plan.clearance), len(now.kick), plan.step / plan.parts

    def room():
        lists = np.zeros(m), np.zeros(m), np.zeros(m), np.zeros(m, dtype=np.int64), np.zeros((2, m, m))
        return *lists, np.zeros((2, m + 1), dtype=np.int64), np.zeros(m), np.zeros(n)

    kept, closed = room(), set()
    for _ in range(40):
        drift_modes(plan.near, now.q, now.v, 0.0, 0.0)
        start = {name: getattr(now, name).copy() for name in ("q", "v", "push")}
        closed.add(apply_contact_forces(plan, now, near, part, *kept))
        moved = now.q.copy()
        for name, value in start.items():
            getattr(now, name)[:] = value
        apply_contact_forces(plan, now, near, part, *room())
        np.testing.assert_allclose(now.q, moved, rtol=1e-12, atol=1e-12 * np.abs(moved).max())
    assert len(closed) > 3


@pytest.mark.parametrize("decay", [0.0, 1e3, 1e6])
def test_a_mode_that_a_steady_force_holds_does_not_creep(decay):
    omega, part = np.array([1e2, 1e4, 1e5, 3e5]), 5e-6
    near = reduction.drift(omega, np.full(4, decay), np.zeros(4), part)
    along = reduction._along(omega, near, part)
    fallen, rate = near.qq - 1.0, near.vq  # from one beyond its place, at rest
    np.testing.assert_allclose(fallen - along * rate, 0.0, atol=1e-9)
    assert along[0] == pytest.approx(0.5 * part, rel=0.02 if decay < 1e6 else 2.0)


def test_no_mode_that_is_held_grows_however_long_the_part():
    omega = np.linspace(1e3, 1e7, 5000)
    near = reduction.drift(omega, np.zeros(5000), np.zeros(5000), 5e-6)
    along = reduction._along(omega, near, 5e-6)
    assert (np.abs(near.qq - along * near.vq) <= 1.0 + 1e-9).all()  # its rate is taken at the end of each part


@pytest.mark.parametrize("f", [0.001, 0.3])
@pytest.mark.parametrize("c_con", [0.0, 0.1, 100.0])
@pytest.mark.parametrize("fineness", [Fineness(40, 512, 12), Fineness(80, 256, 1)], ids=["fine", "coarse"])
def test_contact_of_any_hardness_leaves_the_motion_bounded(fineness, f, c_con):
    made = engine(fineness, masters=16, f=f, c_con=c_con, s=0.0)
    made.period(1)
    for _ in range(50):
        period = made.period(64)
        assert period.status == "ok"
        assert np.abs(period.samples[:, :2]).max() < 1.05 * EXCITATION.amplitude
    assert made.contact_recorded(50).fraction > 0.0


@SEEDS
def test_pairs_without_a_push_go_apart_or_would_pull(seed):
    made, near = shaken(seed)
    plan, now = made.plan, made.now
    part = plan.step / plan.parts
    gap, before, after, closed = kicked(made, near)
    dropped = np.flatnonzero((gap < 0.0) & (now.push == 0.0) & (plan.stiffness > 0.0))
    yielded = plan.compliance @ now.push
    spring = plan.stiffness * -(gap + part * after + yielded) + plan.damping * -(after + yielded / part)
    # most of those that were left out would pull now too; leaving out one at a time would make it all
    assert (spring[dropped] <= 1e-9 * now.push.max()).mean() > 0.7 if len(dropped) else True


@SEEDS
@pytest.mark.parametrize("c_con", [0.0, 1.0, 50.0])
def test_a_kick_by_contact_takes_no_more_than_it_finds(seed, c_con):
    made, near = shaken(seed, c_con=c_con)
    plan, now = made.plan, made.now
    n, part = len(now.kick), plan.step / plan.parts
    before = now.v[:n].copy()
    kinetic = 0.5 * before @ before
    gap, *_ = kicked(made, near)
    compressed = 0.5 * (plan.stiffness * np.minimum(gap, 0.0) ** 2).sum()
    assert 0.5 * now.v[:n] @ now.v[:n] <= kinetic + compressed
    np.testing.assert_allclose(now.v[:n], before + part * (now.push @ plan.opening[:, :n]), rtol=1e-12, atol=1e-12)


def test_pairs_that_are_closed_and_part_slowly_are_all_left_alone():
    made, near = shaken(1, c_con=100.0)
    made.now.v[:] = 0.0
    opening = made.plan.opening[:, :-1]
    made.now.v[:-1] = np.linalg.lstsq(opening[1:-1], np.full(len(opening) - 2, 5.0), rcond=None)[0]
    _, before, after, closed = kicked(made, near)
    assert closed
    fast = before > 1.0
    assert not made.now.push[fast].any()


def test_a_force_that_may_pull_pulls():
    made, near = shaken(1, c_con=100.0, clipped=False)
    gap, before, _, _ = kicked(made, near)
    assert (made.now.push < 0.0).any()
    assert not made.now.push[gap >= 0.0].any()


def test_a_pair_without_stiffness_is_never_near():
    made = engine(s=-1e-3)
    count, _ = find_near_pairs(made.plan, made.now, made.plan.step)
    assert 0 < count < len(made.plan.clearance)  # the one at the tip is one node
    assert not made.plan.stiffness[np.setdiff1d(np.arange(len(made.plan.clearance)), made.now.near[:count])].any()


def test_every_second_pair_carries_the_load_of_two():
    one, two = engine(), engine(Fineness(24, 512, 8, 2))
    for name in ("stiffness", "damping"):
        assert getattr(two.plan, name).sum() == pytest.approx(getattr(one.plan, name).sum(), rel=0.3)
    np.testing.assert_array_equal(two.plan.place, one.plan.place[::2])
    assert two.plan.place[two.plan.centre] == 0.0


def test_more_modes_keep_the_state_of_fewer():
    made = engine(Fineness(4, 512, 8))
    made.period(4)
    state = made.carried(9).reshape(2, -1)
    np.testing.assert_array_equal(state[:, :4].ravel(), made.map_state())
    assert not state[:, 4:].any()


def test_without_drive_damping_and_contact_energy_stays():
    start, drifts = np.zeros(48), []
    start[0], start[2] = 1e-3, -2e-4
    for steps in (512, 2048):
        made = engine(Fineness(24, steps, 1), alpha=0.0, beta=0.0, s=1.0)
        table = np.zeros((steps + 1, 3))
        made = ReducedEngine(made.plan, EXCITATION.period, lambda period, rows=table: rows, start, 10**9)
        plan, levels = made.plan, []
        omega = np.arccos(np.clip(plan.flight.qq, -1.0, 1.0)) / plan.step  # below half the sampling frequency
        for _ in range(40):
            q, v = made.now.q[:-1], made.now.v[:-1]
            bent = 0.5 * q @ plan.quadratic[:-1, :-1] @ q
            membrane = (plan.tension[:-1] @ q) * bent + 0.5 * plan.kappa * bent**2
            levels.append((0.5 * v @ v + 0.5 * (omega * q) @ (omega * q))[()] + membrane)
            assert made.period(1).status == "ok"
        drifts.append(np.ptp(levels) / levels[0])
    assert drifts[0] < 1e-2
    assert drifts[1] < 0.2 * drifts[0]
