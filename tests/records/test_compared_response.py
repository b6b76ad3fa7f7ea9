"""What is compared of frequency responses: amplitudes, or the levels that held amplitudes took."""

import numpy as np
import pytest

from calib.dynamics.swept_response import swept_response
from calib.modelling.model import Model
from calib.records.compared_response import (
    compared_harmonics,
    compared_of,
    compared_tolerances,
    in_standard_uncertainties,
)
from calib.records.excitation import Excitation
from calib.records.held_response import at_one_level
from calib.records.response import complex_amplitude, complex_harmonics, make_response, tolerances
from calib.simulators.oscillator import Oscillator

FREQUENCY = np.array([9.0, 10.0, 11.0, 9.5, 10.5, 11.5])  # Hz
SWEEP = np.repeat([0, 1], 3)
LEVEL = np.array([2.0, 0.5, 1.5, 6.0, 2.0, 5.0])  # N
HELD = np.array([1e-3, 1e-3, 1e-3, 3e-3, 3e-3, 3e-3])  # m
MASS = HELD * np.exp(-1j * np.radians([10.0, 90.0, 170.0, 20.0, 120.0, 175.0]))
TIP = MASS * np.array([2.0, 2.1, 2.2, 2.0, 2.2, 2.3]) * np.exp(0.1j)


def held(**further):
    record = make_response(
        FREQUENCY, ["mass", "tip"], np.array([MASS, TIP]), LEVEL, "N", SWEEP, place="mass", quantity="force", **further
    )
    return at_one_level(record, "mass")


def test_of_a_set_level_amplitudes_are_compared():
    record = make_response(FREQUENCY, ["mass"], MASS[None], 1.0, "N")
    np.testing.assert_array_equal(compared_harmonics(record), [complex_amplitude(record)])
    own, expected = compared_tolerances(record), tolerances(record)
    np.testing.assert_array_equal(own[0], expected[0])
    np.testing.assert_array_equal(own[1], [expected[1]])
    standard = complex_amplitude(in_standard_uncertainties(record))
    np.testing.assert_allclose(standard, complex_amplitude(record) / tolerances(record)[1], rtol=1e-14)


def test_at_a_held_amplitude_the_level_is_compared_and_how_other_bodies_move_with_it():
    record = held()
    level = HELD * LEVEL / record.level.values
    np.testing.assert_allclose(compared_harmonics(record)[0], [level * np.exp(-1j * np.angle(MASS)), TIP / MASS * HELD])
    again = compared_of(compared_harmonics(record), record.sweep.values, record)
    np.testing.assert_allclose(again[0], complex_amplitude(record), rtol=1e-13)


@pytest.mark.parametrize("stated", [True, False])
def test_its_uncertainty_is_in_proportion_the_same(stated):
    record = held(sigma=0.03 * np.abs(np.array([MASS, TIP]))) if stated else held()
    of_frequency, (of_parts,) = compared_tolerances(record)
    expected = tolerances(record)
    np.testing.assert_array_equal(of_frequency, expected[0])
    own, amplitude = np.abs(compared_harmonics(record)[0]), np.abs(complex_amplitude(record))
    np.testing.assert_allclose(of_parts[0] / own[0], expected[1][0] / amplitude[0], rtol=1e-13)
    np.testing.assert_allclose(of_parts[1], expected[1][1] * np.repeat([1e-3, 3e-3], 3) / amplitude[0], rtol=1e-13)


def test_what_is_compared_is_linear_in_the_damping():
    drive = Excitation("mass", "force", frequency=3.0, amplitude=1.0)
    frequency = np.linspace(2.8, 3.6, 9)
    wanted = at_one_level(make_response(frequency, ["mass"], np.full((1, 9), 2e-3), 1.0, "N"), "mass")

    def compared(damping):
        values = {"mass": 1.0, "stiffness": 400.0, "damping": damping}
        found = swept_response(Model(Oscillator()), values, drive, wanted)
        own = compared_of(complex_harmonics(found), found.sweep.values, wanted)[0, 0]
        return np.interp(frequency, found.frequency.values, own.imag)

    least, middle, largest = (compared(damping) for damping in (0.5, 2.0, 3.5))
    np.testing.assert_allclose(0.5 * (least + largest), middle, rtol=1e-6)
    assert (largest > 6.9 * least).all()
