"""What no candidate explains, and the noise that is judged by it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from calib.diagnosis.evidence import Evidence
from calib.diagnosis.noise import RESIDUAL, STATED, Noise, Remainder
from calib.diagnosis.part import Part
from calib.diagnosis.remainder import remainder

SIZE = 4000
TIME = np.arange(SIZE) * 1e-3
ROWS = (("mass", "displacement"), ("mass", "velocity"))
MISSING = np.sin(2.0 * np.pi * 1.3 * TIME)  # what the model lacks


def evidence(noise, measured):
    ones = np.ones((2, SIZE))
    return Evidence((Part("record", ROWS, TIME, measured, None, 1, (), noise, ones > 0.0, ones),))


def left(noise, measured, derivatives):
    """What is left of a model that has a calibrated size of a constant, and predicts nothing."""
    whole = evidence(noise, measured)
    constant = whole.parts[0].white(np.ones((2, SIZE)))[:, None]
    residual = whole.parts[0].white(measured)
    fit = SimpleNamespace(columns=constant, nuisances=np.zeros((2 * SIZE, 0)), residual=residual)
    return remainder(whole, fit, [whole.parts[0].white(own)[:, None] for own in derivatives])["record"].rows


def drawn(seed, ar=(), sigma=(2.0, 30.0)):
    rng = np.random.default_rng(seed)
    return np.array([Noise(level, np.array(ar), "").drawn(rng, SIZE) for level in sigma])


def as_left(rows):
    return {"record": Remainder(rows, rows, np.zeros((2, 1, 1)), np.zeros(rows.shape))}


WHITE = (Noise(2.0, np.zeros(0), STATED), Noise(30.0, np.zeros(0), STATED))


def test_what_a_candidate_explains_is_taken_out_in_the_units_of_the_rows():
    noise = drawn(1)
    found = left(WHITE, noise + 7.0 + 5.0 * MISSING, [np.array([MISSING, MISSING])])
    np.testing.assert_allclose(found.std(axis=1), [2.0, 30.0], rtol=0.05)
    assert abs(found[0] @ MISSING) / SIZE < 0.05
    assert np.corrcoef(found[0], noise[0])[0, 1] > 0.999


def test_what_a_clock_makes_is_no_noise_however_far_candidates_that_are_like_it_are_moved():
    """A clock's rate costs them little: it is as uncertain as clocks are, which is much beside the noise."""
    noise, change = drawn(1), 1e7 * np.array([TIME * MISSING, TIME * MISSING])
    whole = evidence(WHITE, noise + 60e-6 * change)
    whole = Evidence((replace(whole.parts[0], clock=change),))
    like = 1e-6 * change + 0.3 * np.array([np.cos(7.0 * TIME), 0.0 * TIME])
    columns = np.column_stack([whole.parts[0].white(row) for row in (like, np.ones((2, SIZE)))])
    residual = whole.parts[0].white(whole.parts[0].measured)
    fit = SimpleNamespace(columns=columns[:, 1:], nuisances=np.zeros((2 * SIZE, 0)), residual=residual)
    found = remainder(whole, fit, [columns[:, :1]])["record"].rows
    np.testing.assert_allclose(found.std(axis=1), [2.0, 30.0], rtol=0.05)


def swept(size):
    """Three sweeps of 400 points each of a channel, whose model has one parameter of this size in each sweep."""
    n, sweep = 1200, np.repeat([0.0, 1.0, 2.0], 400)
    shape, ones = np.cos(np.pi * np.tile(np.arange(400), 3) / 100.0), np.ones((1, n))
    noise = np.random.default_rng(5).standard_normal(n)
    measured = noise + np.asarray(size)[sweep.astype(int)] * shape
    unknown = (Noise(1.0, np.zeros(0), RESIDUAL),)
    part = Part("r", ROWS[:1], np.arange(n), 30.0 + measured[None], None, 1, (), unknown, ones > 0.0, ones, sweep=sweep)
    column = shape[:, None]
    residual = measured - shape * (shape @ measured) / (shape @ shape)
    fit = SimpleNamespace(columns=column, nuisances=np.zeros((n, 0)), residual=residual)
    return Evidence((part,)).with_reestimated_noise(remainder(Evidence((part,)), fit, [])).parts[0].noise[0]


def test_a_parameter_that_differs_from_sweep_to_sweep_is_no_noise_with_a_memory():
    for size in ((0.0, 0.0, 0.0), (-5.0, 0.0, 5.0)):
        noise = swept(size)
        assert noise.ar.size == 0
        assert noise.sigma == pytest.approx(1.0, rel=0.05)


def test_what_changes_one_sweep_alone_is_whitened_as_such():
    noise, ones = (Noise(2.0, np.array([0.5]), RESIDUAL),), np.ones((1, 9))
    rows, sweep = np.arange(1.0, 10.0)[None], np.array([0.0] * 4 + [1.0] * 4 + [2.0])
    part = Part("r", ROWS[:1], np.arange(9.0), rows, None, 1, (), noise, ones > 0.0, ones, sweep=sweep)
    both = part.by_sweep(part.white(rows)[:, None])  # a sweep of one point would be fitted whatever it is
    np.testing.assert_allclose(part.restored(both)[0], (rows[0] * (sweep == [[0.0], [1.0]])).T, atol=1e-12)
    assert part.by_sweep(np.ones((9, 2))).shape == (9, 0)


def test_without_the_candidate_it_is_left():
    found = left(WHITE, drawn(1) + 5.0 * MISSING, [])
    assert found[0] @ MISSING / (MISSING @ MISSING) == pytest.approx(5.0, rel=0.05)


def test_the_level_and_the_memory_of_noise_are_those_of_what_is_left():
    known = (Noise(9.0, np.zeros(0), RESIDUAL), Noise(30.0, np.zeros(0), STATED))
    again = evidence(known, np.zeros((2, SIZE))).with_reestimated_noise(as_left(drawn(2, ar=(0.7,))))
    first, second = again.parts[0].noise
    assert (first.sigma, second.sigma) == (pytest.approx(2.0, rel=0.1), pytest.approx(30.0, rel=0.05))
    assert (first.ar.sum(), second.ar.sum()) == pytest.approx((0.7, 0.7), abs=0.06)


def test_noise_of_cycles_that_repeat_stays_as_it_is():
    known = (Noise(9.0, np.array([0.3]), STATED, repeated=True), Noise(3.0, np.zeros(0), RESIDUAL, repeated=True))
    again = evidence(known, np.zeros((2, SIZE))).with_reestimated_noise(as_left(drawn(2)))
    assert again.parts[0].noise == known


def estimated(measured, columns):
    """Noise of a row (n,) that is judged by what a fit of these columns (n, k) leaves of it."""
    n, ones = measured.size, np.ones((1, measured.size))
    unknown = (Noise(1.0, np.zeros(0), RESIDUAL),)
    part = Part("record", ROWS[:1], np.arange(n) / n, measured[None], None, 1, (), unknown, ones > 0.0, ones)
    fit = SimpleNamespace(columns=columns, nuisances=np.zeros((n, 0)), residual=measured)
    whole = Evidence((part,))
    return whole.with_reestimated_noise(remainder(whole, fit, [])).parts[0].noise[0]


def slow(n, count):
    """Cosines (n, count) of the lowest frequencies."""
    return np.cos(np.pi * np.outer(np.arange(n) / n, np.arange(count)))


@pytest.mark.parametrize("size", [55, 120, 200])
@pytest.mark.parametrize("share", [0.1, 0.4])
def test_a_fit_of_many_parameters_gives_white_noise_no_memory(size, share):
    """As of a ball's fall of 55 samples, beside 20 candidates: slow columns leave a residual that is correlated."""
    columns = slow(size, int(share * size))
    found = [estimated(np.random.default_rng(seed).standard_normal(size), columns) for seed in range(60)]
    assert np.mean([noise.ar.size > 0 for noise in found]) <= 0.15
    assert np.mean([noise.sigma * noise.innovation for noise in found]) == pytest.approx(1.0, abs=0.08)


def test_memory_is_told_beside_a_fit_that_takes_part_of_it():
    """3 % of the frequencies, where an eighth of the variance is: 0.54 is the autocorrelation of what is left."""
    drawn = Noise(2.0, np.array([0.6]), "").drawn(np.random.default_rng(3), 2000)
    noise = estimated(drawn, slow(2000, 60))
    assert noise.autocorrelation(2)[1] == pytest.approx(drawn[1:] @ drawn[:-1] / (drawn @ drawn), abs=0.01)
    assert noise.sigma * noise.innovation == pytest.approx(2.0 * 0.8, rel=0.03)
