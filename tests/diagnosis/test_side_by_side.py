"""Independent tasks that simulate on one pool."""

import os
import random
import signal
import threading
import time
from functools import partial

import pytest
from pool_functions import square

from calib.diagnosis.side_by_side import FITS_AT_ONCE, side_by_side, waves
from calib.execution.pool import InProcess, LocalPool, in_order


@pytest.fixture(autouse=True)
def no_thread_is_left():
    """A process in the background of a script begins deaf to Ctrl-C."""
    deaf, threads = signal.signal(signal.SIGINT, signal.default_int_handler), threading.active_count()
    yield
    signal.signal(signal.SIGINT, deaf)
    assert threading.active_count() == threads


class InBatches(InProcess):
    """A pool that takes the payloads that there are, and no more until all of these have ended."""

    def __init__(self):
        super().__init__(abs)
        self.batches = []

    def map(self, payloads):
        self.batches.append(list(payloads))
        return super().map(self.batches[-1])


def doubled_until(limit, first, pool):
    """Return how the first payload doubles until the limit, one simulation after the other."""
    values = [first]
    while values[-1] < limit:
        values += [2 * value for value in in_order(pool, [values[-1]])]
    return values


def test_what_all_tasks_wait_for_runs_together():
    pool = InBatches()
    tasks = [partial(doubled_until, 8, 1), partial(doubled_until, 8, 3), lambda own: in_order(own, [-5, -6])]
    assert side_by_side(pool, tasks) == [[1, 2, 4, 8], [3, 6, 12], [5, 6]]
    assert pool.batches == [[1, 3, -5, -6], [2, 6], [4]]


def test_a_task_goes_on_before_the_simulations_of_the_others_have_ended():
    begun = []

    def simulate(payload):
        begun.append(payload)
        return payload

    tasks = [partial(doubled_until, 8, 1), lambda own: in_order(own, [10, 20]), partial(doubled_until, 8, 3)]
    assert side_by_side(InProcess(simulate), tasks) == [[1, 2, 4, 8], [10, 20], [3, 6, 12]]
    assert begun == [1, 10, 20, 3, 2, 6, 4]


def test_without_tasks_or_simulations_nothing_is_mapped():
    pool = InBatches()
    assert side_by_side(pool, []) == []
    assert side_by_side(pool, [lambda own: 1, lambda own: in_order(own, [])]) == [1, []]
    assert pool.batches == []


def test_tasks_within_tasks_share_the_batch():
    def nested(pool):
        return side_by_side(pool, [partial(doubled_until, 8, 1), partial(doubled_until, 8, 3)])

    pool = InBatches()
    assert side_by_side(pool, [partial(doubled_until, 20, 5), nested]) == [[5, 10, 20], [[1, 2, 4, 8], [3, 6, 12]]]
    assert pool.batches == [[5, 1, 3], [10, 2, 6], [4]]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
@pytest.mark.parametrize("place", ["at once", "later", "pool"])
def test_whatever_is_raised_ends_all_tasks(error, place):
    ended = []

    def simulate(payload):
        if (place, payload) == ("pool", 2):
            raise error("here") if error is KeyboardInterrupt else Broken(error("here"))
        return payload

    def patient(pool):
        try:
            return doubled_until(1e9, 1, pool)
        except Exception:  # a task that would mend anything
            return doubled_until(1e9, 1, pool)
        finally:
            ended.append(True)

    def raising(pool):
        if place == "later":
            doubled_until(4, 1, pool)
        if place != "pool":
            raise error("here")
        return doubled_until(8, 1, pool)

    with pytest.raises((error, Broken), match="here"):
        side_by_side(InProcess(simulate), [patient, patient, raising, patient])
    assert len(ended) == (2 if place == "at once" else 3)


class Broken(BaseException):
    """Breaks a pool, which takes an exception of its function for a failure of one call."""


def test_ctrl_c_while_a_task_computes_ends_all():
    def computing(pool):
        in_order(pool, [1])
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.05)
        in_order(pool, [1])
        gone_on.append(True)

    gone_on = []
    with pytest.raises(KeyboardInterrupt):
        side_by_side(InProcess(abs), [computing, partial(doubled_until, 1e9, 1)])
    assert gone_on == []


def steps(seed, pool):
    """Squares of numbers that depend on the ones before, in batches of several sizes with pauses of any length."""
    rng, pauses, squares = random.Random(seed), random.Random(), [seed]
    for _ in range(rng.randrange(2, 6)):
        time.sleep(0.004 * pauses.random())
        squares += in_order(pool, [(squares[-1] + rng.randrange(9)) % 99 for _ in range(rng.randrange(4))])
    return squares


def test_nothing_depends_on_timing_or_on_the_number_of_processes():
    expected = [steps(seed, InProcess(square)) for seed in range(6)]
    with LocalPool(square, jobs=2) as two, LocalPool(square, jobs=3) as three:
        for pool in (InProcess(square), two, three, two):
            assert side_by_side(pool, [partial(steps, seed) for seed in range(6)]) == expected


def test_a_wave_holds_so_many_and_the_first_may_be_alone():
    items = list(range(2 * FITS_AT_ONCE + 1))
    assert [len(wave) for wave in waves(items, first_alone=True)] == [1, FITS_AT_ONCE, FITS_AT_ONCE]
    assert [len(wave) for wave in waves(items, first_alone=False)] == [FITS_AT_ONCE, FITS_AT_ONCE, 1]
    assert [item for wave in waves(items, first_alone=True) for item in wave] == items
    assert list(waves([], first_alone=True)) == []
