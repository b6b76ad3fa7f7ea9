"""Records in units of their noise."""

from dataclasses import replace

import numpy as np
import pytest

from calib.diagnosis.bench import SimulatedRows
from calib.diagnosis.clock import CLOCK_RATE_STD
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.noise import STATED, Noise
from calib.diagnosis.part import Part

SIZE = 300
ROWS = (("upper", "displacement"), ("upper", "velocity"))
RNG = np.random.default_rng(3)


def part(name, *memories):
    noise = tuple(Noise(0.1 * (k + 1), np.array(ar), STATED) for k, ar in enumerate(memories))
    weight = np.ones((2, SIZE))
    weight[1, 40:50], weight[1, 50:53] = 0.0, (0.2, 0.6, 0.9)  # next to an impact
    measured = RNG.standard_normal((2, SIZE))
    return Part(name, ROWS, 1e-3 * np.arange(SIZE), measured, None, 1, (), noise, weight > 0.0, weight)


def seen():
    return {name: SimulatedRows(RNG.standard_normal((2, SIZE)), np.ones(SIZE)) for name in ("quiet", "loud")}


def test_columns_are_carried_to_noise_that_was_judged_anew():
    white = Evidence((part("quiet", [], []), part("loud", [], [])))
    parts = [
        replace(one, noise=tuple(replace(n, sigma=0.7 * n.sigma, ar=np.array([0.8, -0.2])) for n in one.noise))
        for one in white.parts
    ]
    anew = Evidence(tuple(parts))
    one, other, third = seen(), seen(), seen()
    columns = np.column_stack([white.difference(one, other), white.difference(one, third)])
    expected = np.column_stack([anew.difference(one, other), anew.difference(one, third)])
    assert anew.carried(columns, white) == pytest.approx(expected, abs=1e-9)


def test_residuals_know_the_row_that_they_are_of():
    long, short = part("long", [], []), part("short", [], [])
    one = {name: getattr(short, name)[:1, :100] for name in ("measured", "used", "weight")}
    short = replace(short, rows=ROWS[:1], time=short.time[:100], noise=short.noise[:1], **one)
    rows = Evidence((long, short)).rows()
    assert rows[Evidence((long, short)).of("short")] == pytest.approx(np.full(100, 2))
    assert np.bincount(rows).tolist() == [SIZE, SIZE, 100]
    assert (np.diff(rows) >= 0).all()


def clocked():
    """A part without weights whose clock's rate is uncertain, and the change of its rows with that  [per unit rate]."""
    plain = part("free", [0.6], [])
    ones = np.ones((2, SIZE))
    change = 2e4 * np.cos(0.05 * np.arange(2 * SIZE)).reshape(2, SIZE)
    return replace(plain, weight=ones, used=ones > 0.0, clock=change)


def test_what_a_clock_off_by_its_uncertainty_changes_is_white_beside_the_noise():
    own = clocked()
    rng = np.random.default_rng(11)
    rates = CLOCK_RATE_STD * rng.standard_normal(400)
    rows = [np.array([n.drawn(rng, SIZE) for n in own.noise]) + rate * own.clock for rate in rates]
    white = np.array([own.white(row) for row in rows])
    direction = own.white(own.clock)
    along = white @ (direction / np.linalg.norm(direction))
    assert np.linalg.norm(direction) > 0.5 / CLOCK_RATE_STD  # as it shows beside the noise
    assert along.var() == pytest.approx(1.0, abs=0.25)
    assert white.var() == pytest.approx(1.0, abs=0.01)


def test_whitened_columns_are_restored():
    own = clocked()
    rows = RNG.standard_normal((2, SIZE))
    assert own.restored(own.white(rows)[:, None])[:, :, 0] == pytest.approx(rows, abs=1e-9)


def test_a_rate_far_beyond_what_clocks_have_is_still_seen():
    own = clocked()
    assert np.linalg.norm(own.white(100.0 * CLOCK_RATE_STD * own.clock)) > 50.0


def test_what_changes_one_row_alone_is_whitened_as_such():
    own = clocked()
    whole = Evidence((part("quiet", [], []), own))
    rows = RNG.standard_normal((2, SIZE))
    columns = np.concatenate([np.zeros(2 * SIZE), own.white(rows)])[:, None]
    alone = whole.of_row(columns, 3)
    assert alone[2 * SIZE :, 0] == pytest.approx(own.white(rows * np.array([[0.0], [1.0]])), abs=1e-9)
    assert not whole.of_row(columns, 0).any()
    assert whole.of_row(columns, 2) + alone == pytest.approx(columns, abs=1e-9)


def test_of_a_row_that_the_excitation_prescribes_no_noise_counts():
    both = part("one", 0.0, 0.5)
    used = np.array([[False], [True]]) & np.ones_like(both.used, dtype=bool)
    assert replace(both, used=used).compared_noise == both.noise[1:]
