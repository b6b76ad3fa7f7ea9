"""A stand-in for a fitter, whose tasks run one after the other."""

from types import SimpleNamespace


class InTurn(SimpleNamespace):
    """Attributes, and tasks that each use this stand-in itself."""

    def side_by_side(self, tasks):
        return [task(self) for task in tasks]
