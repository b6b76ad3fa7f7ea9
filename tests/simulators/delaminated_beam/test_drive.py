"""The prescribed displacement of the middle."""

import math

import numpy as np
import pytest

from calib.modelling.laws import BoundLaw, excitation
from calib.records.excitation import Harmonic
from calib.simulators.delaminated_beam.drive import BeamDrive

HARMONIC = Harmonic(frequency=25.0, amplitude=1e-3, phase=0.4)


@excitation
def third(t, phase, amplitude, x, p):
    """Return a third harmonic of the drive; p[0] is its share of the amplitude."""
    return p[0] * amplitude * math.cos(3.0 * phase)


@excitation
def swelling(t, phase, amplitude, x, p):
    """Return what makes the drive grow with time; p[0] is by how much a second."""
    return p[0] * t * x


def law(function, value):
    return BoundLaw("excitation", function.function, np.array([value, *[0.0] * 7]))


def exact(t, alpha, harmonics=((1, 1.0),)):
    """X, X' and X'' + alpha X' of a sum of harmonics."""
    w = 2.0 * np.pi * 25.0
    rows = np.zeros((len(t), 3))
    for k, share in harmonics:
        angle = k * (w * t + 0.4)
        x, v = share * 1e-3 * np.cos(angle), -share * 1e-3 * k * w * np.sin(angle)
        rows += np.stack([x, v, -((k * w) ** 2) * x + alpha * v], axis=1)
    return rows


@pytest.mark.parametrize("alpha", [0.0, 300.0])
def test_a_harmonic_has_its_exact_derivatives(alpha):
    drive = BeamDrive(HARMONIC, 1.0, alpha, ())
    np.testing.assert_allclose(drive.table(7, 64), exact(np.arange(65) / 64 * 0.04, alpha), rtol=1e-9, atol=1e-12)


def test_displacements_are_those_at_the_ends_of_steps():
    drive = BeamDrive(HARMONIC, 0.5, 0.0, ())
    expected = 0.5 * exact(np.arange(1, 51) / 50 * 0.04, 0.0)[:, 0]
    np.testing.assert_allclose(drive.displacements(3, 50), expected, atol=1e-15)
    np.testing.assert_allclose(drive.displacements(0, 64), drive.table(0, 64)[1:, 0], atol=1e-18)


def test_a_law_adds_to_the_drive_and_to_its_derivatives():
    drive = BeamDrive(HARMONIC, 1.0, 200.0, [law(third, 0.1)])
    expected = exact(np.arange(4097) / 4096 * 0.04, 200.0, ((1, 1.0), (3, 0.1)))
    found = drive.table(5, 4096)
    np.testing.assert_allclose(found[:, 0], expected[:, 0], atol=1e-15)
    np.testing.assert_allclose(found[:, 1], expected[:, 1], atol=1e-5 * np.abs(expected[:, 1]).max())
    np.testing.assert_allclose(found[:, 2], expected[:, 2], atol=1e-4 * np.abs(expected[:, 2]).max())
    np.testing.assert_allclose(drive.displacements(5, 4096), expected[1:, 0], atol=1e-15)


def test_a_law_that_looks_at_the_time_makes_each_period_another():
    drive = BeamDrive(HARMONIC, 1.0, 0.0, [law(swelling, 2.0)])
    for period in (0, 3):
        t = np.arange(1, 9) / 8 * 0.04
        grown = exact(t, 0.0)[:, 0] * (1.0 + 2.0 * (t + 0.04 * period))
        np.testing.assert_allclose(drive.displacements(period, 8), grown, rtol=1e-9, atol=1e-15)
        np.testing.assert_allclose(drive.table(period, 8)[1:, 0], grown, rtol=1e-9, atol=1e-15)


def test_tables_that_stay_the_same_are_made_once():
    drive = BeamDrive(HARMONIC, 1.0, 0.0, ())
    assert drive.table(0, 16) is drive.table(9, 16)
    assert drive.displacements(0, 16) is drive.displacements(9, 16)
    assert drive.table(0, 16) is not drive.table(0, 32)
    changing = BeamDrive(HARMONIC, 1.0, 0.0, [law(third, 0.1)])
    assert changing.table(0, 16) is not changing.table(0, 16)


def test_the_start_is_that_of_phase_zero():
    x, v = BeamDrive(HARMONIC, 2.0, 0.0, ()).at_start()
    assert x == pytest.approx(2e-3 * math.cos(0.4))
    assert v == pytest.approx(-2e-3 * 50.0 * math.pi * math.sin(0.4))


def test_scales_are_of_the_amplitude_and_never_nothing():
    drive = BeamDrive(HARMONIC, -2.0, 0.0, ())
    assert drive.length == pytest.approx(2e-3)
    assert drive.speed == pytest.approx(2e-3 * 50.0 * math.pi)
    assert BeamDrive(HARMONIC._replace(amplitude=0.0), 1.0, 0.0, ()).speed > 0.0
