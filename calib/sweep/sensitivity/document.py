"""The result of a sensitivity: what sensitivity.json holds."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from calib.modelling.parameter import Window
from calib.store.document import read_document, write_document
from calib.store.plain import plain, typed
from calib.study.result import FailureSummary

FILE_NAME = "sensitivity.json"
KIND, STATUS, RESIDUAL, FEATURE = "kind", "status", "residual", "feature"  # what an output is
ELEMENTARY_EFFECTS, SALTELLI, GIVEN_DATA = "elementary effects", "Saltelli", "given data"  # estimators


@dataclass(frozen=True)
class Estimate:
    """An estimated number with its 95 % bootstrap interval [low, high]."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Influence:
    """Influence of a parameter on an output.

    Attributes
    ----------
    parameter : its name
    mu_star, mu, sigma : of Morris: mean of the sizes of the elementary effects, their mean, and their standard
        deviation, each the change of the output over the whole window  [unit of the output]
    first, total : of Sobol: share of the variance of the output that the parameter causes alone, and with its
        interactions  [1]
    count : elementary effects, or points, that it was estimated from
    reason : why there is no estimate; empty where there is
    """

    parameter: str
    mu_star: Estimate | None = None
    mu: Estimate | None = None
    sigma: Estimate | None = None
    first: Estimate | None = None
    total: Estimate | None = None
    count: int = 0
    reason: str = ""

    @property
    def strength(self) -> Estimate | None:
        """By what parameters are ranked: mu_star; else the total index, or the first one where there is no total."""
        return self.mu_star or self.total or self.first


@dataclass(frozen=True)
class OutputSensitivity:
    """Influence of every parameter on one output.

    Attributes
    ----------
    label : such as "displacement amplitude"
    of : "kind" or "status" (1 where the motion is of the measured kind, or the simulation ended well, else 0),
        "residual" (distance of a term from the measurement) or "feature" (a scalar of the simulated motion)
    unit, record, body : of the output; record and body are empty where it is of all
    estimator : "elementary effects", "Saltelli" (all points show the output) or "given data" (some do not: first is the
        share of the variance that the mean over the parameter's rank has among the points that do, total is from pairs
        both of whose points do)
    points : that show the output: all for a kind or a status, else at most those of the measured kind
    deviation : standard deviation of the output over them  [unit]
    influences : of each parameter
    reason : why there are no influences; empty where there are some
    """

    label: str
    of: str
    unit: str = "1"
    record: str = ""
    body: str = ""
    estimator: str = ""
    points: int = 0
    deviation: float | None = None
    influences: tuple[Influence, ...] = ()
    reason: str = ""

    def ranked(self) -> list[Influence]:
        """Return the influences that were estimated, the strongest first."""
        known = [one for one in self.influences if one.strength is not None]
        return sorted(known, key=lambda one: -one.strength.value if one.strength is not None else 0.0)


@dataclass(frozen=True)
class MotionShare:
    """Share of the points whose simulation is a kind of motion, or ended with a status.

    Attributes
    ----------
    motion : kind of motion, or the status where the simulation failed
    measured : whether it is of the measured kind
    failed : whether the simulation failed
    points : number of points
    share : of all points, with Wilson's interval as of so many independent points as there are groups  [1]
    """

    motion: str
    measured: bool
    failed: bool
    points: int
    share: Estimate


@dataclass(frozen=True)
class SensitivityResult:
    """Which parameter moves which feature of the motion; numbers in SI.

    Attributes
    ----------
    name : of the study
    method : "morris" or "sobol"
    windows, units : of each parameter, in the order of the influences; values are drawn evenly on the window's scale
    groups : trajectories, or base samples
    seed : of the design and the bootstrap
    points, simulations : that were evaluated; runs of the simulator that they took
    measured_kind : record -> kind of the measured motion
    shares : of the kinds of motion and statuses, the most frequent first
    outputs : what the parameters influence
    failures : why simulations failed, the most frequent cause first
    remarks : what to mind, a sentence each, without its full stop
    """

    name: str
    method: str
    windows: Mapping[str, Window]
    units: Mapping[str, str]
    groups: int
    seed: int
    points: int
    simulations: int
    measured_kind: Mapping[str, str]
    shares: tuple[MotionShare, ...] = ()
    outputs: tuple[OutputSensitivity, ...] = ()
    failures: tuple[FailureSummary, ...] = ()
    remarks: tuple[str, ...] = field(default=())

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(self.windows)

    @property
    def measured_share(self) -> float:
        """Share of the points whose motion is of the measured kind  [1]."""
        return sum(one.points for one in self.shares if one.measured) / self.points

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> "SensitivityResult":
        """Return the result that a JSON object describes."""
        return typed(cls, document)

    def as_dict(self) -> dict[str, Any]:
        """Return the object of sensitivity.json, which `json.dumps(..., allow_nan=False)` takes."""
        return plain(self)


def write(result: SensitivityResult, folder: Path) -> Path:
    """Write `sensitivity.json` so that it is either whole or absent; return its path."""
    path = folder / FILE_NAME
    write_document(result.as_dict(), path)
    return path


def read(folder: Path) -> SensitivityResult | None:
    """Return the result in `folder`, None where there is none.

    Raises
    ------
    CalibError : `sensitivity.json` is not JSON, or no result of a sensitivity
    """
    return read_document(
        folder / FILE_NAME, SensitivityResult.from_dict, "result of a sensitivity", "calib sensitivity"
    )
