"""What a record holds, in sentences."""

import numpy as np
import pytest
from decays import linear, noisy
from decays import record as decay_record

from calib.records import make
from calib.records.response import make_response
from calib.report.record_description import record_description, record_warnings


def test_a_level_that_follows_the_frequency_is_told_by_its_range():
    level = np.array([0.5, 0.5, 0.3, 0.1])
    record = make_response(np.array([1.0, 1.1, 1.0, 1.1]), ["mass"], np.ones((1, 4)), level, "N", [0, 0, 1, 1])
    told = list(record_description(record.assign_attrs(place="mass", quantity="force")))
    assert any(line.startswith("sweep 0 up, level 0.5 N, 2 points") for line in told)
    assert any(line.startswith("sweep 1 up, level 0.1 N .. 0.3 N, 2 points") for line in told)


def test_a_response_that_does_not_state_its_excitation_is_said_not_to():
    record = make_response(np.array([1.0, 1.1]), ["mass"], np.ones((1, 2)), 0.5, "N")
    described = "frequency response of 2 points: swept by {}, 0.5 N, from 1 Hz to 1.1 Hz"
    assert next(record_description(record)) == described.format("an excitation that is not stated")
    stated = record.assign_attrs(place="mass", quantity="force")
    assert next(record_description(stated)) == described.format("force at the mass")


def test_harmonics_of_a_response_are_told_with_their_largest_amplitudes():
    second = np.array([[2e-6, 5e-6]])
    record = make_response(np.array([1.0, 1.1]), ["mass"], 1e-3 * np.ones((1, 2)), 0.5, "N", higher={2: second})
    first, sweep = record_description(record)
    assert first.startswith("frequency response of harmonics 1, 2 of 2 points: ")
    assert sweep.endswith("largest amplitude of mass 1 mm at 1 Hz; harmonic 2: 5 um at 1.1 Hz")


def driven(values, time, **channels):
    """Record of one mass driven at 10 Hz."""
    stated = {"frequency": 10.0, "place": "mass", "quantity": "force"}
    return make(time, ["mass"], {"displacement": values[None], "displacement_sigma": np.array([1e-3])}, **stated)


def loop(time):
    return np.cos(20.0 * np.pi * time) + 0.3 * np.cos(40.0 * np.pi * time + 0.5)


@pytest.mark.parametrize(("sigma", "said"), [(0.1, False), (3.0, True)])
def test_an_uncertainty_above_the_amplitude_is_said(sigma, said):
    time = np.arange(0.0, 3.0, 0.001)
    record = driven(5.0 + loop(time), time).assign(displacement_sigma=("body", [sigma], {"units": "m"}))
    told = [line for line in record_warnings(record) if "check the unit of sigma" in line]
    assert len(told) == said
    assert all("the displacement of mass has a stated standard uncertainty of 3 m, above its" in line for line in told)


def test_a_gap_in_time_is_said():
    time = np.arange(0.0, 3.0, 0.001)
    time = time[(time < 0.9995) | (time > 1.2495)]
    record = driven(noisy(loop(time), 0.002, 1), time)
    assert next(record_description(record)).startswith("2750 samples at intervals of 1 ms, 3 s in all")
    [line] = [line for line in record_warnings(record) if "missing" in line]
    assert line.startswith("samples are missing in 1 interval(s) of time, the longest of 251 ms from 999 ms on")


def test_instants_that_are_irregular_altogether_are_no_gaps():
    time = np.cumsum(np.random.default_rng(2).exponential(0.001, 3000))
    assert not [line for line in record_warnings(driven(loop(time), time)) if "missing" in line]


@pytest.mark.parametrize("decays", [True, False])
def test_samples_at_the_limit_of_a_converter_are_said(decays):
    time = np.arange(0.0, 3.0, 0.001)
    values = np.clip(noisy(linear(time, 20.0, 0.01) if decays else loop(time), 0.003, 3), -0.7, 0.7)
    record = decay_record(time, values) if decays else driven(values, time)
    [line] = [line for line in record_warnings(record) if "limit" in line]
    assert "runs equal the extreme value of -700 mm or 700 mm" in line


@pytest.mark.parametrize(("noise", "step"), [(0.0, 0.0), (0.001, 0.0), (0.001, 0.01), (0.0, 0.01), (0.01, 0.003)])
def test_a_body_that_rests_against_a_stop_is_not_said_to_be_clipped(noise, step):
    time = np.arange(0.0, 3.0, 0.001)
    values = noisy(np.minimum(loop(time), 0.5), noise, 4)
    record = driven(step * np.round(values / step) if step else values, time)
    assert not [line for line in record_warnings(record) if "limit" in line]


def test_a_decay_that_is_released_late_is_said_with_the_rows_to_leave_out():
    time = np.arange(0.0, 3.0, 0.001)
    values = np.where(time < 0.5, 1.0, linear(np.maximum(time - 0.5, 0.0), 20.0, 0.01))
    [line] = [line for line in record_warnings(decay_record(time, noisy(values, 0.003, 5))) if "at rest" in line]
    assert line.startswith("mass is at rest until 50")
    assert "with `first` of [record.table]" in line
    assert not [line for line in record_warnings(decay_record(time, linear(time, 20.0, 0.01))) if "at rest" in line]


def test_a_decay_whose_release_disturbs_it_is_said_with_the_rows_to_leave_out():
    time = np.arange(0.0, 2.0, 1.0 / 2048.0)
    jerk = 0.1 * np.sin(2.0 * np.pi * 83.0 * time) * np.maximum(1.0 - time / 0.02, 0.0)
    values = noisy(linear(time, 30.0, 0.003) + jerk, 0.002, 6)
    [line] = [line for line in record_warnings(decay_record(time, values)) if "freely" in line]
    assert line.startswith("mass does not move freely until ")
    first = int(line.split("`first = ")[1].split("`")[0])
    assert 0.01 < time[first] < 0.04
    assert not [line for line in record_warnings(decay_record(time[first:], values[first:])) if "freely" in line]
