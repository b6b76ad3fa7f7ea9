"""Speculative execution: what is expected next is run ahead on idle processes; what was simulated before is known."""

import pickle
from collections import OrderedDict, deque
from collections.abc import Callable, Generator, Hashable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from hashlib import sha256
from typing import Any, TypeVar

from calib.diagnosis.bench import SimulatedRows
from calib.execution.conversation import Conversation
from calib.execution.pool import Failure, Pool
from calib.store.kept_results import KeptResults

MEMORY_BYTES = 256_000_000  # of results, the latest

T = TypeVar("T")


class SpeculativePool:
    """A pool that answers from memory what it has simulated, and runs tasks ahead whose turn has not come.

    What a task asks for ahead of its turn, with what is known then, is simulated only where a process is idle. Nothing
    but simulations is kept of that: in its turn the task is run as if nothing had been run ahead, and where it asks for
    the same, to the last bit, the answer is known. So no result depends on what was run ahead, on timing or on the
    number of processes. The function of the pool has to be deterministic.

    Parameters
    ----------
    pool : whose function is evaluated
    idle : number of its processes that may run ahead at a time, all but one  [count]
    kept : in which results outlive the process; None: in memory alone
    """

    def __init__(self, pool: Pool, idle: int = 0, kept: KeptResults | None = None):
        self._pool, self._calls = pool, _Calls(idle, kept)
        self._results: Iterator[tuple[int, Any]] | None = None  # of the calls, as long as some are under way

    def map(self, payloads: Iterable[Any]) -> Iterator[tuple[int, Any]]:
        """Yield (index, result or Failure): first what is known, then the others as they end."""
        asked: dict[Hashable, tuple[Any, list[int]]] = {}
        for index, payload in enumerate(payloads):
            asked.setdefault(_key(payload) or object(), (payload, []))[1].append(index)
        for key in [key for key in asked if key in self._calls.memory]:
            for index in asked.pop(key)[1]:
                yield index, self._calls.memory.result(key)
        self._calls.ask([(key, payload) for key, (payload, _) in asked.items()])
        while asked:
            ended, result = self._next_result()
            for index in asked.pop(ended, (None, []))[1]:
                yield index, result

    def in_turn(
        self, tasks: Sequence[Callable[[], T]], ahead: Sequence[Callable[[Pool], object]]
    ) -> Generator[T, None, None]:
        """Yield the results of tasks one after the other; what follows the one that simulates is run ahead.

        Parameters
        ----------
        ahead : the same tasks, as `expecting` has them
        """
        with self.expecting(ahead) as expected:
            for task in tasks:
                expected.popleft().close()
                yield task()

    @contextmanager
    def expecting(self, ahead: Sequence[Callable[[Pool], object]]) -> Iterator[deque["_Ahead"]]:
        """Run tasks ahead as long as this lasts, or until they are taken from the deque and closed.

        Parameters
        ----------
        ahead : tasks that simulate on the pool that each is given, and change nothing that others know; what they raise
            is raised by what they are expected of, or never
        """
        expected = deque(_Ahead(task) for task in ahead)
        self._calls.expected.append(expected)
        try:
            yield expected
        finally:
            self._calls.expected = [other for other in self._calls.expected if other is not expected]
            for one in expected:
                one.close()

    def close(self) -> None:
        """Leave what is run ahead; calls under way are killed."""
        for one in self._calls.all_ahead():
            one.close()
        if isinstance(self._results, Generator):
            self._results.close()

    def _next_result(self) -> tuple[Hashable, Any]:
        """Key and result of the call that ends next."""
        while True:
            if self._results is None:
                self._results = self._pool.map(self._calls)
            answer = next(self._results, None)
            if answer is not None:
                return self._calls.ended(*answer)
            self._results = None


class _Calls:
    """The calls to be handed out: an iterator that goes on when more is asked for, and remembers their results.

    Attributes
    ----------
    memory : of results
    expected : tasks that may be run ahead, innermost last
    """

    def __init__(self, idle: int, kept: KeptResults | None = None):
        self.memory = _Memory(kept)
        self.expected: list[deque[_Ahead]] = []
        self._idle = idle
        self._asked: deque[tuple[Hashable, Any]] = deque()
        self._handed_out: list[tuple[Hashable, bool]] = []  # since the iteration began: keys, and whether ahead
        self._under_way: dict[Hashable, bool] = {}  # key -> whether ahead

    def __iter__(self) -> Iterator[Any]:
        self._handed_out.clear()
        return self

    def __next__(self) -> Any:
        ahead = not self._asked
        call = self._call_ahead() if ahead else self._asked.popleft()
        if call is None:
            raise StopIteration
        self._handed_out.append((call[0], ahead))
        self._under_way[call[0]] = ahead
        return call[1]

    def ask(self, calls: Iterable[tuple[Hashable, Any]]) -> None:
        """Ask for payloads by key, beside those that are under way."""
        self._asked.extend(call for call in calls if call[0] not in self._under_way)

    def ended(self, index: int, result: Any) -> tuple[Hashable, Any]:
        """Take the result of the call of this number; return its key too."""
        key, _ = self._handed_out[index]
        del self._under_way[key]
        if not _has_failed(result):
            self.memory.add(key, result)
        for one in self.all_ahead():
            one.answer(key, result)
        return key, result

    def all_ahead(self) -> "list[_Ahead]":
        """All tasks that may be run ahead, those that are expected first in front."""
        return [one for group in reversed(self.expected) for one in group]

    def _call_ahead(self) -> tuple[Hashable, Any] | None:
        """What a task asks for ahead of its turn; None where nothing is, or no process is left for it."""
        if sum(self._under_way.values()) >= self._idle:
            return None
        calls = (one.call(self.memory, self._under_way) for one in self.all_ahead())
        return next((call for call in calls if call is not None), None)


class _Ahead:
    """A task that is run ahead, in a thread that goes on only while `call` waits for it."""

    def __init__(self, task: Callable[[Pool], object]):
        self._conversation: Conversation[list[Any], list[Any]] = Conversation(partial(_run, task))
        self._waiting, self._ended = False, False
        self._open: dict[int, tuple[Hashable, Any]] = {}  # what it waits for, by position
        self._answers: dict[int, Any] = {}

    def call(self, memory: "_Memory", under_way: Iterable[Hashable]) -> tuple[Hashable, Any] | None:
        """Key and payload of a call that it waits for and that is not under way; None where there is none."""
        while not self._ended:
            for key in {key for key, _ in self._open.values() if key in memory}:
                self.answer(key, memory.result(key))
            if self._open:
                return next((call for call in self._open.values() if call[0] not in under_way), None)
            self._go_on()
        return None

    def answer(self, key: Hashable, result: Any) -> None:
        """Take a result that it may wait for."""
        for position in [position for position, (own, _) in self._open.items() if own == key]:
            del self._open[position]
            self._answers[position] = result

    def close(self) -> None:
        """End the task wherever it stands."""
        self._ended = True
        self._conversation.close()

    def _go_on(self) -> None:
        """Let the task go on until it waits again, ends or raises."""
        if self._waiting:
            self._conversation.tell([self._answers[position] for position in range(len(self._answers))])
        self._waiting, self._answers = True, {}
        event, asked = self._conversation.waiting()
        keys = [_key(payload) for payload in asked] if event == "asked" else []
        self._ended = event != "asked" or None in keys
        self._open = {} if self._ended else dict(enumerate(zip(keys, asked, strict=True)))


class _Asking:
    """A pool that asks for the results of all payloads together."""

    def __init__(self, ask: Callable[[list[Any]], list[Any]]):
        self._ask = ask

    def map(self, payloads: Iterable[Any]) -> Iterator[tuple[int, Any]]:
        """Yield (index, result or Failure) when all have ended."""
        yield from enumerate(self._ask(list(payloads)))


def _run(task: Callable[[Pool], object], ask: Callable[[list[Any]], list[Any]]) -> None:
    """Run a task on a pool whose results are asked for."""
    task(_Asking(ask))


class _Memory:
    """Pickled results by key, the latest of MEMORY_BYTES in all, and those that are kept in a file."""

    def __init__(self, kept: KeptResults | None = None) -> None:
        self._results: OrderedDict[Hashable, bytes] = OrderedDict()
        self._size = 0
        self._kept = kept

    def __contains__(self, key: Hashable) -> bool:
        return key in self._results or (self._kept is not None and key in self._kept)

    def add(self, key: Hashable, result: Any) -> None:
        """Remember a result."""
        if not isinstance(key, bytes) or (data := _pickled(result)) is None:
            return
        if self._kept is not None:
            self._kept.add(key, data)
        self._results[key] = data
        self._size += len(data)
        while self._size > MEMORY_BYTES:
            self._size -= len(self._results.popitem(last=False)[1])

    def result(self, key: Hashable) -> Any:
        """Return a result as a process would: a copy of its own."""
        if self._kept is not None and key not in self._results:
            return pickle.loads(self._kept.get(key))
        self._results.move_to_end(key)
        return pickle.loads(self._results[key])


def _has_failed(result: Any) -> bool:
    """Whether there is no result, which may be due to the wall clock: it is asked for again."""
    return isinstance(result, Failure) or (isinstance(result, SimulatedRows) and not result.usable)


def _key(payload: Any) -> bytes | None:
    """Check sum of the pickled payload; None where it cannot be pickled."""
    data = _pickled(payload)
    return None if data is None else sha256(data).digest()


def _pickled(thing: Any) -> bytes | None:
    """Pickled, or None where that cannot be."""
    try:
        return pickle.dumps(thing, pickle.HIGHEST_PROTOCOL)
    except (pickle.PicklingError, AttributeError, TypeError):
        return None
