"""What can vary, in which unit and within which bounds."""

import math

import pytest
from tiny_simulators import DRIVE, Mapped

from calib.dynamics.setting import Setting
from calib.errors import CalibError
from calib.modelling.model import Model


def setting(simulator=None, excitation=DRIVE, **more):
    return Setting(Model(simulator or Mapped()), excitation, **more)


def slope(map):
    """Parameter a of Henon's map, from one step of it."""
    return 1.0 - map.orbit([1.0, 0.0], 1).states[0, 0]


def test_nominal_values_stand_in_for_those_that_are_not_held_or_varied():
    assert slope(setting().map()) == pytest.approx(0.2)
    assert slope(setting(values={"a": 0.5}).map()) == pytest.approx(0.5)
    assert slope(setting(values={"a": 0.5}).map({"a": 0.7})) == pytest.approx(0.7)


def test_frequency_and_amplitude_of_the_excitation_reach_the_map():
    assert slope(setting().map({"excitation.frequency": 25.0})) == pytest.approx(0.5)
    assert slope(setting().map({"excitation.amplitude": 3e-3})) == pytest.approx(0.6)
    assert DRIVE.frequency == 10.0


def test_what_varies_has_a_unit_and_a_meaning():
    held = setting()
    units = {name: held.unit(name) for name in ("a", "push", "excitation.frequency", "excitation.amplitude")}
    assert units == {"a": "1", "push": "N", "excitation.frequency": "Hz", "excitation.amplitude": "m"}
    assert held.meaning("push") == "load of the bistable map"
    assert held.meaning("excitation.amplitude") == "amplitude of the excitation (base motion)"


def test_an_unknown_name_is_answered_with_the_nearest():
    with pytest.raises(CalibError, match=r"'excitation.frequenzy' cannot vary \(did you mean 'excitation.frequency'"):
        setting().unit("excitation.frequenzy")


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("b", 1.5, r"\[-1, 1\] 1, got 1.5"),
        ("a", math.inf, r"finite values of 'a' in \[-inf, inf\] 1, got inf"),
        ("a", math.nan, "got nan"),
        ("excitation.frequency", 0.0, "above 0 Hz, got 0"),
        ("excitation.amplitude", -1e-3, "above 0 m, got -0.001"),
        ("excitation.amplitude", math.inf, "got inf"),
    ],
)
def test_a_value_without_sense_is_refused(name, value, said):
    held = setting()
    held.check(name, [0.5])
    with pytest.raises(CalibError, match=said):
        held.check(name, [0.5, value])


@pytest.mark.parametrize("phase", [-0.1, 1.0, math.nan])
def test_a_phase_outside_the_period_is_refused(phase):
    with pytest.raises(CalibError, match=r"in \[0, 1\)"):
        setting(phase=phase).map()


@pytest.mark.parametrize(
    "other",
    [
        setting(Mapped("bistable")),
        setting(values={"a": 0.21}),
        setting(excitation=DRIVE.scaled(2.0)),
        setting(phase=0.5),
    ],
)
def test_the_definition_tells_settings_apart(other):
    assert setting().definition() == setting(values={"a": 0.2}).definition()
    assert setting().definition() != other.definition()
