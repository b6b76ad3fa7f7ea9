"""Higher harmonics of what a sweep runs through, against integrations by another method."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from calib.dynamics import swept_paths
from calib.dynamics.swept_response import swept_response
from calib.effects.cubic_stiffness import EFFECT as CUBIC_STIFFNESS
from calib.effects.quadratic_stiffness import EFFECT as QUADRATIC_STIFFNESS
from calib.effects.response_lag import EFFECT as RESPONSE_LAG
from calib.modelling.model import Model
from calib.objective.stable_stretches import harmonics_at
from calib.records.excitation import Excitation
from calib.records.held_response import at_one_level
from calib.records.response import complex_harmonics, make_response
from calib.simulators.oscillator.oscillator import Oscillator

VALUES = {"mass": 1.0, "damping": 1.0, "stiffness": 400.0, "k2": 8e3, "k3": 1e6}  # kg, N s/m, N/m, per kg
LEVEL = 0.25  # N
ORDERS = 1, 2, 3
FREQUENCIES = np.array([2.9, 3.1, 3.2, 3.3])  # Hz
PHASE = 0.7  # of the drive when the clock begins  [rad]
SETTLING_PERIODS, SAMPLES = 120, 256  # count; of the period that is measured


def force(x, v):
    return VALUES["damping"] * v + VALUES["stiffness"] * x + VALUES["k2"] * x**2 + VALUES["k3"] * x**3


def integrated(frequency, level=LEVEL, phase=PHASE):
    """Harmonics (order,) of the steady motion under level cos(2 pi F t + phase), as a lock-in tells them."""
    omega = 2.0 * np.pi * frequency

    def rate(t, y):
        return [y[1], level * np.cos(omega * t + phase) - force(*y)]

    begin = SETTLING_PERIODS / frequency
    t = begin + np.arange(SAMPLES) / SAMPLES / frequency
    x = solve_ivp(rate, (0.0, t[-1]), [0.0, 0.0], "DOP853", t, rtol=1e-9, atol=1e-12).y[0]
    return np.array([2.0 * np.mean(x * np.exp(-1j * k * (omega * t + phase))) for k in ORDERS])


def wanted(frequency=FREQUENCIES, amplitude=1.0):
    own = np.full((1, len(frequency)), amplitude)
    return make_response(frequency, ["mass"], own, LEVEL, "N", 0, 1.0, higher={2: own, 3: own})


def swept(measured, *effects, phase=0.0, **values):
    model = Model(Oscillator(), [QUADRATIC_STIFFNESS, CUBIC_STIFFNESS, *effects])
    drive = Excitation("mass", "force", frequency=3.0, amplitude=1.0, phase=phase)
    return swept_response(model, {**VALUES, **values}, drive, measured)


@pytest.fixture(scope="module")
def truth():
    return np.array([integrated(own) for own in FREQUENCIES]).T


@pytest.mark.parametrize("by_series", [True, False])
def test_harmonics_have_the_phase_of_the_excitation_as_reference(monkeypatch, truth, by_series):
    if not by_series:
        monkeypatch.setattr(swept_paths, "series_sweep", lambda *_: None)
    found = harmonics_at(swept(wanted(), phase=PHASE), wanted())[:, 0]
    sizes = np.abs(truth).max(axis=1)
    assert (sizes[1:] > 0.005 * sizes[0]).all(), "both are there to be compared"
    for own, expected, size in zip(found, truth, sizes, strict=True):
        np.testing.assert_allclose(own, expected, atol=2e-3 * size)


def test_orders_are_those_that_were_measured():
    nothing = np.ones((1, len(FREQUENCIES)))
    third = make_response(FREQUENCIES, ["mass"], nothing, LEVEL, "N", 0, 1.0, higher={3: nothing})
    found, both = swept(third), swept(wanted())
    assert "in_phase_2" not in found
    np.testing.assert_array_equal(complex_harmonics(found), complex_harmonics(both)[[0, 2]])


def test_a_lag_turns_a_harmonic_by_its_own_frequency():
    lag, plain = 2e-3, swept(wanted())
    late = swept(wanted(), RESPONSE_LAG, response_lag=lag)
    turned = np.exp(-2j * np.pi * np.array(ORDERS)[:, None, None] * plain.frequency.values * lag)
    np.testing.assert_allclose(complex_harmonics(late), turned * complex_harmonics(plain), rtol=1e-12, atol=1e-18)


def test_of_a_held_amplitude_harmonics_are_those_of_the_motion():
    """At the levels that the simulation says a held amplitude takes, an integration has its harmonics."""
    frequency, held = np.array([2.9, 3.0, 3.1, 3.2]), 6e-3
    measured = at_one_level(wanted(frequency, amplitude=held), "mass")
    found = harmonics_at(swept(measured), measured)[:, 0]
    factor = held / np.abs(found[0])
    truth = np.array([integrated(*own) for own in zip(frequency, factor * measured.level.values, strict=True)]).T
    for own, expected in zip(factor * found, truth, strict=True):
        np.testing.assert_allclose(own, expected, atol=2e-3 * np.abs(expected).max())
    np.testing.assert_allclose(np.abs(truth[0]), held, rtol=1e-3)


def struck(frequency, gap, restitution, periods=60):
    """Harmonics (order,) of a linear oscillator that meets a rigid stop, integrated from impact to impact."""
    omega, mass = 2.0 * np.pi * frequency, VALUES["mass"]

    def rate(t, y):
        return [y[1], (LEVEL * np.cos(omega * t + PHASE) - y[1] - VALUES["stiffness"] * y[0]) / mass]

    def impact(t, y):
        return y[0] - gap

    impact.terminal, impact.direction = True, 1.0
    begin = periods / frequency
    instants, end = begin + np.arange(4 * SAMPLES) / (4 * SAMPLES) / frequency, begin + 1.0 / frequency
    t, y, found = 0.0, [0.0, 0.0], []
    while t < end:
        own = instants[instants >= t]
        part = solve_ivp(rate, (t, end), y, "DOP853", dense_output=True, events=impact, rtol=1e-9, atol=1e-12)
        t = float(part.t[-1])
        own = own[own < t]
        found.append(part.sol(own)[0] if own.size else own)
        y = [gap - 1e-12, -restitution * part.y[1, -1]]
    x = np.concatenate(found)
    return np.array([2.0 * np.mean(x * np.exp(-1j * k * (omega * instants + PHASE))) for k in ORDERS])


def test_impacts_at_a_stop_show_in_the_harmonics():
    frequency, gap, restitution = np.array([3.2, 3.3, 3.4]), 3e-3, 0.5
    model, drive = Model(Oscillator(stop=True)), Excitation("mass", "force", frequency=3.0, amplitude=1.0, phase=PHASE)
    values = {"mass": 1.0, "damping": 1.0, "stiffness": 400.0, "gap": gap, "restitution": restitution}
    found = harmonics_at(swept_response(model, values, drive, wanted(frequency)), wanted(frequency))[:, 0]
    truth = np.array([struck(own, gap, restitution) for own in frequency]).T
    assert (np.abs(truth[1, -1]) > 0.03 * np.abs(truth[0, -1])).all()
    for own, expected in zip(found, truth, strict=True):
        np.testing.assert_allclose(own, expected, atol=2e-3 * np.abs(expected).max())
