"""The misfit: one definition for calibration and diagnosis."""

import numpy as np
import pytest

from calib.objective import Reference, Squares, Term, compared_rows, misfit, record_misfit
from calib.plugins import load
from calib.records import make
from calib.records.excitation import Excitation

TIME = np.linspace(0.0, 1.0, 101)
WAVE = np.sin(2.0 * np.pi * 3.0 * TIME)


def record(scale=1.0, **attrs):
    """Two bodies; the second moves a thousand times less."""
    rows = np.array([WAVE, 1e-3 * WAVE]) * scale
    return make(TIME, ["big", "small"], {"displacement": rows, "velocity": 20.0 * rows}, **attrs)


def squares(measured, simulated, weight=None, segments=None):
    weight = np.ones(measured.shape) if weight is None else weight
    return Squares.of(
        measured, simulated, weight, np.zeros(measured.shape[1], dtype=int) if segments is None else segments
    )


def reference(**attrs):
    drive = Excitation("big", "force", time=TIME, value=WAVE)
    return Reference("one", record(**attrs), "holdout", excitation=drive)


def trusted(simulated):
    return simulated.assign(trust=("time", np.ones(TIME.size)))


def test_a_curve_ten_per_cent_too_large_is_at_a_tenth_whatever_its_unit():
    rows = np.array([WAVE, 1e-6 * WAVE])
    assert misfit([squares(rows, 1.1 * rows)]) == pytest.approx(0.1 * np.sqrt((WAVE**2).mean()) / WAVE.std())


def test_channels_and_records_are_means_of_squares():
    rows = np.array([WAVE - WAVE.mean(), WAVE - WAVE.mean()])
    one, other = squares(rows, rows * [[1.3], [1.4]]), squares(rows, rows)
    assert misfit([one]) == pytest.approx(np.sqrt((0.3**2 + 0.4**2) / 2.0))
    assert misfit([one, other]) == pytest.approx(np.sqrt((0.3**2 + 0.4**2) / 4.0))


def test_samples_count_alike_however_they_are_cut_into_segments():
    rng = np.random.default_rng(0)
    measured, simulated = rng.standard_normal((2, 3, 90))
    weight, uneven = rng.random((3, 90)), np.minimum(np.arange(90) // 7, 5)
    assert misfit([squares(measured, simulated, weight, uneven)]) == pytest.approx(
        misfit([squares(measured, simulated, weight)])
    )


def test_segments_drawn_with_replacement_count_as_often_as_they_are_drawn():
    rng = np.random.default_rng(0)
    measured, simulated = rng.standard_normal((2, 3, 90))
    weight, segments = np.ones((3, 90)), np.minimum(np.arange(90) // 20, 3)
    weight[2, segments != 1] = 0.0  # a channel that counts in one segment alone
    own = squares(measured, simulated, weight, segments)
    drawn = rng.integers(4, size=(20, 4))
    times = np.array([np.bincount(one, minlength=4) for one in drawn])
    assert own.resampled(times) == pytest.approx([own.drawn(one).mean for one in drawn])


def test_samples_without_weight_do_not_count():
    measured, weight = np.array([WAVE]), np.ones((1, TIME.size))
    simulated = measured.copy()
    simulated[0, 10:20], weight[0, 10:20] = 1e3, 0.0
    assert misfit([squares(measured, simulated, weight)]) == 0.0


def test_what_no_term_may_compare_and_what_is_prescribed_has_no_part():
    term = Term(load("calib.features", "time_history")(), bodies=("small",))
    known = reference(prescribed="small.velocity")
    assert compared_rows(known, [term]) == [("small", "displacement")]
    simulated = record()
    simulated["displacement"][0] *= 5.0
    assert record_misfit(known, [term], simulated, trusted(simulated)) == 0.0
    given = record(prescribed="small.displacement")
    assert np.isnan(record_misfit(known, [term], given, trusted(given)))


def test_velocity_counts_as_far_as_it_is_to_be_trusted():
    term, simulated = Term(load("calib.features", "time_history")()), record()
    simulated["velocity"][:, 40:50] += 1e3
    trust = np.ones(TIME.size)
    trust[40:50] = 0.0
    assert record_misfit(reference(), [term], simulated, simulated.assign(trust=("time", trust))) == 0.0
    assert record_misfit(reference(), [term], simulated, trusted(simulated)) > 1.0
