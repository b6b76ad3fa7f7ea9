"""What a sweep runs through: against a closed form, and from branch to branch."""

import numpy as np

from calib.dynamics.swept_response import swept_response
from calib.effects.cubic_stiffness import EFFECT as CUBIC_STIFFNESS
from calib.modelling.model import Model
from calib.records.excitation import Excitation
from calib.records.response import complex_amplitude, make_response
from calib.simulators.oscillator.oscillator import Oscillator

VALUES = {"mass": 1.0, "damping": 1.0, "stiffness": 400.0}  # kg, N s/m, N/m
FORCE = Excitation("mass", "force", frequency=3.0, amplitude=1.0)


def swept(frequency, level, direction=1.0, **cubic):
    measured = make_response(frequency, ["mass"], np.ones((1, len(frequency))), level, "N", 0, direction)
    model = Model(Oscillator(), [CUBIC_STIFFNESS] if cubic else [])
    return swept_response(model, {**VALUES, **cubic}, FORCE, measured)


def test_the_response_of_a_linear_oscillator_is_its_transfer_function():
    found = swept(np.linspace(2.6, 4.0, 8), 0.5)
    omega = 2.0 * np.pi * found.frequency.values
    expected = 0.5 / (400.0 - omega**2 + 1j * omega)
    np.testing.assert_allclose(complex_amplitude(found)[0], expected, atol=1e-8 * abs(expected).max())


def test_a_sweep_down_jumps_up_where_the_lower_branch_folds():
    found = swept(np.linspace(4.2, 3.0, 7), 0.6, -1.0, k3=4e5)
    assert found.attrs["jumps"].startswith("sweep 0: fold at 3.50802")
    amplitude, piece = np.abs(complex_amplitude(found)[0]), found.piece.values
    assert amplitude[piece == 1.0][0] > 1.5 * amplitude[piece == 0.0][-1]
