"""One mass and a stop: what is known in closed form."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from calib.simulators.impact.assembly import ImpactDrive, assemble
from calib.simulators.impact.initial_state import start
from calib.simulators.impact.modes import LinearStructure, Stop, modal, viscous
from calib.simulators.impact.run import simulate

GRAVITY = 9.81  # m/s^2


def falling(restitution, height=1.0):
    """A mass of 1 kg that falls on a floor `height` below."""
    stop = Stop(np.ones(1), np.ones(1), height, restitution)
    return LinearStructure(np.eye(1), np.zeros((1, 1)), viscous(0.0), np.zeros((1, 3)), np.array([-GRAVITY]), stop)


def run(structure, duration, q=0.0, dq=0.0):
    problem = assemble(structure, ImpactDrive(period=duration), length=1.0)
    times = np.linspace(0.0, duration, 101)
    return simulate(problem, start(problem, np.array([q]), np.array([dq])), times, settle=0, sections=0)


def test_a_falling_ball_bounces_as_in_the_book():
    motion = run(falling(0.8), 4.0)
    first = np.sqrt(2.0 / GRAVITY)
    flights = 2.0 * np.sqrt(2.0 * GRAVITY) * 0.8 ** np.arange(1, 12) / GRAVITY
    expected = first + np.concatenate([[0.0], np.cumsum(flights)])
    expected = expected[expected < 4.0]
    assert motion.impacts[: len(expected), 0] == pytest.approx(expected, abs=1e-13)


def test_the_bouncing_ball_comes_to_rest_when_the_geometric_sum_says():
    e = 0.5
    motion = run(falling(e), 4.0)
    first = np.sqrt(2.0 / GRAVITY)
    rest = first * (1.0 + 2.0 * e / (1.0 - e))
    assert motion.impacts[-1, 0] == pytest.approx(rest, abs=1e-5)
    assert motion.contact == pytest.approx((4.0 - rest) / 4.0, abs=1e-5)
    assert motion.samples[-1, :2] == pytest.approx([-1.0, 0.0], abs=1e-12)


def test_an_elastic_ball_bounces_for_ever():
    motion = run(falling(1.0, height=1e-3), 3.0)
    assert motion.status == "ok"
    flight = 2.0 * np.sqrt(2e-3 / GRAVITY)
    assert len(motion.impacts) == int(3.0 / flight + 0.5)
    assert motion.impacts[:, 1] == pytest.approx(np.sqrt(2e-3 * GRAVITY), rel=1e-9)


def test_an_oscillator_that_rests_on_its_stop_is_hit_every_half_period():
    structure = LinearStructure(
        np.eye(1),
        np.array([[100.0]]),
        modal(0.0),
        np.zeros((1, 3)),
        np.zeros(1),
        Stop(np.ones(1), np.ones(1), 0.0, 0.5),
    )
    motion = run(structure, 2.0, dq=1.0)
    assert motion.impacts[:, 0] == pytest.approx(np.arange(1, 7) * np.pi / 10.0, abs=1e-12)
    assert motion.impacts[:, 1] == pytest.approx(0.5 ** np.arange(6), rel=1e-10)


@pytest.mark.parametrize("share", [1e-4, 1e-8, 1e-11])
def test_a_graze_is_judged_by_its_depth_however_short_it_is(share):
    """The clearance of an oscillator dips to -share or +share of its amplitude for a moment."""
    for depth, hits in ((share, 1), (-share, 0)):
        stop = Stop(np.ones(1), np.ones(1), 1.0 - depth, 0.0)
        structure = LinearStructure(np.eye(1), np.array([[1.0]]), modal(0.0), np.zeros((1, 3)), np.zeros(1), stop)
        assert len(run(structure, 2.0 * np.pi, q=1.0).impacts) == hits


def test_a_body_pressed_onto_its_stop_leaves_when_the_pull_turns():
    """A pull x'' = -p cos(w t) presses onto a floor at x = 0 first: contact ends at a quarter of the period."""
    stop = Stop(np.ones(1), np.ones(1), 0.0, 0.3)
    load = np.array([[1.0, 0.0, 0.0]])
    structure = LinearStructure(np.eye(1), np.zeros((1, 1)), viscous(0.0), load, np.zeros(1), stop)
    drive = ImpactDrive(period=1.0, omega=2.0 * np.pi, amplitude=-1.0 + 0.0j)
    problem = assemble(structure, drive, length=1.0)
    state = start(problem, np.zeros(1), np.zeros(1))
    times = np.linspace(0.0, 0.999, 1000)
    motion = simulate(problem, state, times, settle=0, sections=0)
    resting = motion.samples[:, 0] < 1e-13
    assert times[resting][-1] == pytest.approx(0.25, abs=2e-3)
    assert np.abs(motion.samples[times < 0.25, :2]).max() < 1e-13
    w, t = 2.0 * np.pi, 0.5  # x'' = -cos w t from rest at t = 1/4
    x = (np.cos(w * t) - np.cos(w * 0.25)) / w**2 + (t - 0.25) / w
    assert np.interp(t, times, motion.samples[:, 0]) == pytest.approx(x, rel=1e-3)


def test_a_tabulated_input_gives_the_same_as_the_harmonic_it_samples():
    w, n = 2.0 * np.pi * 3.0, 4001
    structure = LinearStructure(np.eye(1), np.array([[400.0]]), modal(0.02), np.array([[400.0, 0.8, 0.0]]), np.zeros(1))
    duration = 2.0
    harmonic = assemble(structure, ImpactDrive(period=1.0 / 3.0, omega=w, amplitude=1.0))
    t = np.linspace(0.0, duration, n)
    spline = CubicSpline(t, np.cos(w * t), bc_type=((1, 0.0), (1, 0.0)))
    table = assemble(structure, ImpactDrive(period=duration, knots=t, table=spline.c[::-1].T))
    rest = np.zeros(1), np.zeros(1)
    times = np.linspace(0.0, duration - 1e-3, 300)
    a = simulate(harmonic, start(harmonic, *rest), times, periods=6, settle=0, sections=0)
    b = simulate(table, start(table, *rest), times, settle=0, sections=0)
    assert b.samples[:, :2] == pytest.approx(a.samples[:, :2], rel=1e-9, abs=1e-8)


def test_an_unstable_structure_ends_with_a_status():
    structure = LinearStructure(np.eye(1), np.array([[-400.0]]), modal(0.0), np.zeros((1, 3)), np.zeros(1))
    assert run(structure, 50.0, q=1e-3).status == "diverged"
