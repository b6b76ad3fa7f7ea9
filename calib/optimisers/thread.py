"""A method that calls a function, turned into one that asks and is told."""

import threading
from queue import SimpleQueue


class Closed(BaseException):
    """Ends the method from within its function; no `except Exception` on the way stops it."""


class Conversation:
    """Runs `method(evaluate)` in a thread, where `evaluate(points)` waits until the outcomes of the points are told.

    Only one side runs at a time: `waiting` blocks until the method wants something or has ended, so nothing depends
    on timing.
    """

    def __init__(self, method):
        self._method, self._requests, self._answers = method, SimpleQueue(), SimpleQueue()
        self._event = None
        self._thread = threading.Thread(target=self._run, name="optimiser", daemon=True)
        self._thread.start()

    def waiting(self):
        """What the method wants: ("points", array), ("ended", its result) or ("raised", the exception)."""
        if self._event is None:
            self._event = self._requests.get()
        return self._event

    def tell(self, outcomes):
        """Answer the request for points."""
        self._event = None
        self._answers.put(outcomes)

    def close(self):
        """End the method, wherever it stands, and its thread; safe to call twice."""
        if self._thread.is_alive():
            self._answers.put(None)
            self._thread.join()

    def _run(self):
        try:
            self._requests.put(("ended", self._method(self._evaluate)))
        except Closed:
            pass
        except Exception as error:  # not mended here: the other thread raises it
            self._requests.put(("raised", error))

    def _evaluate(self, points):
        self._requests.put(("points", points))
        outcomes = self._answers.get()
        if outcomes is None:
            self._answers.put(None)  # should the method call once more on its way out
            raise Closed
        return outcomes
