"""Ctrl-C held back."""

import os
import signal
import threading
import time

import pytest

from calib.execution.interrupt import ended_like_ctrl_c, uninterrupted


@pytest.fixture(autouse=True)
def heeding():
    """A process in the background of a script begins deaf to Ctrl-C, and under nohup to a hang-up."""
    usual = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL, signal.SIGHUP: signal.SIG_DFL}
    before = {number: signal.signal(number, handler) for number, handler in usual.items()}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def wait():
    """Let the interpreter run the handlers of signals that another thread has taken."""
    for _ in range(100):
        time.sleep(1e-4)


@pytest.mark.parametrize("others", [0, 1])
def test_ctrl_c_comes_when_the_block_has_ended(others):
    """Another thread, where there is one, takes the signal that this one blocks."""
    over = threading.Event()
    threads = [threading.Thread(target=over.wait) for _ in range(others)]
    for thread in threads:
        thread.start()
    done = []

    def block():
        with uninterrupted(), uninterrupted():
            os.kill(os.getpid(), signal.SIGINT)
            wait()
            done.append("all of it")

    with pytest.raises(KeyboardInterrupt):
        block()
    over.set()
    assert done == ["all of it"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


def test_the_error_of_the_block_is_not_lost():
    with pytest.raises(ValueError, match="torn"), uninterrupted():
        raise ValueError("torn")


def test_in_another_thread_nothing_is_held_back_from_this_one():
    found = []

    def block():
        with uninterrupted():
            found.append(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []))

    thread = threading.Thread(target=block)
    thread.start()
    thread.join()
    assert found == [True]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_what_would_kill_the_process_ends_a_block_like_ctrl_c(number):
    def ended():
        with ended_like_ctrl_c():
            os.kill(os.getpid(), number)
            wait()

    with pytest.raises(KeyboardInterrupt):
        ended()
    assert signal.getsignal(number) == signal.SIG_DFL


def test_what_ends_the_process_does_so_in_the_background_of_a_script_too():
    """There Ctrl-C is ignored: it must not be what SIGTERM does."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    done = []

    def ended():
        with ended_like_ctrl_c():
            with uninterrupted(), uninterrupted():
                os.kill(os.getpid(), signal.SIGTERM)
                wait()
                done.append("all of the block that defers it")
            done.append("what follows")

    with pytest.raises(KeyboardInterrupt):
        ended()
    assert done == ["all of the block that defers it"]
    assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


def test_a_signal_that_is_ignored_stays_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with ended_like_ctrl_c():
            os.kill(os.getpid(), signal.SIGHUP)
            assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)
