"""What an extension brings on records that had no part in finding it."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Gain:
    """Held-out misfit before and after."""


def gained(pool=None):
    """Gain."""
