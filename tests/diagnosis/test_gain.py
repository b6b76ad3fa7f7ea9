"""What causes bring on records held out."""

from dataclasses import replace

import numpy as np
import pytest

from calib.diagnosis.bench import SimulatedRows
from calib.diagnosis.gain import BLOCKS, NOT_COMPARED, RECORDS, Gain, _sizes, _summed, interval_of_gain
from calib.diagnosis.noise import STATED, Noise
from calib.diagnosis.part import Part
from calib.diagnosis.transfer import Transfer
from calib.objective import Squares, misfit


def test_a_record_in_which_no_cause_acts_refutes_none():
    rises = {"before": 0.1, "after": 0.2, "interval": (-0.12, -0.08)}
    assert Gain(RECORDS, ("a", "b"), **rises).refutes
    assert Gain(RECORDS, ("a", "b"), **rises, unaffected=("a",)).refutes
    assert not Gain(RECORDS, ("a", "b"), **rises, unaffected=("a", "b")).refutes


@pytest.mark.parametrize(
    ("after", "interval", "several", "alone"),
    [(0.2, (-0.12, -0.08), True, True), (0.11, (-0.03, 0.01), False, True), (0.09, (-0.01, 0.03), False, False)],
)
def test_causes_of_a_single_record_over_time_are_refuted_by_any_rise_of_the_misfit_held_out(
    after, interval, several, alone
):
    gain = Gain(RECORDS, ("a",), 0.1, after, interval)
    assert gain.refutes == several
    assert replace(gain, of_one_time_record=True).refutes == alone
    assert not replace(gain, of_one_time_record=True, kind=BLOCKS).refutes


def test_a_rise_that_a_model_error_makes_by_chance_refutes_several_records_not():
    gain = Gain(RECORDS, ("a",), 0.1, 0.11, (-0.012, -0.008))
    assert replace(gain, cosine=-0.7).refutes
    assert replace(gain, cosine=-np.inf).refutes
    assert not replace(gain, cosine=-0.5).refutes
    assert replace(gain, cosine=-0.5, of_one_time_record=True).refutes


@pytest.mark.parametrize(("loud", "held", "agree"), [(1.0, 1.2, True), (1.2, 1.0, False)])
def test_records_of_the_fit_are_compared_without_those_held_out(loud, held, agree):
    sizes = {"soft": (1.0, False), "loud": (loud, False), "louder": (held, True)}
    told = _sizes(tuple(Transfer(name, "k", size, 0.01, out) for name, (size, out) in sizes.items()), 3.0)
    assert told["fitted_agree"] == agree
    assert not told["agreements"][0].agree


@pytest.mark.parametrize("segments", [2, 3, 20])
def test_two_models_that_are_alike_have_a_gain_of_zero_however_few_segments_are_held_out(segments):
    rng = np.random.default_rng(segments)

    def one():
        return Squares(rng.chisquare(16, size=(1, segments)), np.full((1, segments), 16.0))

    intervals = np.array([interval_of_gain([(one(), one())], seed) for seed in range(200)])
    missed = ((intervals[:, 0] > 0.0) | (intervals[:, 1] < 0.0)).sum()
    assert missed <= 22  # 5 % of 200, and 3.9 standard deviations of such a count


def test_no_misfit_falls_by_more_than_it_is():
    total = np.array([[100.0, 1.0, 1.0, 1.0, 1.0, 1.0]])  # a resonance holds nearly all of it
    before, after = (Squares(scale * total, np.full(total.shape, 8.0)) for scale in (1.0, 0.01))
    low, high = interval_of_gain([(before, after)], 0)
    assert low < misfit([before]) - misfit([after]) < high == misfit([before])


def test_a_single_segment_tells_nothing_of_the_error_of_a_gain():
    before, after = (Squares(np.array([[total]]), np.array([[8.0]])) for total in (8.0, 0.1))
    assert interval_of_gain([(before, after)], 0) == (-np.inf, np.inf)


def test_a_record_of_which_no_sample_counts_is_left_out_and_said():
    time = np.arange(200) * 1e-2
    rows, noise, wave = (("mass", "displacement"),), (Noise(1e-3, np.zeros(0), STATED),), np.sin(time)[None]
    parts = [
        Part(name, rows, time, wave, None, 1, (), noise, used, used.astype(float))
        for name, used in (("seen", np.ones((1, 200), dtype=bool)), ("lost", np.zeros((1, 200), dtype=bool)))
    ]
    before, after = (SimulatedRows(factor * wave, np.ones(200)) for factor in (1.1, 1.01))
    gain = _summed(RECORDS, [(part, before, after) for part in parts], 0, failed={"broken": "it fails"})
    assert gain.records == ("seen",)
    assert dict(gain.failed) == {"broken": "it fails", "lost": NOT_COMPARED}
    assert gain.before == pytest.approx(10.0 * gain.after)
    assert 0.0 < gain.interval[0] < gain.before - gain.after < gain.interval[1]
    assert not _summed(RECORDS, [(parts[1], before, after)], 0).records
