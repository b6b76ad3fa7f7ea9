"""Independent fits side by side: the simulations that any of them waits for are handed to one pool."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeAlias, TypeVar

from calib.execution.conversation import Conversation
from calib.execution.pool import Pool

FITS_AT_ONCE = 4  # of suspects, with the same bound for abandoning them  [count]

T = TypeVar("T")
Task: TypeAlias = Conversation[list[Any], list[Any]]  # asks for the results of payloads


def side_by_side(pool: Pool, tasks: Sequence[Callable[[Pool], T]]) -> list[T]:
    """Results of independent tasks in their order, each of which simulates on the pool that it is given.

    A task waits for the simulations that it asks for, while those of the others run on `pool` too. One task at a time
    goes on, in a thread of its own, and they have nothing in common: no result depends on timing or on the number of
    processes. All threads have ended when this function ends: where a task or the pool raises, and with Ctrl-C, the
    tasks end at their next simulation. A task may call this function with the pool that it is given.
    """
    with ExitStack() as threads:
        begun: list[Task] = [threads.enter_context(closing(Conversation(partial(_run, task)))) for task in tasks]
        requests = _Requests()
        for task in begun:
            requests.take(task)
        while requests.waiting:
            for index, result in pool.map(requests):
                requests.answer(index, result)
        return [task.waiting()[1] for task in begun]


def waves(items: Sequence[T], first_alone: bool) -> Iterator[Sequence[T]]:
    """Cut into what is fitted side by side; the first alone where it sets the bound for abandoning the others."""
    begin = 0
    while begin < len(items):
        end = begin + (1 if first_alone and not begin else FITS_AT_ONCE)
        yield items[begin:end]
        begin = end


def _run(task: Callable[[Pool], T], ask: Callable[[list[Any]], list[Any]]) -> T:
    """Run a task on a pool whose results are asked for."""
    return task(_Asking(ask))


class _Asking:
    """A pool that asks for the results of all payloads together."""

    def __init__(self, ask: Callable[[list[Any]], list[Any]]):
        self._ask = ask

    def map(self, payloads: Iterable[Any]) -> Iterator[tuple[int, Any]]:
        """Yield (index, result or Failure) when all have ended."""
        yield from enumerate(self._ask(list(payloads)))


@dataclass(eq=False)
class _Batch:
    """What a task has asked for: results by the position of their payload."""

    task: Task
    size: int
    results: dict[int, Any]


class _Requests:
    """The payloads that tasks wait for: an iterator that goes on when an answer has made a task ask again."""

    def __init__(self) -> None:
        self.waiting: deque[tuple[_Batch, int, Any]] = deque()
        self._handed_out: list[tuple[_Batch, int]] = []  # since the iteration began

    def __iter__(self) -> Iterator[Any]:
        self._handed_out.clear()
        return self

    def __next__(self) -> Any:
        if not self.waiting:
            raise StopIteration
        batch, position, payload = self.waiting.popleft()
        self._handed_out.append((batch, position))
        return payload

    def take(self, task: Task) -> None:
        """Let a task go on until it waits or ends, and note what it asks for; what it raises is raised here."""
        event, what = task.waiting()
        while event == "asked" and not what:
            task.tell([])
            event, what = task.waiting()
        if event == "raised":
            raise what
        if event == "asked":
            batch = _Batch(task, len(what), {})
            self.waiting.extend((batch, position, payload) for position, payload in enumerate(what))

    def answer(self, index: int, result: Any) -> None:
        """Take the result of the payload of this number, with which its task may go on."""
        batch, position = self._handed_out[index]
        batch.results[position] = result
        if len(batch.results) == batch.size:
            batch.task.tell([batch.results[k] for k in range(batch.size)])
            self.take(batch.task)
