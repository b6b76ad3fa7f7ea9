"""Which measured scalar features the trials of a study come near to, and how near."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from calib.store import Trial
from calib.units import shown

REQUIRED = frozenset(("label", "record", "body", "unit", "measured", "simulated", "tolerance"))  # keys of a feature
MAX_ZERO_SHARE = 1e-9  # of what was measured: a simulated value below that is rounding, told as 0  [1]


@dataclass(frozen=True)
class UnreachableFeature:
    """A measured scalar feature that no trial reaches.

    Attributes
    ----------
    feature, record, body, unit : which feature, of which record and body, in which unit
    measured : value  [unit]
    nearest : the simulated value nearest to it, None where no trial shows the feature  [unit]
    off : how far the measured value lies outside the range of the simulated ones  [unit]
    percent : the same in per cent of the measured value, None where that is zero
    """

    feature: str
    record: str = ""
    body: str = ""
    unit: str = "1"
    measured: float | None = None
    nearest: float | None = None
    off: float | None = None
    percent: float | None = None

    def __str__(self) -> str:
        """Which feature it is, and how far off the nearest value is."""
        off = "" if self.percent is None else f" ({self.percent:.3g} % off)"
        measured, nearest = shown(self.measured, self.unit), shown(self.nearest, self.unit)
        return f"{self.feature} of {self.body} in {self.record}: measured {measured}, nearest {nearest}{off}"


@dataclass(frozen=True)
class Reach:
    """How near the trials come to one measured scalar feature.

    Attributes
    ----------
    label, record, body, unit : which feature, of which record and body, in which unit
    measured, tolerance : what was measured, to be met within the tolerance  [unit]
    low, high : range of the simulated values over the trials that ended ok; None where none shows the feature  [unit]
    nearest : the simulated value nearest to the measured one, or None  [unit]
    off : how far the measured value lies outside the range, 0 inside it, None without one  [unit]
    reached : whether it lies in the range within its tolerance
    """

    label: str
    record: str
    body: str
    unit: str
    measured: float
    tolerance: float
    low: float | None
    high: float | None
    nearest: float | None
    off: float | None
    reached: bool

    @property
    def percent(self) -> float | None:
        """`off` in per cent of the measured value, None where there is no such number."""
        return None if self.off is None or not self.measured else 100.0 * self.off / abs(self.measured)

    def summary(self) -> UnreachableFeature:
        """Return what a result says of the feature where it is not reached."""
        return UnreachableFeature(
            self.label, self.record, self.body, self.unit, self.measured, self.nearest, self.off, self.percent
        )


def reach(trials: Iterable[Trial]) -> list[Reach]:
    """How near the trials that ended ok come to each measured scalar feature."""
    by_feature: dict[tuple[str, str, str], list[Mapping[str, Any]]] = {}
    for trial in trials:
        for feature in trial.features:
            if feature.keys() >= REQUIRED and feature["measured"] is not None:
                by_feature.setdefault((feature["label"], feature["record"], feature["body"]), []).append(feature)
    return [_reach(features) for features in by_feature.values()]


def _reach(features: Sequence[Mapping[str, Any]]) -> Reach:
    first = features[0]
    known = {key: first[key] for key in ("label", "record", "body", "unit", "measured")}
    measured, tolerance = first["measured"], first["tolerance"] or 0.0
    simulated = [feature["simulated"] for feature in features if feature["simulated"] is not None]
    if not simulated:
        return Reach(**known, tolerance=tolerance, low=None, high=None, nearest=None, off=None, reached=False)
    off = max(0.0, min(simulated) - measured, measured - max(simulated))
    nearest = min(simulated, key=lambda value: abs(value - measured))
    return Reach(
        **known,
        tolerance=tolerance,
        low=min(simulated),
        high=max(simulated),
        nearest=0.0 if abs(nearest) < MAX_ZERO_SHARE * abs(measured) else nearest,
        off=off,
        reached=off <= tolerance,
    )
