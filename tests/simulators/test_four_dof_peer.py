"""Event times against scipy's DOP853 with events; chaotic motion against itself at finer and coarser jumps."""

import numpy as np
import pytest
from simulators.four_dof_peer import dop853

from calib.effects.quadratic_drag import drag
from calib.modelling.laws import BoundLaw, force
from calib.records.excitation import Excitation
from calib.simulators.four_dof import FourDof
from calib.simulators.impact import kernel
from calib.simulators.impact.initial_state import start
from calib.simulators.impact.problem import IMPACTS
from calib.simulators.impact.scratch import scratch

NOMINAL = {p.name: p.nominal for p in FourDof.parameters}
FASTER = 1e-3  # m/s
COUNT = 20  # impacts


@force
def hardening(t, x, v, p, z, dz):
    """A cubic spring."""
    return -p[0] * x * x * x


@force
def friction(t, x, v, p, z, dz):
    """Coulomb's friction, without any regularisation."""
    return -p[0] * np.sign(v)


@force(states=1)
def relaxing(t, x, v, p, z, dz):
    """A spring and a dashpot in series."""
    dz[0] = v - z[0] / p[1]
    return -p[0] * z[0]


def bound(law, *p, bodies=None):
    numbers = np.zeros(8)
    numbers[: len(p)] = p
    return BoundLaw(law.site, law.function, numbers, bodies, law.states)


def impacts_of(values, frequency, periods, laws=(), **options):
    """Impacts (n, 10) of the first periods from rest."""
    excitation = Excitation("end", "displacement", frequency=frequency, amplitude=1.5e-3)
    problem = FourDof(**options).problem(values, excitation, laws)
    state = start(problem, np.zeros(4), np.zeros(4))
    impacts, none = np.zeros((20_000, 10)), np.zeros((0, 10))
    rows = np.zeros((periods, 10))
    code = kernel.advance(problem, state, scratch(problem), periods, 0.0, 10**8, rows, np.zeros(0), none, impacts)
    assert code == kernel.DONE
    return impacts[: int(state.counters[IMPACTS])]


def drawn(seed, gaps, restitutions):
    rng = np.random.default_rng(seed)
    values = {
        **NOMINAL,
        "restitution": rng.uniform(*restitutions),
        "gap": rng.uniform(*gaps),
        "damping": 10 ** rng.uniform(-3.0, -1.5),
        "layer_stiffness": rng.uniform(0.6, 1.5),
    }
    return values, rng.uniform(24.0, 29.0)


def compare(values, frequency, laws=(), law=None, **options):
    """Largest difference of the first impacts' times [s], and the number of contact phases before them."""
    peer = dop853(values, frequency, 1.5e-3, COUNT, faster=FASTER, law=law)
    mine = impacts_of(values, frequency, int(peer.times[-1] * frequency) + 2, laws, **options)
    fast = mine[mine[:, 1] > FASTER, 0][:COUNT]
    expected = peer.times[peer.speeds > FASTER]
    assert len(fast) == len(expected) == COUNT
    return np.abs(fast - expected).max(), peer.contacts


@pytest.mark.parametrize("seed", [*range(4), *(pytest.param(i, marks=pytest.mark.slow) for i in range(4, 20))])
def test_event_times_agree_with_dop853(seed):
    difference, contacts = compare(*drawn(seed, (5e-4, 1.2e-3), (0.0, 0.9)))
    assert difference < (1e-11 if contacts == 0 else 1e-9)


@pytest.mark.parametrize("seed", [*range(4), *(pytest.param(i, marks=pytest.mark.slow) for i in range(4, 20))])
def test_event_times_agree_with_dop853_through_chatter_and_contact(seed):
    difference, _ = compare(*drawn(100 + seed, (1e-4, 3e-4), (0.0, 0.5)))
    assert difference < 1e-9


@pytest.mark.parametrize(("e", "gap"), [(0.05, 1e-3), (0.3, 1e-3), (0.3, 2e-4)])
def test_event_times_with_a_force_law_agree_with_dop853(e, gap):
    values = {**NOMINAL, "restitution": e, "gap": gap}
    law = bound(drag, 0.5, bodies=("q3",))
    difference, _ = compare(values, 26.24, [law], lambda t, q, dq: np.array([0.0, 0.0, -0.5 * dq[2] * abs(dq[2]), 0.0]))
    assert difference < 1e-8


def test_laws_of_a_site_add_up_and_act_on_their_bodies():
    values = {**NOMINAL, "restitution": 0.3}
    laws = [bound(drag, 0.5, bodies=("q3",)), bound(hardening, 2e9)]
    difference, _ = compare(
        values, 26.24, laws, lambda t, q, dq: -2e9 * q**3 - np.array([0.0, 0.0, 0.5 * dq[2] * abs(dq[2]), 0.0])
    )
    assert difference < 1e-8


def errors_over_steps(law, steps, values, periods=2, finest=2048):
    """Largest error of the impact times [s] at each number of steps a period, against the finest."""
    reference = impacts_of(values, 26.24, periods, [law], steps_per_period=finest)
    return [
        np.abs(
            impacts_of(values, 26.24, periods, [law], steps_per_period=n)[: len(reference), 0] - reference[:, 0]
        ).max()
        for n in steps
    ]


def test_the_collocation_is_of_high_order_for_a_smooth_law():
    """Order 8 in free motion, of steps that are as long as they are told."""
    values, excitation = {**NOMINAL, "gap": 1.0}, Excitation("end", "displacement", frequency=26.24, amplitude=1.5e-3)
    steps, ends, none = np.array([48, 64, 96, 1024]), [], np.zeros((0, 10))
    for n in steps:
        law = bound(hardening, 2e9)
        problem = FourDof(mode="fixed_step", steps_per_period=n).problem(values, excitation, [law])
        rows = np.zeros((2, 10))
        state = start(problem, np.zeros(4), np.zeros(4))
        kernel.advance(problem, state, scratch(problem), 2, 0.0, 10**8, rows, np.zeros(0), none, none)
        ends.append(rows[-1, :4])
    errors = [np.abs(end - ends[-1]).max() for end in ends[:-1]]
    assert np.polyfit(np.log(steps[:-1]), np.log(errors), 1)[0] < -6.0


def test_a_step_over_which_the_polynomial_misses_the_law_is_halved():
    values = {**NOMINAL, "restitution": 0.9}
    assert errors_over_steps(bound(hardening, 2e10), [64], values)[0] < 1e-7


def test_the_collocation_carries_internal_states():
    values = {**NOMINAL, "restitution": 0.9}
    errors = errors_over_steps(bound(relaxing, 2e3, 5e-3), [128], values)
    assert errors[0] < 1e-9


def test_friction_that_jumps_is_survived_by_short_steps():
    values = {**NOMINAL, "restitution": 0.3}
    errors = errors_over_steps(bound(friction, 2.0, bodies=("q3",)), [64, 1024], values, finest=4096)
    assert max(errors) < 1e-7


def test_a_law_that_gives_nothing_gives_the_same_motion():
    values = {**NOMINAL, "restitution": 0.3}
    without = impacts_of(values, 26.24, 5)
    closed = impacts_of(values, 26.24, 5, [bound(drag, 0.0)])
    fast = without[:, 1] > FASTER
    assert closed[closed[:, 1] > FASTER, 0] == pytest.approx(without[fast, 0], abs=1e-12)


@pytest.mark.slow
def test_no_impact_is_missed_in_chaotic_motion():
    """4500 periods, each taken from a common state with the jumps as they are and with jumps a 512th period long.

    The fine run bounds every flight's end by steps of T / 512 (laws that give nothing), and samples each of them.
    """
    excitation = Excitation("end", "displacement", frequency=26.24, amplitude=1.5e-3)
    empty, nothing = np.zeros((0, 10)), bound(drag, 0.0)
    differing = 0
    for e in (0.40, 0.45, 0.50, 0.55, 0.70, 0.80, 0.85, 0.9, 0.95):
        values = {**NOMINAL, "restitution": e}
        coarse = FourDof().problem(values, excitation)
        fine = FourDof(steps_per_period=512).problem(values, excitation, [nothing])
        state = start(coarse, np.zeros(4), np.zeros(4))
        rows = np.zeros((500, 10))
        kernel.advance(coarse, state, scratch(coarse), 500, 0.0, 10**9, rows, np.zeros(0), empty, empty)
        for row in rows:
            counts = []
            for problem in (coarse, fine):
                state, found, end = start(problem, row[:4], row[4:8]), np.zeros((400, 10)), np.zeros((1, 10))
                kernel.advance(problem, state, scratch(problem), 1, 0.0, 10**9, end, np.zeros(0), empty, found)
                found = found[: int(state.counters[IMPACTS])]
                counts.append(found[found[:, 1] > 1e-9, 0])
            same = len(counts[0]) == len(counts[1]) and np.allclose(*counts, atol=1e-9, rtol=0.0)
            differing += not same
    assert differing == 0
