"""Phases whose unit is stated wrongly are told from those that are large or small for other reasons."""

import warnings

import numpy as np
import pytest

from calib.records.phase_unit import doubtful_phase_unit
from calib.records.response_table import read_response

FREQUENCY = np.linspace(8.0, 12.0, 41)


def response(resonances=(10.0,), delay=0.0):
    """Receptance (point,) of modes of 1 % damping, the phase turned by a delay [s]."""
    modes = [1.0 / (one**2 - FREQUENCY**2 + 0.02j * one * FREQUENCY) for one in resonances]
    return np.sum(modes, axis=0) * np.exp(-2j * np.pi * FREQUENCY * delay)


def doubt(phase, unit, complex_response):
    size = np.abs(complex_response)
    factor = 1.0 if unit == "rad" else np.pi / 180.0
    return doubtful_phase_unit(factor * phase, factor, size, [np.arange(size.size)])


@pytest.mark.parametrize("unwrapped", [True, False])
@pytest.mark.parametrize("resonances", [(10.0,), (9.0, 10.0, 11.0)])
@pytest.mark.parametrize("delay", [0.0, 1.0])
def test_phases_in_the_unit_stated_are_not_doubted(unwrapped, resonances, delay):
    own = response(resonances, delay)
    phase = np.unwrap(np.angle(own)) if unwrapped else np.angle(own)
    assert doubt(phase, "rad", own) is None
    assert doubt(np.degrees(phase), "deg", own) is None


def test_degrees_that_are_stated_as_radians_are_doubted():
    own = response()
    said = doubt(np.degrees(np.angle(own)), "rad", own)
    assert said.startswith("the phases reach 17")
    assert said.endswith("if they are degrees, state the unit deg")


def test_radians_that_are_stated_as_degrees_are_doubted_over_a_resonance_alone():
    own = response()
    said = doubt(np.angle(own), "deg", own)
    assert said.startswith("no phase exceeds 3.")
    assert said.endswith("if they are radians, state the unit rad")
    below = response((20.0,))
    assert doubt(np.angle(below), "deg", below) is None


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_a_table_whose_phases_are_degrees_is_doubted_where_it_says_rad(tmp_path, unit):
    own = response()
    rows = [f"{f}, 1, {a}, {p}" for f, a, p in zip(FREQUENCY, np.abs(own), np.angle(own, deg=True), strict=True)]
    header = f"frequency [Hz], level [N], mass amplitude [mm], mass phase [{unit}]"
    path = tmp_path / "levels.csv"
    path.write_text("\n".join([header, *rows]))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        read_response(path)
    told = [str(one.message) for one in caught]
    assert len(told) == (unit == "rad")
    assert all(one.startswith("levels.csv: phase of mass: the phases reach") for one in told)
