"""Stand-ins for what runs tasks in their turn, and ahead of it."""

from collections import deque
from contextlib import nullcontext
from types import SimpleNamespace


class InTurn(SimpleNamespace):
    """Attributes of a fitter, whose tasks each use this stand-in itself."""

    def in_turn(self, tasks):
        return (task(self) for task in tasks)

    def attempt(self, step):
        return step()

    def measuring(self, kind, count=1.0):
        return nullcontext()

    def foresee(self, kind, count):
        pass


class Processes:
    """A pool of so many processes, whose calls end in the order in which they have begun."""

    def __init__(self, jobs, function=lambda payload: payload):
        self.jobs, self.function, self.begun = jobs, function, []

    def map(self, payloads):
        waiting, busy = iter(enumerate(payloads)), deque()

        def hand_out():
            while len(busy) < self.jobs and (call := next(waiting, None)) is not None:
                self.begun.append(call[1])
                busy.append(call)

        hand_out()
        while busy:
            index, payload = busy.popleft()
            hand_out()
            yield index, self.function(payload)
            hand_out()
