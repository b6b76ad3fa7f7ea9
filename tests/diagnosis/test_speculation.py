"""What is run ahead of its turn, and what is simulated twice."""

import os
import random
import signal
import threading
import time
from collections import Counter
from contextlib import closing
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from in_turn import Processes
from pool_functions import square

from calib.diagnosis import speculation
from calib.diagnosis.bench import SimulatedRows
from calib.diagnosis.speculation import SpeculativePool
from calib.execution.pool import RAISED, Failure, InProcess, in_order
from calib.execution.pools.local import LocalPool
from calib.execution.suspension import suspended


@pytest.fixture(autouse=True)
def no_thread_is_left():
    """A process in the background of a script begins deaf to Ctrl-C."""
    suspended()  # its thread is that of the process, and lives on after the first pool that asks for it
    deaf, threads = signal.signal(signal.SIGINT, signal.default_int_handler), threading.active_count()
    yield
    signal.signal(signal.SIGINT, deaf)
    assert threading.active_count() == threads


def doubled(times, first, pool):
    """Return how the first payload doubles, one simulation after the other."""
    values = [first]
    for _ in range(times):
        values += [2 * value for value in in_order(pool, [values[-1]])]
    return values


def in_turn(pool, tasks):
    """Results of tasks of a pool in their turn."""
    return pool.in_turn([partial(task, pool) for task in tasks], tasks)


def test_nothing_is_simulated_twice_and_each_answer_is_a_copy():
    begun = Counter()

    def simulate(payload):
        begun[payload] += 1
        return [payload]

    pool = SpeculativePool(InProcess(simulate))
    first = in_order(pool, [1, 2, 1])
    again = in_order(pool, [2, 3, 1])
    assert (first, again) == ([[1], [2], [1]], [[2], [3], [1]])
    assert set(begun.values()) == {1}
    again[0].append("changed")
    assert in_order(pool, [2]) == [[2]]


def test_what_fails_is_tried_again():
    outcomes = iter([ValueError("once"), 7])

    def simulate(payload):
        outcome = next(outcomes)
        if isinstance(outcome, Exception):
            raise outcome
        return outcome

    pool = SpeculativePool(InProcess(simulate))
    [failure] = in_order(pool, [1])
    assert isinstance(failure, Failure)
    assert failure.status == RAISED
    assert in_order(pool, [1]) == in_order(pool, [1]) == [7]


def test_a_program_that_took_too_long_is_tried_again():
    rows = SimulatedRows(np.ones((1, 2)), np.ones(2))
    outcomes = iter([replace(rows, status="timeout"), rows])
    pool = SpeculativePool(InProcess(lambda payload: next(outcomes)))
    assert [in_order(pool, [1])[0].status for _ in range(3)] == ["timeout", "ok", "ok"]


def test_what_cannot_be_pickled_is_simulated_each_time():
    begun = []

    def simulate(payload):
        begun.append(payload)
        return payload()

    pool = SpeculativePool(InProcess(simulate))
    assert in_order(pool, 2 * [lambda: 1]) == in_order(pool, [lambda: 1, lambda: 1]) == [1, 1]
    assert in_order(pool, [int]) == in_order(pool, [int]) == [0]
    assert len(begun) == 5


def test_only_the_latest_results_are_remembered(monkeypatch):
    monkeypatch.setattr(speculation, "MEMORY_BYTES", 2_500)
    processes = Processes(1, lambda payload: bytes(1000))
    pool = SpeculativePool(processes)
    for payload in (1, 2, 1, 3, 1, 2):
        in_order(pool, [payload])
    assert processes.begun == [1, 2, 3, 2]


def test_the_next_tasks_run_ahead_on_idle_processes_only_and_are_known_in_their_turn():
    processes = Processes(2)
    pool = SpeculativePool(processes, idle=1)
    tasks = [partial(doubled, 2, 1), partial(doubled, 1, 10), partial(doubled, 3, 100)]
    assert list(in_turn(pool, tasks)) == [[1, 2, 4], [10, 20], [100, 200, 400, 800]]
    assert processes.begun == [1, 10, 2, 100, 200, 400]


def test_what_is_expected_goes_on_before_a_batch_has_ended():
    processes = Processes(2)
    pool = SpeculativePool(processes, idle=1)
    with pool.expecting([partial(doubled, 2, 1), partial(doubled, 2, 10)]):
        assert in_order(pool, [1, 10, 100]) == [1, 10, 100]
        assert processes.begun == [1, 10, 100, 2]
        assert in_order(pool, [2, 20]) == [2, 20]
    assert processes.begun == [1, 10, 100, 2, 20]


def test_with_one_process_nothing_runs_ahead():
    processes = Processes(1)
    assert list(in_turn(SpeculativePool(processes), [partial(doubled, 2, 1), partial(doubled, 1, 10)]))
    assert processes.begun == [1, 2, 10]


def test_in_this_process_nothing_runs_ahead_whatever_the_study_states():
    begun = []
    pool = SpeculativePool(InProcess(lambda payload: begun.append(payload) or payload), idle=1)
    assert list(in_turn(pool, [partial(doubled, 2, 1), partial(doubled, 1, 10)])) == [[1, 2, 4], [10, 20]]
    assert begun == [1, 2, 10]


def test_what_all_ask_for_is_simulated_once():
    processes = Processes(3)
    results = list(in_turn(SpeculativePool(processes, idle=2), 3 * [partial(doubled, 4, 1)]))
    assert results == 3 * [[1, 2, 4, 8, 16]]
    assert processes.begun == [1, 2, 4, 8]


def test_what_was_expected_wrongly_is_simulated_as_it_is_asked_for():
    """The second task depends on the first, whose result is not known ahead."""
    limit = [3]

    def first(pool):
        limit[0] = in_order(pool, [50])[0]
        in_order(pool, [60, 70])
        return limit[0]

    def second(pool):
        return in_order(pool, [limit[0], -1])

    def simulated(pool):
        limit[0] = 3
        yield from pool.in_turn([partial(first, pool), partial(second, pool)], [partial(in_order, payloads=[]), second])

    processes = Processes(2)
    assert list(simulated(SpeculativePool(processes, idle=1))) == [50, [50, -1]]
    assert processes.begun == [50, 3, 60, 70, -1]


def test_a_task_within_a_task_runs_ahead_first():
    processes = Processes(2)
    pool = SpeculativePool(processes, idle=1)

    def outer(own):
        return list(in_turn(pool, [partial(doubled, 2, 1), partial(doubled, 1, 10)])) if own is pool else None

    assert list(in_turn(pool, [outer, partial(doubled, 1, 100)])) == [[[1, 2, 4], [10, 20]], [100, 200]]
    assert processes.begun == [1, 10, 2, 100]


def test_what_a_task_raises_ahead_counts_in_its_turn_only():
    def raising(pool):
        in_order(pool, [5])
        raise ValueError("here")

    results = in_turn(SpeculativePool(Processes(2), idle=1), [partial(doubled, 4, 1), raising, partial(doubled, 1, 7)])
    assert next(results) == [1, 2, 4, 8, 16]
    with pytest.raises(ValueError, match="here"):
        next(results)


def test_tasks_that_are_left_end():
    before, pool = threading.active_count(), SpeculativePool(Processes(2), idle=1)
    results = in_turn(pool, [partial(doubled, 2, 1), partial(doubled, 9, 3), partial(doubled, 9, 5)])
    assert next(results) == [1, 2, 4]
    assert threading.active_count() > before
    results.close()
    assert threading.active_count() == before
    results = in_turn(pool, [partial(doubled, 2, 1.5), partial(doubled, 9, 3.5)])
    next(results)
    pool.close()
    assert threading.active_count() == before


def test_ctrl_c_while_a_task_computes_ahead_ends_all():
    def computing(own):
        in_order(own, [1])
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.05)
        in_order(own, [2])
        gone_on.append(True)

    gone_on, pool = [], SpeculativePool(Processes(2), idle=1)
    with pytest.raises(KeyboardInterrupt):
        list(in_turn(pool, [partial(doubled, 9, 3), computing]))
    pool.close()
    assert gone_on == []


def steps(seed, pool):
    """Squares of numbers that depend on the ones before, in batches of several sizes with pauses of any length."""
    rng, pauses, squares = random.Random(seed), random.Random(), [seed]
    for _ in range(rng.randrange(2, 6)):
        time.sleep(0.004 * pauses.random())
        squares += in_order(pool, [(squares[-1] + rng.randrange(9)) % 99 for _ in range(rng.randrange(4))])
    return squares


def test_nothing_depends_on_timing_or_on_the_number_of_processes():
    tasks = [partial(steps, seed) for seed in range(6)]
    expected = [task(InProcess(square)) for task in tasks]
    with LocalPool(square, jobs=2) as two, LocalPool(square, jobs=3) as three:
        for pool, idle in ((InProcess(square), 0), (two, 1), (three, 2), (two, 1), (two, 0)):
            with closing(SpeculativePool(pool, idle)) as ahead:
                assert list(in_turn(ahead, tasks)) == expected
