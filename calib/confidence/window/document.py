"""The result of a window: what window.json holds."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from calib.modelling.parameter import Window
from calib.store.document import read_document, write_document
from calib.store.plain import plain, typed
from calib.study.result import FailureSummary

WINDOW_FILE = "window.json"
WINDOW_END = "end of the window"  # what bounds a parameter that stays admissible to the end of the study's window


@dataclass(frozen=True)
class ParameterTolerance:
    """How far a parameter may vary; numbers in SI.

    Attributes
    ----------
    name, unit, value : of the parameter, at the centre
    alone_low, alone_high : admissible values while all others stay
    alone_low_cause, alone_high_cause : what bounds the window at these ends
    together_low, together_high : side of the largest box inside; None where there is none
    low_mechanisms, high_mechanisms : what bounds the window towards low and high values, anywhere -> share
    """

    name: str
    unit: str
    value: float
    alone_low: float
    alone_high: float
    alone_low_cause: str
    alone_high_cause: str
    together_low: float | None = None
    together_high: float | None = None
    low_mechanisms: Mapping[str, float] = field(default_factory=dict)
    high_mechanisms: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class EllipsoidResult:
    """Largest ellipsoid inside, in the unit cube of the windows.

    Attributes
    ----------
    centre : (dim,)
    root : (dim, dim) lower triangular; its points are centre + root w with |w| <= 1
    share : of the admissible volume  [1]
    """

    centre: tuple[float, ...]
    root: tuple[tuple[float, ...], ...]
    share: float


@dataclass(frozen=True)
class KindShare:
    """Evaluated points of one kind of motion or status, and whether they are of the measured kind."""

    motion: str
    measured: bool
    points: int


@dataclass(frozen=True)
class ExactFaces:
    """What continuation finds over the slice of two parameters, and how far the emulated boundary is from it.

    Attributes
    ----------
    first, second : parameters; the others are at their calibrated values
    kinds : of the curves: fold, flip, grazing
    distance : largest one of the emulated boundary, where the kind of motion changes, from the nearest curve, in widths
        of the study's windows  [1]; None where there is no such boundary or no curve
    reason : why there is no curve, "" where there is one
    """

    first: str
    second: str
    kinds: tuple[str, ...]
    distance: float | None
    reason: str = ""


@dataclass(frozen=True)
class WindowResult:
    """Where in the box of the parameters the model behaves as was measured; numbers in SI.

    Attributes
    ----------
    name : of the study
    windows, units : of each parameter: the box
    measured_kind : record -> kind of the measured motion
    tolerances : term -> largest distance of an admissible point  [1]
    calibrated : values of the calibrated point, about which parameters vary
    points, simulations, seed : that were evaluated; runs of the simulator that they took; of everything random
    admissible_points : of them
    share, share_low, share_high : of the box that is admissible, with its 95 % interval, but for parts that no point
        has met  [1]
    misclassified : expected share of the box on the wrong side of the boundary  [1]
    mechanisms : what bounds the window -> share of its boundary, the end of the box included
    parameters : tolerance of each
    box_share : volume of the largest box inside over the admissible volume  [1]; None where there is no box
    ellipsoid : None where there is none
    kinds : of the evaluated points, the most frequent first
    failures : why simulations failed, the most frequent cause first
    remarks : what to mind, a sentence each, without its full stop
    exact : each slice against continued curves; empty where these were not asked for
    seconds : wall-clock time of this run  [s]
    """

    name: str
    windows: Mapping[str, Window]
    units: Mapping[str, str]
    measured_kind: Mapping[str, str]
    tolerances: Mapping[str, float]
    calibrated: Mapping[str, float]
    points: int
    simulations: int
    seed: int
    admissible_points: int
    share: float
    share_low: float
    share_high: float
    misclassified: float
    mechanisms: Mapping[str, float] = field(default_factory=dict)
    parameters: tuple[ParameterTolerance, ...] = ()
    box_share: float | None = None
    ellipsoid: EllipsoidResult | None = None
    kinds: tuple[KindShare, ...] = ()
    failures: tuple[FailureSummary, ...] = ()
    remarks: tuple[str, ...] = ()
    exact: tuple[ExactFaces, ...] = ()
    seconds: float = 0.0

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> "WindowResult":
        """Return the result that a JSON object describes."""
        return typed(cls, document)

    def as_dict(self) -> dict[str, Any]:
        """Return the object of window.json, which `json.dumps(..., allow_nan=False)` takes."""
        return plain(self)


def write_window(result: WindowResult, folder: Path) -> None:
    """Write what `read_window` reads."""
    write_document(result.as_dict(), folder / WINDOW_FILE)


def read_window(folder: Path) -> WindowResult | None:
    """Return what the window.json of a folder says, None where there is none.

    Raises
    ------
    CalibError : the file describes none
    """
    return read_document(folder / WINDOW_FILE, WindowResult.from_dict, "window", "calib window")
