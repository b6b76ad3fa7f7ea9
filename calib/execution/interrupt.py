"""Ctrl-C and what ends a program like it; deferred until a block of code has ended."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_deferring: list[list[int]] = []  # signals that came in each block that defers them, the innermost block last


@contextmanager
def ended_like_ctrl_c() -> Iterator[None]:
    """Let SIGTERM and SIGHUP end the block as Ctrl-C does, where they would kill the process: it leaves nothing behind.

    A signal that is ignored stays so: a hang-up under nohup, Ctrl-C in the background of a script. SIGTERM ends that.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    deadly = [number for number in (signal.SIGTERM, signal.SIGHUP) if signal.getsignal(number) == signal.SIG_DFL]
    for number in deadly:
        signal.signal(number, _interrupt)
    try:
        yield
    finally:
        for number in deadly:
            signal.signal(number, signal.SIG_DFL)


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Do what Ctrl-C does at present, or would do were it not ignored."""
    handler = signal.getsignal(signal.SIGINT)
    if callable(handler):
        handler(number, frame)
    elif _deferring:
        _deferring[-1].append(number)
    else:
        raise KeyboardInterrupt


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Defer Ctrl-C and what ends like it until the block has ended; threads and processes started in it receive none.

    Blocking the signal in this thread is not enough: another thread receives it, and Python runs the handler here.
    """
    caught: list[tuple[int, FrameType | None]] = []
    installed, in_main_thread = signal.getsignal(signal.SIGINT), threading.current_thread() is threading.main_thread()
    handler = installed if callable(installed) and in_main_thread else None
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    ended: list[int] = []
    if handler is not None:
        signal.signal(signal.SIGINT, lambda number, frame: caught.append((number, frame)))
    elif in_main_thread:
        _deferring.append(ended)
    try:
        yield
    finally:
        if handler is None and in_main_thread:
            _deferring.pop()
        if handler is not None:
            signal.signal(signal.SIGINT, handler)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        if handler is not None and caught:
            handler(*caught[0])
        for number in ended[:1]:
            _interrupt(number, None)
