"""The force that a prescribed motion needs."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from calib.effects.backlash import EFFECT as BACKLASH
from calib.effects.backlash import SLIDING_RANGE
from calib.effects.quadratic_drag import EFFECT as AIR_DRAG
from calib.errors import CalibError
from calib.modelling.effect import Effect
from calib.modelling.laws import excitation as excitation_law
from calib.modelling.laws import force as force_law
from calib.modelling.model import Model
from calib.modelling.parameter import Parameter
from calib.modelling.simulator import Request
from calib.records.excitation import Excitation
from calib.simulators.oscillator import Oscillator

VALUES = {"mass": 2.0, "damping": 10.0, "stiffness": 900.0, "load": 3.0}
RATE = 2000.0  # Hz
TIME = np.arange(-1000, 5000) / RATE
ASKED = np.arange(0, 4000, 5) / RATE


def slow(t):
    """Motion [m] of a few hertz, its velocity and its acceleration."""
    w = 2 * np.pi * np.array([[1.0], [2.7]])
    size, turn = np.array([[0.01], [0.004]]), w * t + np.array([[0.3], [1.1]])
    parts = (size * np.cos(turn), -size * w * np.sin(turn), -size * w**2 * np.cos(turn))
    return tuple(part.sum(axis=0) for part in parts)


def prescribed(cutoff=200.0, noise=0.0):
    value = slow(TIME)[0] + noise * np.random.default_rng(1).standard_normal(TIME.size)
    return Excitation("mass", "displacement", time=TIME, value=value, cutoff=cutoff)


def force_of(values, excitation, effects=(), request=None):
    record = Model(Oscillator(), effects).run(values, excitation, request or Request(times=ASKED))
    assert record.attrs["status"] == "ok", record.attrs["reason"]
    assert record.attrs["prescribed"] == "mass.displacement,mass.velocity"
    return record


def test_the_force_is_what_newton_asks_for():
    record = force_of(VALUES, prescribed())
    x, v, a = slow(ASKED)
    np.testing.assert_allclose(record.displacement[0], x, rtol=0, atol=1e-9)
    np.testing.assert_allclose(record.velocity[0], v, rtol=0, atol=1e-7)
    np.testing.assert_allclose(record.force[0], 2.0 * a + 10.0 * v + 900.0 * x - 3.0, rtol=0, atol=1e-4)


def test_amplitude_is_a_factor_on_the_motion():
    once, twice = (force_of({**VALUES, "load": 0.0, "amplitude": s}, prescribed()) for s in (1.0, 2.0))
    np.testing.assert_allclose(twice.force, 2.0 * once.force, rtol=1e-9, atol=1e-9)


def test_the_cutoff_keeps_noise_out_of_the_acceleration():
    expected = force_of({"mass": 1.0, "damping": 0.0, "stiffness": 0.0}, prescribed()).force
    errors = [
        float(np.std(force_of({"mass": 1.0, "damping": 0.0, "stiffness": 0.0}, prescribed(c, 1e-6)).force - expected))
        for c in (400.0, 40.0)
    ]
    assert errors[1] < errors[0] * (1 / 10) ** 2  # at least: noise in a'' grows as the cutoff^2.5


def test_a_motion_and_the_force_that_made_it_belong_together():
    force = 5.0 * np.sin(2 * np.pi * 1.5 * TIME) + 2.0 * np.cos(2 * np.pi * 4.0 * TIME)
    driven = Excitation("mass", "force", time=TIME, value=force)
    motion = Model(Oscillator()).run(VALUES, driven, Request(times=TIME))
    back = Excitation("mass", "displacement", time=TIME, value=motion.displacement.values[0], cutoff=200.0)
    found = force_of(VALUES, back).force.values[0]
    np.testing.assert_allclose(found[50:-50], np.interp(ASKED, TIME, force)[50:-50], rtol=0, atol=2e-3)


def test_a_force_law_is_taken_off():
    plain, dragged = (force_of(VALUES | {"c2": c2}, prescribed(), [AIR_DRAG]) for c2 in (0.0, 7.0))
    v = plain.velocity.values
    np.testing.assert_allclose(dragged.force - plain.force, 2.0 * 7.0 * v * abs(v), rtol=1e-9, atol=1e-12)


@force_law(states=1)
def sliding(t, x, v, p, z, dz):
    """Return Dahl's friction: -p[0] z, z' = v (1 - sign(v) p[0] z / p[1])."""
    dz[0] = v - abs(v) * p[0] * z[0] / p[1]
    return -p[0] * z[0]


DAHL = Effect(
    "dahl",
    "force",
    sliding,
    (Parameter("sigma", "1/s^2", 0.0, "stiffness", null=0.0), Parameter("slip", "m/s^2", 0.5, "limit")),
    meaning="presliding friction",
)


def test_internal_states_of_a_law_follow_the_motion():
    values = {"mass": 1.0, "damping": 0.0, "stiffness": 0.0, "slip": 0.5}
    plain, rubbed = (force_of(values | {"sigma": s}, prescribed(), [DAHL]).force.values[0] for s in (0.0, 2e4))

    def rate(t, z):
        v = slow(np.array([t]))[1][0]
        return v - abs(v) * 2e4 * z / 0.5

    start, end = TIME[0], ASKED[-1]
    peer = solve_ivp(rate, (start, end), [0.0], "LSODA", ASKED, rtol=1e-9, atol=1e-14, max_step=1e-3)
    np.testing.assert_allclose(rubbed - plain, 2e4 * peer.y[0], rtol=0, atol=0.5e-3)


def test_a_state_that_sets_out_from_zero_where_its_law_begins_to_slide_costs_few_steps():
    stiffness, width, limit = 476.0, 2e-3, 2.0  # 1/s^2, m, m/s^2: slides from 6.2 mm on, which the motion reaches late
    mount = {"backlash_stiffness": stiffness, "backlash_width": width, "backlash_force": limit}
    values = {"mass": 1.0, "damping": 0.0, "stiffness": 0.0}
    plain = force_of(values, prescribed()).force.values[0]
    request = Request(times=ASKED, step_budget=20 * TIME.size)
    moved = force_of(values | mount, prescribed(), [BACKLASH], request).force.values[0]

    def pull(t, z):
        u = slow(np.array([t]))[0][0] - z[0]
        return stiffness * np.sign(u) * max(0.0, abs(u) - width)

    def rate(t, z):
        v = slow(np.array([t]))[1][0]
        over = (abs(pull(t, z)) - limit) / (SLIDING_RANGE * limit)
        return [v * min(1.0, max(0.0, over)) if pull(t, z) * v > 0.0 else 0.0]

    peer = solve_ivp(rate, (TIME[0], ASKED[-1]), [0.0], "RK45", ASKED, rtol=1e-8, atol=1e-12, max_step=1e-3)
    expected = [pull(t, z) for t, z in zip(ASKED, peer.y.T, strict=True)]
    assert max(np.abs(peer.y[0])) > 1e-3  # m: it slides
    np.testing.assert_allclose(moved - plain, expected, rtol=0, atol=1e-3)


@force_law(states=1)
def imploding(t, x, v, p, z, dz):
    """Return z, whose rate is no number from 0.2 s on."""
    dz[0] = p[0] * np.sqrt(0.2 - t)
    return z[0]


IMPLODING = Effect(
    "imploding", "force", imploding, (Parameter("i0", "m/s^2", 0.0, "size", null=0.0),), meaning="a law that breaks"
)


def test_a_state_that_is_no_number_is_a_status_at_once():
    request = Request(times=ASKED, step_budget=20 * TIME.size)
    record = Model(Oscillator(), [IMPLODING]).run(VALUES | {"i0": 1.0}, prescribed(), request)
    assert record.attrs["status"] == "diverged"


def test_states_too_quick_for_the_step_budget_are_a_status():
    request = Request(times=ASKED, step_budget=1000)
    record = Model(Oscillator(), [DAHL]).run(VALUES | {"sigma": 1e12}, prescribed(), request)
    assert record.attrs["status"] == "step budget"
    assert "internal states" in record.attrs["reason"]


@excitation_law
def third_harmonic(t, phase, amplitude, x, p):
    """Return a third harmonic of the drive; p[0] is its share."""
    return p[0] * amplitude * np.cos(3.0 * phase)


THIRD = Effect(
    "third", "excitation", third_harmonic, (Parameter("h3", "1", 0.0, "share", null=0.0),), meaning="drive harmonic"
)


@pytest.mark.parametrize("h3", [0.0, 0.1])
def test_a_harmonic_motion_with_and_without_a_law_of_the_excitation(h3):
    excitation = Excitation("mass", "displacement", frequency=5.0, amplitude=2e-3, phase=0.4)
    record = force_of(VALUES | {"h3": h3}, excitation, [THIRD], Request(periods=3, samples=100))
    w, t = 2 * np.pi * 5.0, record.time.values
    expected = -3.0 + sum(
        share * 2e-3 * ((900.0 - 2.0 * (n * w) ** 2 + 10j * n * w) * np.exp(1j * n * (w * t + 0.4))).real
        for n, share in ((1, 1.0), (3, h3))
    )
    np.testing.assert_allclose(record.force[0], expected, rtol=0, atol=1e-5 if h3 else 1e-12)
    assert record.attrs["frequency"] == 5.0
    np.testing.assert_allclose(record.section_displacement[0], record.displacement[0, 0], rtol=1e-9)


def test_what_it_cannot_take_is_refused():
    with pytest.raises(
        CalibError, match='never silently: state the low-pass that goes before, as in cutoff = "100 Hz"'
    ):
        force_of(VALUES, prescribed(cutoff=None))
    with pytest.raises(CalibError, match="input lasts from -0.5 to 2.4995 s"):
        force_of(VALUES, prescribed(), request=Request(times=np.linspace(0.0, 3.0, 7)))
    with pytest.raises(CalibError, match="half the sampling rate"):
        force_of(VALUES, replace(prescribed(), cutoff=1500.0))
