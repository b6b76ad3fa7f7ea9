"""Emulated region: the probability that a point is admissible, from an emulator of each margin."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from calib.confidence.window.emulated_margin import EmulatedMargin, emulated_margin, kind_margin
from calib.confidence.window.observed import KIND_MARGIN, Observed

EXPLAINED_PROBABILITY = 0.5  # of a kind's margins being positive, below which they explain another kind  [1]
BOUNDARY_PERFORMANCE = 3.0  # standard deviations by which a margin may exceed its mean; performance on the boundary


@dataclass(frozen=True, eq=False)
class Region:
    """Emulated region of the unit cube in which all margins are positive; there may be none.

    Attributes
    ----------
    margins : emulators of all of them, that of the kind among them where other margins do not explain it
    """

    margins: tuple[EmulatedMargin, ...]

    @property
    def labels(self) -> tuple[str, ...]:
        """What may bound the region."""
        return tuple(margin.label for margin in self.margins)

    def met(self, points: np.ndarray) -> np.ndarray:
        """Probability (m, margins) that each margin is positive at points (m, dim)."""
        columns = []
        for margin in self.margins:
            mean, std = margin.predicted(points)
            columns.append(ndtr(mean / std))
        return np.column_stack(columns) if columns else np.ones((len(points), 0))

    def probability(self, points: np.ndarray) -> np.ndarray:
        """Probability (m,) that points (m, dim) are admissible."""
        return self.met(points).prod(axis=1)

    def performance(self, points: np.ndarray) -> np.ndarray:
        """Performance function (m,) of points (m, dim): it rises from the farthest outside to the surest inside.

        Far outside a probability is not to be trusted: its logarithm tells where the emulators are unsure, and leads
        nowhere. There the least margin counts, as high as it may be, which rises all the way to the boundary. From
        where all may be positive the least of their ratios to their standard deviations counts: where that is zero, the
        function is `BOUNDARY_PERFORMANCE`.
        """
        optimistic, ratio = np.full(len(points), np.inf), np.full(len(points), np.inf)
        for margin in self.margins:
            mean, std = margin.predicted(points)
            optimistic = np.minimum(optimistic, (mean + BOUNDARY_PERFORMANCE * std) / margin.scale)
            ratio = np.minimum(ratio, mean / std)
        return np.where(optimistic < 0.0, optimistic, BOUNDARY_PERFORMANCE + ratio)

    def kind(self, points: np.ndarray) -> np.ndarray:
        """Probability (m,) that the motion is of the measured kind at points (m, dim)."""
        met = self.met(points)
        return met[:, [margin.of_kind for margin in self.margins]].prod(axis=1)

    def draws(self, points: np.ndarray, number: int, seed: int) -> np.ndarray:
        """Draws (number, m) of whether points (m, dim) are admissible, jointly."""
        inside = np.ones((number, len(points)), dtype=bool)
        for k, margin in enumerate(self.margins):
            inside &= margin.draws(points, number, seed + k) > 0
        return inside


def emulated(observed: Observed, held: Region | None = None) -> Region | None:
    """Emulate the region from what was observed; None where no point is of the measured kind, or they are too few.

    Parameters
    ----------
    held : a region of fewer points, whose axes, hyperparameters, trends and powers are taken over
    """
    known = {} if held is None else {margin.label: margin for margin in held.margins}
    margins = []
    for k, (label, of_kind) in enumerate(zip(observed.labels, observed.of_kind, strict=True)):
        shown = observed.right & np.isfinite(observed.margins[:, k])
        points, values = observed.points[shown], observed.margins[shown, k]
        margins.append(emulated_margin(label, of_kind, points, values, known.get(label)))
    region = Region(_explaining([margin for margin in margins if margin is not None], observed.points[~observed.right]))
    unexplained = ~observed.right
    if unexplained.any():
        unexplained[unexplained] = region.kind(observed.points[unexplained]) > EXPLAINED_PROBABILITY
    if unexplained.any() and observed.right.any():
        used = observed.right | unexplained
        own = kind_margin(observed.points[used], observed.right[used], known.get(KIND_MARGIN))
        region = Region((*region.margins, *([] if own is None else [own])))
    return region if region.margins else None


def _explaining(margins: Sequence[EmulatedMargin], wrong: np.ndarray) -> tuple[EmulatedMargin, ...]:
    """Margins without those of a kind that explain none of the points (k, dim) of another kind.

    The clearance of a motion, say, falls to zero also where an impact appears and the kind stays.
    """
    return tuple(
        margin
        for margin in margins
        if not margin.of_kind or (len(wrong) and (Region((margin,)).probability(wrong) < EXPLAINED_PROBABILITY).any())
    )
