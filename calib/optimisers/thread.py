"""A method that calls a function, turned into one that asks for points and waits for their outcomes."""

import threading
from collections.abc import Callable, Sequence
from queue import SimpleQueue
from typing import Any, TypeAlias

import numpy as np

from calib.optimisers.outcome import OutcomeLike

Evaluate: TypeAlias = Callable[[np.ndarray], Sequence[OutcomeLike]]  # points (n, dim) -> n outcomes


class Closed(BaseException):
    """Ends the method from within its function; no `except Exception` on the way stops it."""


class Conversation:
    """Runs `method(evaluate)` in a thread, where `evaluate(points)` waits for the outcomes of the points.

    Only one side runs at a time: `waiting` blocks until the method wants something or has ended, so nothing depends
    on timing.
    """

    def __init__(self, method: Callable[[Evaluate], Any]):
        self._method = method
        self._requests: SimpleQueue[tuple[str, Any]] = SimpleQueue()
        self._answers: SimpleQueue[Sequence[OutcomeLike] | None] = SimpleQueue()
        self._event: tuple[str, Any] | None = None
        self._thread = threading.Thread(target=self._run, name="optimiser", daemon=True)
        self._thread.start()

    def waiting(self) -> tuple[str, Any]:
        """What the method wants: ("points", array), ("ended", its result) or ("raised", the exception)."""
        if self._event is None:
            self._event = self._requests.get()
        return self._event

    def tell(self, outcomes: Sequence[OutcomeLike]) -> None:
        """Answer the request for points."""
        self._event = None
        self._answers.put(outcomes)

    def close(self) -> None:
        """End the method, wherever it stands, and its thread; safe to call twice."""
        if self._thread.is_alive():
            self._answers.put(None)
            self._thread.join()

    def _run(self) -> None:
        try:
            self._requests.put(("ended", self._method(self._evaluate)))
        except Closed:
            pass
        except Exception as error:  # not mended here: the other thread raises it
            self._requests.put(("raised", error))

    def _evaluate(self, points: np.ndarray) -> Sequence[OutcomeLike]:
        self._requests.put(("points", points))
        outcomes = self._answers.get()
        if outcomes is None:
            self._answers.put(None)  # should the method call once more on its way out
            raise Closed
        return outcomes
