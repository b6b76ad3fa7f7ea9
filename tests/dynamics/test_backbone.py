"""Backbones and constant responses, against closed forms and against responses at constant level."""

import numpy as np
import pytest

from calib.dynamics.backbone import backbones, constant_responses
from calib.dynamics.harmonic_response import balanced_response
from calib.dynamics.setting import Setting
from calib.effects.cubic_stiffness import EFFECT as CUBIC_STIFFNESS
from calib.effects.drive_harmonic_2 import EFFECT as DRIVE_HARMONIC_2
from calib.errors import CalibError
from calib.modelling.model import Model
from calib.records.excitation import Excitation
from calib.simulators.four_dof import FourDof
from calib.simulators.oscillator import Oscillator

MASS, DAMPING, STIFFNESS, CUBIC = 1.0, 1.0, 400.0, 4e5  # kg, N s/m, N/m, 1/(m^2 s^2)
DUFFING = Setting(
    Model(Oscillator(), [CUBIC_STIFFNESS]),
    Excitation("mass", "force", frequency=3.0, amplitude=0.6, phase=0.7),
    {"mass": MASS, "damping": DAMPING, "stiffness": STIFFNESS, "k3": CUBIC},
)
FOUR_DOF = Setting(
    Model(FourDof(), [CUBIC_STIFFNESS]),
    Excitation("end", "displacement", frequency=26.24, amplitude=1.5e-3),
    {"k3": 2e9},
)


def squared(amplitude):
    """Square of the angular frequency of the free Duffing oscillator to first order  [1/s^2]."""
    return STIFFNESS / MASS + 0.75 * CUBIC * amplitude**2


def test_with_one_harmonic_the_backbone_of_a_duffing_oscillator_is_that_of_first_order():
    [found] = backbones(DUFFING, "mass", (2.5, 6.0), (0.01, 1.0), harmonics=1)
    omega = 2.0 * np.pi * found.frequency
    np.testing.assert_allclose(omega**2, squared(found.amplitude), rtol=1e-8)
    np.testing.assert_allclose(found.level, DAMPING * omega * found.amplitude, rtol=1e-8)
    assert found.level[[0, -1]] == pytest.approx([0.01, 1.0])


def test_a_backbone_runs_through_the_resonances_of_responses_in_quadrature():
    [found] = backbones(DUFFING, "mass", (2.5, 6.0), (0.05, 0.6))
    [response] = balanced_response(DUFFING, (2.5, 4.2), [0.6], steps=2).branches
    lag = np.angle(response.harmonics[0, 1])
    at = np.flatnonzero((lag[:-1] > -np.pi / 2) & (lag[1:] <= -np.pi / 2))[0]
    share = (lag[at] + np.pi / 2) / (lag[at] - lag[at + 1])
    crossing = response.frequency[at] + share * (response.frequency[at + 1] - response.frequency[at])
    assert found.frequency[-1] == pytest.approx(crossing, rel=1e-3)
    np.testing.assert_allclose(np.angle(found.harmonics[0, 1]), -np.pi / 2, atol=1e-9)
    assert found.left_out.max() < 1e-5


def test_a_held_amplitude_takes_the_level_of_the_first_order_response():
    for found in constant_responses(DUFFING, "mass", [2e-3, 12e-3], (2.5, 4.5), harmonics=1):
        amplitude, omega = found.amplitude, 2.0 * np.pi * found.frequency
        np.testing.assert_allclose(amplitude, amplitude[0], rtol=1e-9)
        np.testing.assert_allclose(
            found.level, amplitude * np.hypot(MASS * (squared(amplitude) - omega**2), DAMPING * omega), rtol=1e-8
        )
        assert found.frequency[[0, -1]] == pytest.approx([2.5, 4.5])
        assert found.stable.all() == (amplitude[0] < 5e-3), "at constant level a large motion has an unstable part"


def test_the_backbone_of_a_structure_ends_where_its_stop_is_touched():
    [found] = backbones(FOUR_DOF, "q2", (40.0, 60.0), (1e-6, 1e-3))
    assert found.end.startswith("the motion reaches the stop")
    assert found.frequency[0] < found.frequency[-1], "a hardening spring"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("mas", (2.5, 6.0), (0.1, 1.0)), "no body 'mas' \\(did you mean 'mass'"),
        (("mass", (6.0, 2.5), (0.1, 1.0)), "expected frequencies that rise from above 0, got 6 to 2.5 Hz"),
        (("mass", (2.5, 6.0), (0.0, 1.0)), "expected levels that rise from above 0"),
        (("mass", (5.0, 6.0), (0.1, 1.0)), "mass has no resonance from 5 to 6 Hz at 0.1 N"),
    ],
)
def test_a_backbone_that_makes_no_sense_is_refused(arguments, said):
    with pytest.raises(CalibError, match=said):
        backbones(DUFFING, *arguments)


def test_a_backbone_of_a_distorted_drive_is_refused():
    distorted = Setting(DUFFING.model.extended(DRIVE_HARMONIC_2), DUFFING.excitation, {**DUFFING.values, "h2_cos": 0.1})
    with pytest.raises(CalibError, match="the drive has harmonics"):
        backbones(distorted, "mass", (1e-2, 1.0), (2.5, 4.5))


def test_an_amplitude_that_is_none_is_refused():
    with pytest.raises(CalibError, match="expected amplitudes of mass above 0, got 0 m"):
        constant_responses(DUFFING, "mass", [0.0], (2.5, 4.5))


def test_a_resonance_that_touches_the_stop_is_said_to_and_not_said_to_be_none():
    with pytest.raises(
        CalibError, match=r"no resonance of q2 can be followed .* at 45\.\d+ Hz the motion reaches the stop"
    ):
        backbones(FOUR_DOF, "q2", (40.0, 60.0), (1e-4, 1e-3))
    with pytest.raises(CalibError, match="q2 cannot be held at 0.01 m from 40 Hz, .* reaches the stop"):
        constant_responses(FOUR_DOF, "q2", [1e-2], (40.0, 60.0))
