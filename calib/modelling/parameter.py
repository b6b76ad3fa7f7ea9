"""Parameters, the windows they are searched in, and the unit cube that an optimiser sees."""

import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from calib.errors import CalibError

Scale = Literal["linear", "log"]
ABOVE_ZERO = sys.float_info.min  # least normal number: `low` of a parameter that excludes zero  [its unit]


@dataclass(frozen=True)
class Parameter:
    """One named number of a model, in SI.

    `null` is the value at which the parameter has no influence (None where there is no such value);
    `low` and `high` bound the values that make sense at all, whatever a study's window says; both are among them, and
    `low` is ABOVE_ZERO where zero is not, as for a length by which a law divides.
    """

    name: str
    unit: str
    nominal: float
    meaning: str
    kind: Literal["physical", "numerical"] = "physical"
    null: float | None = None
    low: float = -math.inf
    high: float = math.inf

    def admits(self, value: float) -> bool:
        """Whether the parameter may have a value [its unit]: a finite one within the bounds, or its null."""
        return value == self.null or (math.isfinite(value) and self.low <= value <= self.high)

    @property
    def interval(self) -> str:
        """The bounds as text, such as "[0, 1]", or "(0, inf)" where neither is among the values  [its unit]."""
        low = "(0" if self.low == ABOVE_ZERO else f"{'(' if math.isinf(self.low) else '['}{self.low:g}"
        return f"{low}, {self.high:g}{')' if math.isinf(self.high) else ']'}"


@dataclass(frozen=True)
class Window:
    """The interval [low, high] in which a parameter is searched, on a linear or a logarithmic scale."""

    low: float
    high: float
    scale: Scale = "linear"

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and math.isfinite(self.high)):
            raise CalibError(f"a window needs two finite ends, got low = {self.low:g}, high = {self.high:g}")
        if self.low == self.high:
            raise CalibError(f"the window has no width (low = high = {self.low:g}); widen it, or fix the value")
        if self.low > self.high:
            raise CalibError(f"the window is the wrong way round: low = {self.low:g} lies above high = {self.high:g}")
        if self.scale not in get_args(Scale):
            raise CalibError(f"a window's scale is 'linear' or 'log', got {self.scale!r}")
        if self.scale == "log" and self.low <= 0.0:
            raise CalibError(f"a log window needs low > 0, got {self.low:g}; give a small positive low end")

    def value(self, u: float) -> float:
        """Value at position `u` in [0, 1]; the two ends are returned exactly."""
        if u <= 0.0:
            return self.low
        if u >= 1.0:
            return self.high
        if self.scale == "log":
            return math.exp((1.0 - u) * math.log(self.low) + u * math.log(self.high))
        return (1.0 - u) * self.low + u * self.high

    def position(self, value: float) -> float:
        """Position of `value` [the window's unit] in the window, 0 at low and 1 at high [1]."""
        if self.scale == "log":
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)

    def check(self, start: float) -> None:
        """Refuse a starting value  [the window's unit]  that is not in the window."""
        if not self.low <= start <= self.high:
            raise CalibError(f"the starting value {start:g} lies outside the window [{self.low:g}, {self.high:g}]")

    def slope(self, value: float) -> float:
        """Slope of the value over its position in the window, at `value`  [the window's unit]."""
        return value * math.log(self.high / self.low) if self.scale == "log" else self.high - self.low


@dataclass(frozen=True)
class Space:
    """The unit cube of the searched parameters (in the order of `windows`) beside the fixed ones, all in SI.

    `start` holds starting values of searched parameters by name: the first trial is made there.
    """

    windows: Mapping[str, Window]
    fixed: Mapping[str, float] = field(default_factory=dict)
    start: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, value in self.start.items():
            if name not in self.windows:
                raise CalibError(f"{name!r} has a starting value and no window; searched are {list(self.windows)}")
            self.windows[name].check(value)
        both = sorted(set(self.windows) & set(self.fixed))
        if both:
            raise CalibError(f"{both} stand both in [windows] and in [model] fixed; keep one of them")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the searched parameters, in the order of the cube's axes."""
        return tuple(self.windows)

    @property
    def dim(self) -> int:
        """Number of searched parameters."""
        return len(self.windows)

    @property
    def starting_point(self) -> np.ndarray | None:
        """Point (dim,) of the unit cube at which a search starts: the middle along axes without a starting value.

        None where no parameter has one.
        """
        if not self.start:
            return None
        middle = {name: window.value(0.5) for name, window in self.windows.items()}
        return self.point({**middle, **self.start})

    def values(self, u: np.ndarray) -> dict[str, float]:
        """Return every searched and fixed parameter by name at the point `u` (dim,) of the unit cube."""
        u = np.asarray(u, dtype=float)
        if u.shape != (self.dim,):
            raise CalibError(f"expected a point of shape ({self.dim},) for {self.names}, got shape {u.shape}")
        searched = {name: window.value(float(x)) for (name, window), x in zip(self.windows.items(), u, strict=True)}
        return {**self.fixed, **searched}

    def point(self, values: Mapping[str, float]) -> np.ndarray:
        """Point (dim,) of the unit cube that belongs to `values`; a value outside its window lands on its edge."""
        missing = sorted(set(self.names) - set(values))
        if missing:
            raise CalibError(f"values for {missing} are missing; the searched parameters are {list(self.names)}")
        return np.array([min(1.0, max(0.0, w.position(values[name]))) for name, w in self.windows.items()])

    def around(self, values: Mapping[str, float], shrink: float) -> "Space":
        """Windows `shrink` times as wide (on their own scale) about `values`, inside the present ones."""
        u = self.point(values)
        half = 0.5 * min(1.0, shrink)
        centre = np.clip(u, half, 1.0 - half)
        windows = {
            name: Window(w.value(c - half), w.value(c + half), w.scale)
            for (name, w), c in zip(self.windows.items(), centre, strict=True)
        }
        return Space(windows, self.fixed)


def values_for(values: Mapping[str, float], record: str) -> dict[str, float]:
    """Values that hold for one record: ``"name@record"`` takes the place of ``"name"``, other records' are left out."""
    general = {name: value for name, value in values.items() if "@" not in name}
    own = {n.partition("@")[0]: value for n, value in values.items() if n.endswith(f"@{record}")}
    return general | own
