"""A function that asks, turned into one side of a conversation: it waits for each answer of the other side."""

import threading
from collections.abc import Callable
from queue import SimpleQueue
from typing import Any, Generic, TypeVar

Question = TypeVar("Question")
Answer = TypeVar("Answer")


class Closed(BaseException):
    """Ends the function from within; no `except Exception` on the way stops it."""


class Conversation(Generic[Question, Answer]):
    """Runs `function(ask)` in a thread, where `ask(question)` waits for the answer.

    Only one side runs at a time: `waiting` blocks until the function wants something or has ended, so nothing depends
    on timing. The thread starts with the first `waiting`.
    """

    def __init__(self, function: Callable[[Callable[[Question], Answer]], Any]):
        self._function = function
        self._requests: SimpleQueue[tuple[str, Any]] = SimpleQueue()
        self._answers: SimpleQueue[Answer | None] = SimpleQueue()
        self._event: tuple[str, Any] | None = None
        self._thread = threading.Thread(target=self._run, name="conversation", daemon=True)

    def waiting(self) -> tuple[str, Any]:
        """What the function wants: ("asked", question), ("ended", its result) or ("raised", the exception)."""
        if self._thread.ident is None:
            self._thread.start()
        if self._event is None:
            self._event = self._requests.get()
        return self._event

    def tell(self, answer: Answer) -> None:
        """Answer the question."""
        self._event = None
        self._answers.put(answer)

    def close(self) -> None:
        """End the function, wherever it stands, and its thread; safe to call twice."""
        if self._thread.is_alive():
            self._answers.put(None)
            self._thread.join()

    def _run(self) -> None:
        try:
            self._requests.put(("ended", self._function(self._ask)))
        except Closed:
            pass
        except BaseException as error:  # not mended here: the other thread raises it
            self._requests.put(("raised", error))

    def _ask(self, question: Question) -> Answer:
        self._requests.put(("asked", question))
        answer = self._answers.get()
        if answer is None:
            self._answers.put(None)  # should the function ask once more on its way out
            raise Closed
        return answer
