"""How an estimate agrees with the 95 % interval that it states."""

from typing import Protocol


class Estimate(Protocol):
    """A value with the ends of its interval."""

    @property
    def value(self) -> float: ...
    @property
    def low(self) -> float: ...
    @property
    def high(self) -> float: ...


def half_widths(estimate: Estimate, truth: float) -> float:
    """Error of an estimate over the half of its 95 % interval on that side  [1]; 0 without an error.

    What is drawn, searched or fitted step by step depends on the last digits of the processor, so that each machine
    draws anew: of such an estimate a test that asks for less than 1 fails on one of twenty. Of a normal error 2 is
    exceeded by one in ten thousand.
    """
    error = abs(truth - estimate.value)
    half = estimate.high - estimate.value if truth > estimate.value else estimate.value - estimate.low
    return error / half if error else 0.0
