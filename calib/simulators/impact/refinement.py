"""Numerics that are finer than a simulator's own."""

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Refinement:
    """How much finer the numerics of a run are than the simulator's own.

    Attributes
    ----------
    time_step : by which the steps are divided  [1]
    event_tolerance : by which the tolerance of located events and the height of sticking are divided  [1]
    """

    time_step: float = 1.0
    event_tolerance: float = 1.0

    def times(self, what: str, factor: float) -> "Refinement":
        """Return the refinement with its "time_step" or "event_tolerance" multiplied by `factor`."""
        return replace(self, **{what: getattr(self, what) * factor})


UNREFINED = Refinement()
