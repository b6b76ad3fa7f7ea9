"""A call in a forked process gives its result and its errors, and takes nothing with it when it hangs or crashes."""

import os
import threading

import numpy as np
import pytest

from calib.errors import CalibError
from calib.execution.apart import apart

MEMORY = 2**27  # bytes


def test_arrays_come_back():
    rows = apart(lambda: {"a": np.arange(1000.0)}, 5, MEMORY)["a"]
    assert rows.tolist() == list(range(1000))


def _hang():
    while True:
        pass


def _fail():
    raise CalibError("expected this")


@pytest.mark.parametrize(
    ("call", "error", "expected"),
    [
        (_hang, OSError, "more than 1 s"),
        (lambda: np.ones(2**28).sum(), OSError, "too much memory"),
        (lambda: os.kill(os.getpid(), 9), OSError, "crashed: SIGKILL"),
        (lambda: os._exit(3), OSError, "failed"),
        (_fail, CalibError, "^expected this$"),
        (lambda: {}["a"], OSError, "KeyError: 'a'"),
    ],
)
def test_what_goes_wrong_is_an_error_here(call, error, expected):
    with pytest.raises(error, match=expected):
        apart(call, 1, MEMORY)


def test_what_it_changes_is_lost():
    values = [1]
    apart(lambda: values.append(2), 5, MEMORY)
    assert values == [1]


def test_what_waits_for_ever_is_given_up(monkeypatch):
    monkeypatch.setattr("calib.execution.apart.WALL", 1)
    with pytest.raises(OSError, match="more than 1 s$"):
        apart(threading.Event().wait, 1, MEMORY)
