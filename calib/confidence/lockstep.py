"""Functions that evaluate points, run side by side: what they ask for at a time is one batch."""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np

from calib.confidence.derivatives import Evaluate
from calib.execution.conversation import Conversation
from calib.study import Outcome

R = TypeVar("R")


def lockstep(evaluate: Evaluate, functions: Sequence[Callable[[Evaluate], R]]) -> list[R]:
    """Return the results of functions that each call their `evaluate` one batch at a time.

    The points that all of them wait for are evaluated together. Each runs in a thread, but only one at a time and
    always in their order, so that nothing depends on timing.

    Parameters
    ----------
    evaluate : points (n, dim) -> n outcomes
    """
    conversations = [Conversation[np.ndarray, Sequence[Outcome]](function) for function in functions]
    try:
        while True:
            waiting = [conversation.waiting() for conversation in conversations]
            for event, what in waiting:
                if event == "raised":
                    raise what
            asking = [index for index, (event, _) in enumerate(waiting) if event == "asked"]
            if not asking:
                return [result for _, result in waiting]
            _answer(evaluate, [(conversations[index], waiting[index][1]) for index in asking])
    finally:
        for conversation in conversations:
            conversation.close()


def _answer(evaluate: Evaluate, asked: Sequence[tuple[Conversation[np.ndarray, Any], np.ndarray]]) -> None:
    outcomes = list(evaluate(np.vstack([points for _, points in asked])))
    for conversation, points in asked:
        conversation.tell(outcomes[: len(points)])
        del outcomes[: len(points)]
