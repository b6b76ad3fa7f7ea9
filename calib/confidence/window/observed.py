"""What is known of evaluated points: whether the motion is of the measured kind, and its graded margins."""

from dataclasses import dataclass

import numpy as np

KIND_MARGIN = "another kind of motion"  # label of the margin that is made of the kinds alone


@dataclass(frozen=True, eq=False)
class Observed:
    """Evaluated points of the unit cube.

    A margin is positive where a condition is met, falls continuously to zero where it ceases to be met, and is known
    only where the motion is of the measured kind, and there not necessarily everywhere.

    Attributes
    ----------
    points : (n, dim)
    right : (n,) whether the motion is of the measured kind, or of one whose margins are known as well; false where the
        simulation failed
    margins : (n, k)  [1]; NaN where unknown
    labels : (k,) what bounds the window where a margin is zero
    of_kind : (k,) whether the kind of motion changes where a margin is zero: there it is known on one side alone
    """

    points: np.ndarray
    right: np.ndarray
    margins: np.ndarray
    labels: tuple[str, ...]
    of_kind: tuple[bool, ...]

    @property
    def admissible(self) -> np.ndarray:
        """Whether each point (n,) has the measured kind and no negative margin."""
        return self.right & ~(self.margins < 0).any(axis=1)

    def first(self, number: int) -> "Observed":
        """Return the first so many points."""
        return Observed(self.points[:number], self.right[:number], self.margins[:number], self.labels, self.of_kind)


def graded(size: np.ndarray | float, tolerance: float) -> np.ndarray:
    """Margin of a size >= 0 that must not exceed its tolerance: log 2 at size 0, 0 at the tolerance, negative beyond.

    It is log(2 / (1 + r^2)) of the ratio r of both. A norm has a kink at zero, where its square is as smooth as what it
    is the norm of; the logarithm lets far points weigh less.
    """
    return np.log(2.0 / (1.0 + (np.asarray(size, dtype=float) / tolerance) ** 2))
