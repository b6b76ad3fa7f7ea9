"""Six-dimensional windows of known volume: margins with kinks, and kinds of motion at which they jump or cease."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.stats import qmc

from calib.confidence.window.observed import Observed, graded

TRUTH_POINTS = 1 << 17  # of the quasi-random estimate of a volume; its error is 1e-3 of the volume
DIM = 6


class WindowCase(NamedTuple):
    """A window whose margins are known everywhere, and shown only where the motion is of the measured kind."""

    name: str
    labels: tuple[str, ...]
    of_kind: tuple[bool, ...]
    shown: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]

    def observe(self, points: np.ndarray) -> Observed:
        """What a simulator would tell of points (n, 6)."""
        right, margins = self.shown(points)
        return Observed(points, right, np.where(right[:, None], margins, np.nan), self.labels, self.of_kind)

    def admissible(self, points: np.ndarray) -> np.ndarray:
        """Whether points (n, 6) are in the window."""
        return self.observe(points).admissible


def _grazing(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """An impact is about to appear: the clearance ends at zero. A second contact changes the misfit with a kink."""
    clearance = 0.45 + 0.3 * np.sin(2.5 * x[:, 0]) - 0.9 * x[:, 1] + 0.4 * (x[:, 2] - 0.5) ** 2
    first = 1.2 * (x[:, 0] - 0.5 - 0.2 * x[:, 3]) + 0.4 * np.maximum(0.0, x[:, 1] - x[:, 2])
    misfit = np.hypot(first, 0.7 * (x[:, 4] - 0.3))
    return clearance > 0, np.column_stack([clearance, graded(misfit, 0.2)])


def _flip(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The multiplier leaves the unit circle at -1 or +1, its modulus has a kink at 0, a failing corner; two misfits."""
    multiplier = -1.4 + 2.6 * x[:, 0] - 0.5 * x[:, 1] * x[:, 2] + 0.2 * np.cos(4.0 * x[:, 3])
    fails = x[:, 4] + x[:, 5] > 1.7
    amplitude = x[:, 1] - 0.5 + 0.3 * np.sin(3.0 * x[:, 2]) - 0.25 * x[:, 0]
    phase = np.abs(x[:, 5] - 0.4) + 0.4 * np.maximum(0.0, x[:, 4] - 0.6)
    margins = [1.0 - multiplier**2, graded(np.abs(amplitude), 0.15), graded(phase, 0.3)]
    return (np.abs(multiplier) < 1) & ~fails, np.column_stack(margins)


def _fold(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Beyond a fold the motion jumps to another kind, which nothing announces but the kind itself."""
    beyond = x[:, 0] + 0.5 * x[:, 1] ** 2 > 0.9 - 0.2 * np.sin(3.0 * x[:, 2])
    misfit = np.sqrt((x[:, 0] - 0.4) ** 2 + 0.7 * (x[:, 1] - 0.5) ** 2 + 0.3 * (x[:, 3] - 0.5) ** 2)
    phase = 0.8 * np.abs(x[:, 4] - 0.5 * x[:, 2] - 0.2) + 0.3 * np.maximum(0.0, x[:, 5] - 0.5)
    return ~beyond, np.column_stack([graded(misfit, 0.25), graded(phase, 0.25)])


CASES = (
    WindowCase("grazing", ("grazing", "misfit"), (True, False), _grazing),
    WindowCase("flip", ("multiplier", "amplitude", "phase"), (True, False, False), _flip),
    WindowCase("fold", ("misfit", "phase"), (False, False), _fold),
)


def sobol(number: int, seed: int) -> np.ndarray:
    """Scrambled Sobol points (number, 6); the number is a power of two."""
    return qmc.Sobol(DIM, seed=seed).random(number)
