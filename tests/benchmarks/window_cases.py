"""Six-dimensional windows of known volume: margins with kinks, and kinds of motion at which they jump or cease."""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.stats import qmc

from calib.confidence.window.observed import Observed, graded

TRUTH_POINTS = 1 << 20  # of a quasi-random estimate of a volume; its standard error is 1e-2 of the least one
TRUTH_ESTIMATES = 16  # with scramblings of their own, of which a true volume is the mean
DIM = 6
CUBE = ((0.0,) * DIM, (1.0,) * DIM)


class WindowCase(NamedTuple):
    """A window whose margins are known everywhere, and shown only where the motion is of the measured kind.

    Attributes
    ----------
    box : lowest and highest corner of a part of the cube that holds the window
    test_points : in it, at which a classification is compared with the truth
    calibrated : (6,) point that is known to be admissible; () where none is
    """

    name: str
    labels: tuple[str, ...]
    of_kind: tuple[bool, ...]
    shown: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
    box: tuple[tuple[float, ...], tuple[float, ...]] = CUBE
    test_points: int = 1 << 15
    calibrated: tuple[float, ...] = ()

    def observe(self, points: np.ndarray) -> Observed:
        """What a simulator would tell of points (n, 6)."""
        right, margins = self.shown(points)
        return Observed(points, right, np.where(right[:, None], margins, np.nan), self.labels, self.of_kind)

    def admissible(self, points: np.ndarray) -> np.ndarray:
        """Whether points (n, 6) are in the window."""
        return self.observe(points).admissible

    def points(self, number: int, seed: int) -> np.ndarray:
        """Scrambled Sobol points (number, 6) of the box; the number is a power of two."""
        low, high = np.array(self.box)
        return low + (high - low) * sobol(number, seed)

    def start(self) -> np.ndarray:
        """Points (k, 6) that are known before the search: the calibrated one."""
        return np.array(self.calibrated).reshape(-1, DIM)


@cache
def true_share(case: WindowCase) -> float:
    """Share of the cube that is admissible; its standard error is 3e-3 of the least one."""
    low, high = np.array(case.box)
    estimates = [case.admissible(case.points(TRUTH_POINTS, seed)).mean() for seed in range(TRUTH_ESTIMATES)]
    return float(np.prod(high - low) * np.mean(estimates))


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


def _ridge(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A window of 4e-5 of the cube, along a ridge on which two parameters are correlated by -0.996.

    It is what `studies/paper_window` has: a damping, the gap and the shift of its middle decide, their sum 7 times as
    much as how it is divided; friction, its damping and the contact's strength hardly matter. Misfits saturate; without
    contact they are known as well, and motions of little damping are irregular.
    """
    damping, friction, strength, gap, shift = x[:, 0], x[:, 2], x[:, 3], 0.01 + 0.99 * x[:, 4], x[:, 5]
    middle, division = gap + shift - 1.0, gap - 0.15
    by_middle = 1.2 * np.tanh(5.5 * (middle + 0.02 * np.maximum(0.0, 0.3 - strength) - 0.01 * friction))
    by_damping = np.tanh(3.8 * (damping - 0.667 + 0.3 * division))
    by_division = 0.8 * np.sin(0.7 * division * (1.0 - 0.3 * middle))
    by_division += 0.02 * np.maximum(0.0, friction - 0.5) * (1.0 - x[:, 1])
    phase = np.sqrt(by_middle**2 + by_damping**2 + by_division**2)
    amplitude = np.abs(0.8 * by_middle - 0.5 * by_damping + 0.1 * by_division)
    approach = 0.25 - middle - 0.2 * (1.0 - damping) * np.abs(x[:, 4] - 0.3)
    irregular = damping + 0.5 * x[:, 1] < 0.15 + 0.3 * np.maximum(0.0, shift - 0.3)
    return ~irregular, np.column_stack([graded(phase, 0.05), graded(amplitude, 0.05), approach])


RIDGE = WindowCase(
    "ridge", ("phase", "amplitude", "contact"), (False, False, False), _ridge,
    ((0.6, 0.0, 0.0, 0.0, 0.0, 0.6), (0.74, 1.0, 1.0, 1.0, 0.4, 1.0)), 1 << 17, (0.667, 0.5, 0.2, 0.5, 0.141, 0.85),
)  # fmt: skip
CASES = (
    WindowCase("grazing", ("grazing", "misfit"), (True, False), _grazing),
    WindowCase("flip", ("multiplier", "amplitude", "phase"), (True, False, False), _flip),
    WindowCase("fold", ("misfit", "phase"), (False, False), _fold),
    RIDGE,
)


def sobol(number: int, seed: int) -> np.ndarray:
    """Scrambled Sobol points (number, 6); the number is a power of two."""
    return qmc.Sobol(DIM, seed=seed).random(number)
