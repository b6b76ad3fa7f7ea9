"""Records in units of their noise."""

from dataclasses import replace

import numpy as np
import pytest

from calib.diagnosis.bench import Seen
from calib.diagnosis.evidence import Evidence, Part
from calib.diagnosis.noise import STATED, Noise

SIZE = 300
ROWS = (("upper", "displacement"), ("upper", "velocity"))
RNG = np.random.default_rng(3)


def part(name, *memories):
    noise = tuple(Noise(0.1 * (k + 1), np.array(memory), STATED) for k, memory in enumerate(memories))
    weight = np.ones((2, SIZE))
    weight[1, 40:50] = 0.0  # next to an impact
    measured = RNG.standard_normal((2, SIZE))
    return Part(name, ROWS, 1e-3 * np.arange(SIZE), measured, None, 1, (), noise, weight > 0.0, weight)


def seen():
    return {name: Seen(RNG.standard_normal((2, SIZE)), np.ones(SIZE)) for name in ("quiet", "loud")}


def test_columns_are_carried_to_noise_that_was_judged_anew():
    white = Evidence((part("quiet", [], []), part("loud", [], [])))
    parts = [
        replace(one, noise=tuple(replace(n, sigma=0.7 * n.sigma, memory=np.array([0.8, -0.2])) for n in one.noise))
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
