"""Stepped sines that could be measured: which sweeps they make, and what the laboratory may state of them."""

import numpy as np
import pytest

from calib.diagnosis.laboratory import (
    STEPPED_SINE,
    DesignPoint,
    Laboratory,
    base_record,
    inapplicable,
    mistakes_of,
    regions,
)
from calib.diagnosis.part import Part
from calib.diagnosis.stepped_design import as_read, unread_sweeps
from calib.modelling.model import Model
from calib.objective import Reference
from calib.plugins import load
from calib.records import make
from calib.records.excitation import Excitation
from calib.records.response import UNKNOWN_PHASE, complex_amplitude, make_response

MODEL = Model(load("calib.simulators", "oscillator")())
FORCE = Excitation("mass", "force", frequency=5.0, amplitude=1.0)
SIGMA = 2e-4  # m


def response(levels=(0.2, 0.5), directions=(1.0, -1.0), **attrs):
    """Sweeps up and down of eleven points at each level, of 10 mm rms for 1 N."""
    up = np.linspace(4.0, 6.0, 11)
    ways = [(level, way) for level in levels for way in directions]
    frequency = np.concatenate([up[:: int(way)] for _, way in ways])
    level, direction = np.repeat(ways, 11, axis=0).T
    amplitude = 0.01 * level * np.exp(-1j * frequency)
    return make_response(
        frequency, ["mass"], amplitude[None], level, "N", np.repeat(np.arange(len(ways)), 11), direction,
        sigma=np.full((1, level.size), SIGMA), place="mass", quantity="force", **attrs,
    )  # fmt: skip


def reference(record, name="sweeps"):
    return Reference(name, record, excitation=FORCE)


def part_of(own):
    zero = np.zeros((1, 2))
    return Part(own.name, (("mass", "in_phase"),), zero[0], zero, None, 1, (), (), zero > 0.0, zero, sweep=zero[0])


def test_sweeps_of_a_level_go_as_the_measured_ones_do():
    unread = unread_sweeps(DesignPoint(STEPPED_SINE, 0.8, 4.5, 5.5), response())
    assert unread.sizes["point"] == 22
    assert np.unique(unread.level.values) == pytest.approx([0.8])
    assert unread.frequency.values[[0, 10, 11, 21]] == pytest.approx([4.5, 5.5, 5.5, 4.5])
    assert unread.direction.values[[0, 21]].tolist() == [1.0, -1.0]
    assert np.unique(unread.sweep.values).tolist() == [0.0, 1.0]


def test_what_is_read_is_uncertain_in_proportion_to_the_motion():
    measured = response()
    unread = unread_sweeps(DesignPoint(STEPPED_SINE, 0.8, 4.0, 6.0), measured)
    amplitude = 0.03 * np.exp(1j * unread.frequency.values)[None]
    read = as_read(unread, amplitude, measured)
    assert complex_amplitude(read) == pytest.approx(amplitude)
    rms = 0.01 * np.sqrt((0.2**2 + 0.5**2) / 2.0)
    assert read.response_sigma.values == pytest.approx(SIGMA * 0.03 / rms)
    alone = as_read(unread, amplitude, response(phases=UNKNOWN_PHASE))
    assert alone.in_phase.values == pytest.approx(0.03)
    assert not alone.quadrature.values.any()


def test_the_level_is_searched_about_those_of_the_records_unless_it_is_stated():
    own = reference(response())
    found = regions(Laboratory(), {"sweeps": own}, MODEL, part_of(own))
    [level] = found[STEPPED_SINE].variables
    assert list(found) == [STEPPED_SINE]
    assert (level.low, level.high, level.unit, level.stated) == (pytest.approx(0.02), pytest.approx(0.75), "N", False)
    assert found[STEPPED_SINE].fixed.frequency == 4.0
    stated = Laboratory(amplitude=(0.1, 2.0), frequency=(3.0, 8.0))
    region = regions(stated, {"sweeps": own}, MODEL, part_of(own))[STEPPED_SINE]
    assert (region.variables[0].low, region.variables[0].high) == (0.1, 2.0)
    assert (region.fixed.frequency, region.fixed.end_frequency) == (3.0, 8.0)


def test_beside_a_record_over_time_tones_are_searched_and_beside_sweeps_alone_sweeps():
    tone = make(np.arange(40) / 100.0, ("mass",), {"displacement": np.zeros((1, 40))})
    both = {"sweeps": reference(response()), "tone": reference(tone, "tone")}
    assert base_record(both) == "tone"
    assert inapplicable(STEPPED_SINE, both["tone"], MODEL)
    assert not inapplicable(STEPPED_SINE, both["sweeps"], MODEL)
    assert "every record is a frequency response" in inapplicable("steady tone", both["sweeps"], MODEL)


def test_what_a_study_states_for_records_over_time_is_a_mistake_beside_sweeps():
    own = {"sweeps": reference(response())}
    right = Laboratory(frequency=(3.0, 8.0), amplitude=(0.1, 2.0), tests=(STEPPED_SINE,))
    assert not list(mistakes_of(right, own, MODEL))
    wrong = Laboratory(release=(1e-3, 2e-3), channels=(("mass", "velocity"),), tests=("free decay",))
    told = dict(mistakes_of(wrong, own, MODEL))
    assert told.keys() == {"release", "channels", "tests"}
    assert "only the level of a stepped sine is searched" in told["release"]
