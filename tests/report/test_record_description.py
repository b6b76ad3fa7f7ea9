"""What a record holds, in sentences."""

import numpy as np

from calib.records.response import make_response
from calib.report.record_description import record_description


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
