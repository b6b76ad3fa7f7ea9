"""One evaluated point of a study, and its line in the ledger."""

import json
import math
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from calib.modelling.parameter import Window
from calib.records import DETAILS, OK
from calib.store.plain import plain
from calib.store.residuals import ResidualsOfTrial, StoredResiduals
from calib.store.scalar_features import ScalarFeatures

MAX_REASON_CHARACTERS = 400  # of a trial's reason, what marks the cut included
CUT_MARK = " ..."
KEYS = frozenset(  # of a line, without its check sum
    ("number", "phase", "u", "values", "total", "terms", "status", "reason", "kind", "seconds", "residuals")
    + ("features", "simulations")
)
MAX_COUNT = 2**63  # that a line states; a larger integer is no number either
MAX_VALUE_ERROR = 1e-9  # of a value from that of its point, relative; logarithms differ by less between processors
VARYING_NUMBER = re.compile(r"(?<!signal )(?<!exit code )[-+]?\d[\d.]*(?:e[-+]?\d+)?")  # in a reason
FORMER_CODE = "former code"  # status of trials by code that has changed since


@dataclass(frozen=True)
class Trial:
    """One point, evaluated on all calibration records.

    Attributes
    ----------
    number : asking number, from 0; the screen's points come first
    u : the point in the unit cube, in the order of the study's windows
    values : every searched and fixed parameter by name, in SI
    cost : what the optimiser minimises; infinity where the evaluation failed
    terms : distance of each term by its label
    status : "ok" or why there is no score
    reason : one line on the status
    kind : kind of the simulated motion, as the objective calls it
    seconds : wall-clock time of the evaluation  [s]
    phase : "screen" or "search"
    features : scalar features, each a dict with label, record, body, unit, measured, simulated, tolerance
    residuals : (n,) float64, or None where the evaluation failed
    segment : of the ledger, counted from 0; a new one begins where libraries, processor or code changed
    simulations : runs of the simulator; None where they were not counted: one for each record
    former_cost : cost by code that the study no longer uses, in the place of `cost`
    """

    number: int
    u: list[float]
    values: dict[str, float]
    cost: float
    terms: dict[str, float] = field(default_factory=dict)
    status: str = OK
    reason: str = ""
    kind: str | None = None
    seconds: float = 0.0
    phase: Literal["screen", "search"] = "search"
    features: Sequence[Mapping[str, Any]] = field(default_factory=list)
    residuals: ResidualsOfTrial = field(default=ResidualsOfTrial(), compare=False, repr=False)
    segment: int = 0
    simulations: int | None = None
    former_cost: float = math.inf

    @property
    def scored(self) -> bool:
        """Whether the evaluation gave a score."""
        return math.isfinite(self.cost)

    @property
    def cause(self) -> str:
        """Reason without what differs between trials that fail for the same: details and numbers."""
        return VARYING_NUMBER.sub("…", self.reason.partition(DETAILS)[0])

    def superseded(self) -> "Trial":
        """Return the trial as one that code which the study no longer uses has evaluated: it has no score."""
        reason = f"logged at a distance of {self.cost:.4g}" if self.scored else f"logged as {self.status}"
        return replace(
            self,
            cost=math.inf,
            terms={},
            status=FORMER_CODE,
            reason=f"{reason} by code that has changed since",
            kind=None,
            features=[],
            residuals=None,
            former_cost=self.cost,
        )

    def compact(self, residuals: StoredResiduals | None) -> "Trial":
        """Return the same in little memory: residuals in the side file, what many trials share in memory once."""
        return replace(
            self,
            values=_shared(self.values),
            terms=_shared(self.terms),
            status=sys.intern(self.status),
            kind=None if self.kind is None else sys.intern(self.kind),
            features=ScalarFeatures(self.features),
            residuals=residuals,
        )

    @property
    def rank(self) -> tuple[float, int]:
        """Key of comparison: the lowest cost, the earliest among equals."""
        return (self.cost, self.number)

    def contradiction(self, windows: Mapping[str, Window]) -> str | None:
        """Return how the values contradict the point in these windows, None where they agree.

        Raises
        ------
        ValueError, KeyError, TypeError : the point has another number of coordinates, or a value is missing
        """
        for (name, window), coordinate in zip(windows.items(), self.u, strict=True):
            if not 0.0 <= coordinate <= 1.0:
                return f"the coordinate of {name} in the unit cube is {coordinate!r}"
            value, expected = self.values[name], window.value(coordinate)
            size = 0.0 if window.scale == "log" else max(abs(window.low), abs(window.high))
            if not math.isclose(value, expected, rel_tol=MAX_VALUE_ERROR, abs_tol=MAX_VALUE_ERROR * size):
                return f"{name} is {value!r}, but {expected!r} at its point in the unit cube"
        return None


def best(trials: Iterable[Trial]) -> Trial | None:
    """Trial with the lowest finite cost, the earliest among equals; None where all failed."""
    scored = [trial for trial in trials if trial.scored]
    return min(scored, key=lambda trial: trial.rank, default=None)


def failures(trials: Iterable[Trial]) -> list[list[Trial]]:
    """Trials that failed, those of one status and cause together in their order; the most frequent cause first."""
    groups: dict[tuple[str, str], list[Trial]] = {}
    for trial in trials:
        if trial.status != OK:
            groups.setdefault((trial.status, trial.cause), []).append(trial)
    return sorted(groups.values(), key=len, reverse=True)


def one_line(reason: str) -> str:
    """Return a reason as a trial states it: on one line, of at most `MAX_REASON_CHARACTERS`, that UTF-8 can hold.

    Half a surrogate pair, as in output of a program that is not UTF-8, becomes its escape sequence.
    """
    encodable = reason.encode("utf-8", "backslashreplace").decode("utf-8")
    text = " ".join(filter(None, (part.strip() for part in encodable.splitlines())))
    if len(text) <= MAX_REASON_CHARACTERS:
        return text
    return text[: MAX_REASON_CHARACTERS - len(CUT_MARK)] + CUT_MARK


def line(trial: Trial, place: tuple[int, int] | None) -> str:
    """JSON of a trial without line end; `place` is (offset, length) of its residuals in the side file, in numbers.

    Floats are written so that reading them gives the same bits; infinity and NaN as null.
    """
    content = {
        "number": trial.number,
        "phase": trial.phase,
        "u": [float(x) for x in trial.u],
        "values": trial.values,
        "total": trial.cost,
        "terms": trial.terms,
        "status": trial.status,
        "reason": trial.reason,
        "kind": trial.kind,
        "seconds": round(trial.seconds, 6),
        "residuals": place,
        "features": list(trial.features),
        "simulations": trial.simulations,
    }
    return json.dumps(plain(content), allow_nan=False, separators=(",", ":"))


def trial_of(content: Mapping[str, Any], residuals: StoredResiduals | None, segment: int) -> Trial:
    """Trial of a ledger line's JSON; a null score reads as infinity.

    Raises
    ------
    KeyError, TypeError, AttributeError : the line is not that of a trial
    """
    for key in ("status", "reason", "phase"):
        if not isinstance(content[key], str):
            raise TypeError(f"{key} is no text")
    _check_numbers(content)
    return Trial(
        number=content["number"],
        u=content["u"],
        values=_shared(content["values"]),
        cost=_score(content["total"]),
        terms={sys.intern(label): _score(value) for label, value in content["terms"].items()},
        status=sys.intern(content["status"]),
        reason=content["reason"],
        kind=content["kind"],
        seconds=content["seconds"],
        phase=content["phase"],
        features=ScalarFeatures(content["features"]),
        residuals=residuals,
        segment=segment,
        simulations=content.get("simulations"),
    )


def _check_numbers(content: Mapping[str, Any]) -> None:
    """Check what has to be a number."""
    numbers = [content["seconds"], *content["u"], *content["values"].values()]
    scores = [value for value in (content["total"], *content["terms"].values()) if value is not None]
    if not all(map(_is_number, numbers + scores)):
        raise TypeError("a text or a list in the place of a number")
    simulations = content.get("simulations")
    counts = [content["number"], 0 if simulations is None else simulations]
    if not all(type(count) is int and 0 <= count <= MAX_COUNT for count in counts):
        raise TypeError("a number is no count")
    if content["kind"] is not None and not isinstance(content["kind"], str):
        raise TypeError("kind is no text")


def _is_number(value: Any) -> bool:
    return type(value) is float or type(value) is int and abs(value) <= MAX_COUNT


def _shared(entries: Mapping[str, Any]) -> dict[str, Any]:
    """Return the same, its keys and texts held once in memory for all trials."""
    return {sys.intern(key): sys.intern(value) if isinstance(value, str) else value for key, value in entries.items()}


def _score(value: float | None) -> float:
    return math.inf if value is None else value
