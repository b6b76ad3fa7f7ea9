"""Effects on what is measured of a frequency response, against closed forms."""

import numpy as np
import pytest

from calib.dynamics.swept_response import swept_response
from calib.effects.residual_compliance import EFFECT as RESIDUAL_COMPLIANCE
from calib.effects.response_lag import EFFECT as RESPONSE_LAG
from calib.modelling.model import Model
from calib.records.excitation import Excitation
from calib.records.response import complex_amplitude, complex_harmonics, make_response
from calib.simulators.four_dof import FourDof
from calib.simulators.oscillator import Oscillator

MASS, STIFFNESS, DAMPING = 2.0, 800.0, 1.0  # kg, N/m, N s/m: 3.18 Hz
FREQUENCIES = np.linspace(2.9, 3.5, 13)  # Hz
LEVELS = np.linspace(0.2, 0.3, 13)  # N, of another size at every point


def receptance(frequency, mass=MASS, stiffness=STIFFNESS, damping=DAMPING):
    """Displacement over force of one mode  [m/N]."""
    omega = 2.0 * np.pi * frequency
    return 1.0 / (stiffness - mass * omega**2 + 1j * damping * omega)


def measured(effect, place="mass", quantity="force", **values):
    excitation = Excitation(place, quantity, frequency=3.0, amplitude=1.0)
    record = make_response(FREQUENCIES, ["mass"], np.ones((1, 13)), LEVELS, excitation.unit, 0, 1.0)
    own = {"mass": MASS, "stiffness": STIFFNESS, "damping": DAMPING, **values}
    return swept_response(Model(Oscillator(), [effect]), own, excitation, record)


def test_modes_far_above_and_a_body_that_floats_are_one_residual_compliance():
    """A second mode at 30 Hz and the body as a whole, 5 kg that nothing holds, beside the mode that is simulated."""
    beyond = receptance(FREQUENCIES, 0.5, 0.5 * (2.0 * np.pi * 30.0) ** 2) + receptance(FREQUENCIES, 5.0, 0.0, 0.0)
    mean = float(beyond.real.mean())
    assert mean < 0.0  # the body as a whole counts more
    found = measured(RESIDUAL_COMPLIANCE, residual_compliance=mean)
    inside = (found.frequency.values >= 2.9) & (found.frequency.values <= 3.5)
    frequency = found.frequency.values[inside]
    compliance = complex_amplitude(found)[0, inside] / found.level.values[inside]
    alone = receptance(frequency)
    np.testing.assert_allclose(compliance, alone + mean, atol=1e-7 * np.abs(alone).max())
    expected = alone + np.interp(frequency, FREQUENCIES, beyond.real)
    np.testing.assert_allclose(compliance, expected, atol=0.01 * np.abs(alone).max())
    assert np.abs(mean / alone).max() > 0.02


def test_damping_seems_to_differ_between_the_sides_of_the_resonance():
    """With the residual r, -Im(H) / (omega |H|^2) is the damping times |H - r|^2 / |H|^2: less above the resonance."""
    record = measured(RESIDUAL_COMPLIANCE, residual_compliance=2e-3)
    omega, level = 2.0 * np.pi * record.frequency.values, record.level.values
    found = complex_amplitude(record)[0] / level
    seeming = -found.imag / (omega * np.abs(found) ** 2)
    expected = DAMPING * np.abs((found - 2e-3) / found) ** 2
    np.testing.assert_allclose(seeming, expected, rtol=1e-3)
    assert seeming[0] < 0.9 * DAMPING
    assert seeming[-1] > 1.1 * DAMPING


def test_a_residual_has_no_higher_harmonic_and_a_lag_turns_each_by_its_own_frequency():
    frequency, ones = np.array([2.0, 5.0]), np.ones((1, 2))
    record = make_response(frequency, ["mass"], ones, 0.5, "N", higher={3: 2.0 * ones}, place="mass", quantity="force")
    both = Model(Oscillator(), [RESIDUAL_COMPLIANCE, RESPONSE_LAG])
    own = {"residual_compliance": -0.1, "response_lag": 0.0}
    np.testing.assert_allclose(complex_harmonics(both.measured_response(record, own))[:, 0, 0], [0.95, 2.0])
    late = complex_harmonics(both.measured_response(record, {"residual_compliance": 0.0, "response_lag": 0.01}))
    turn = np.exp(-2j * np.pi * 0.01 * frequency)
    np.testing.assert_allclose(late[:, 0], [turn, 2.0 * turn**3])


def test_the_residual_is_of_the_driven_body_and_of_forces_alone():
    record = make_response(np.array([20.0]), ["q2", "q3"], np.ones((2, 1)), 0.5, "N", place="q3", quantity="force")
    moved = Model(FourDof(), [RESIDUAL_COMPLIANCE]).measured_response(record, {"residual_compliance": -0.1})
    np.testing.assert_allclose(complex_amplitude(moved)[:, 0], [1.0, 0.95])
    shaken, plain = (
        measured(RESIDUAL_COMPLIANCE, "base", "base motion", residual_compliance=size) for size in (-0.1, 0.0)
    )
    np.testing.assert_array_equal(shaken.in_phase, plain.in_phase)


def test_a_response_that_is_read_late_has_a_phase_that_is_behind():
    late, plain = measured(RESPONSE_LAG, response_lag=1e-3), measured(RESPONSE_LAG)
    turned = np.angle(complex_amplitude(late) / complex_amplitude(plain))[0]
    assert turned == pytest.approx(-2.0 * np.pi * plain.frequency.values * 1e-3)
    assert late.piece.values.tolist() == plain.piece.values.tolist()
