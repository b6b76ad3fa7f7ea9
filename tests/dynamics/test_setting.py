"""What can vary, in which unit and within which bounds."""

import inspect
import json
import math
from functools import cached_property

import numpy as np
import pytest
from tiny_simulators import DRIVE, Mapped

from calib.dynamics.setting import Setting
from calib.errors import CalibError
from calib.modelling.model import Model
from calib.records.excitation import Excitation
from calib.simulators.delaminated_beam import DelaminatedBeam


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


BEAM_OPTIONS = {
    "masters": 28, "slaves": 2, "outer": 20, "beam_rows": [5.0, 5.0], "layer_rows": [2.0, 1.0], "refinement": 2,
    "gap_table": [[0.0, 1e-3], [1.0, 0.0]], "modes": 30, "steps": 256, "parts": 8, "every": 4, "tolerance": 0.01,
    "settle_limit": 100, "contact_stiffness": "mass_dt", "damper": "lagged", "clipped": False, "symmetric": False,
    "layer": "arched", "shift": "tied", "balance": True, "fidelity": "full",
}  # fmt: skip
EXCITATION = Excitation("centre", "displacement", frequency=26.51, amplitude=1e-3)


def beam_definition(**options):
    """Definition of a beam's setting, as a file holds it."""
    return json.loads(json.dumps(setting(DelaminatedBeam(**options), EXCITATION).definition(), allow_nan=False))


def test_every_option_of_the_beam_is_part_of_the_definition():
    assert BEAM_OPTIONS.keys() == inspect.signature(DelaminatedBeam).parameters.keys()
    default = beam_definition()
    assert default == beam_definition()
    for name, value in BEAM_OPTIONS.items():
        beside = {"fidelity": "full"} if name in ("balance", "damper") else {}  # which they do not go without
        assert beam_definition(**{**beside, name: value}) != beam_definition(**beside), name
    table = BEAM_OPTIONS["gap_table"]
    assert beam_definition(gap_table=table) != beam_definition(gap_table=[table[0], [1.0, 1e-4]])


def test_what_a_simulator_makes_of_its_options_is_no_part_of_the_definition():
    simulator = Mapped()
    before = setting(simulator).definition()
    simulator.compiled, simulator.kinds = object(), {"a", "b"}
    assert setting(simulator).definition() == before


class Tabulated(Mapped):
    """Its table is computed when it is first asked for."""

    @cached_property
    def table(self):
        return np.arange(3.0)


def test_what_a_simulator_caches_is_no_part_of_the_definition():
    simulator = Tabulated()
    before = setting(simulator).definition()
    assert simulator.table.size == 3
    assert setting(simulator).definition() == before
