"""The stages of a diagnosis, as they are said to whoever waits for it."""

from collections.abc import Callable

COMPILING = " (compiling)"  # behind the name of a stage, as long as its simulations wait for kernels


class Stages:
    """Says which stage goes on, and whether kernels are compiled in it.

    Parameters
    ----------
    on_stage : called with the name of each stage as it begins, and again as compiling begins and ends
    """

    def __init__(self, on_stage: Callable[[str], None]):
        self._on_stage, self._stage, self._compiling = on_stage, "", False

    def __call__(self, stage: str) -> None:
        """Begin a stage."""
        self._stage = stage
        self._on_stage(f"{stage}{COMPILING if self._compiling else ''}")

    def compiling(self, compiling: bool) -> None:
        """Take in that compiling begins or ends."""
        self._compiling = compiling
        self(self._stage)
