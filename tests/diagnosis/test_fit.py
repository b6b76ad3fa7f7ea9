"""How sure the parameters of a fitted model are."""

import numpy as np
import pytest

from calib.diagnosis.excess import bias_std
from calib.diagnosis.fit import Fit

N = 400


def test_a_joint_error_is_wider_where_more_than_noise_is_left():
    rng = np.random.default_rng(2)
    columns, residual = np.column_stack([rng.standard_normal((N, 2)), np.zeros(N)]), rng.standard_normal(N)
    rest = columns, ("a", "b", "c"), (), np.zeros((N, 0)), np.zeros(N, dtype=int)
    noise, gross = (Fit(None, (), size * residual, *rest) for size in (1.0, 5.0))
    assert noise.error(["a"]) == pytest.approx(N**-0.5, rel=0.2)
    assert gross.error(["a"]) == pytest.approx(5.0 * noise.error(["a"]), rel=0.15)
    assert noise.error(["c"]) == np.inf  # no record knows it
    assert gross.inflation(["a"]) == pytest.approx(25.0, rel=0.3)
    assert noise.inflation(["a", "b"]) == pytest.approx(1.0, rel=0.4)
    assert noise.inflation(["c"]) == 1.0
    assert (noise.half_width(["a"]) > 1.95 * noise.error(["a"])).all()


@pytest.mark.parametrize("size", [1.0, 5.0])
def test_the_noise_of_gains_is_known_where_a_common_one_is_calibrated(size):
    """Of the gains of two channels and of both only two are told: what they change together is."""
    rng = np.random.default_rng(3)
    one, other = np.zeros(N), np.zeros(N)
    one[: N // 2], other[N // 2 :] = rng.standard_normal((2, N // 2))
    rows = np.repeat([0, 1], N // 2)
    residual = size * rng.standard_normal(N)
    columns = np.column_stack([one + other, one, other])
    fit = Fit(None, (), residual, columns, ("both", "one", "other"), (), np.zeros((N, 0)), rows)
    assert fit.inflation(["one", "other"]) == pytest.approx(size**2, rel=0.4)


def test_a_derivative_whose_steps_contradict_each_other_gives_no_interval():
    rng = np.random.default_rng(4)
    columns, residual = rng.standard_normal((N, 2)) * [1.0, 1e9], rng.standard_normal(N)
    rest = columns, ("smooth", "jumps"), (), np.zeros((N, 0)), np.zeros(N, dtype=int)
    fit = Fit(None, (), residual, *rest, relative_errors=(0.1, 1.0))
    assert fit.error(["smooth", "jumps"]) == pytest.approx([N**-0.5, np.inf], rel=0.2)
    assert fit.information("smooth") == pytest.approx(N, rel=0.2)
    assert fit.information("jumps") == 0.0
    assert bias_std(1.0, fit.information("jumps")) == np.inf
