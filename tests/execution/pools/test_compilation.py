"""Whoever waits for a result is told that a child process compiles."""

import compiled_functions
import numba
import numpy as np
import pool_functions
import pytest

from calib.execution.pools import local
from calib.execution.pools.local import LocalPool


@pytest.fixture(autouse=True)
def impatient(monkeypatch):
    monkeypatch.setattr(local, "COMPILATION_INTERVAL", 1e-3)


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_compiling_is_told_as_long_as_it_goes_on_and_for_each_type_of_argument_once():
    told = []
    with LocalPool(compiled_functions.total, on_compiling=told.append) as pool:
        for begun, numbers in ((1, np.ones(3)), (1, np.ones(4)), (2, np.ones(3, dtype=int))):
            assert [result for _, result in pool.map([numbers])] == [numbers.sum()]
            assert told == [True, False] * begun


def test_a_call_that_compiles_nothing_is_not_said_to():
    told = []
    with LocalPool(pool_functions.slow_square, on_compiling=told.append) as pool:
        assert list(pool.map([0.05])) == [(0, 0.05**2)]
    assert told == []
