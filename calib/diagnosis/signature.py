"""How the simulations change with a parameter: differences whose steps are fitted to the noise, two of them compared.

A step is chosen so that it moves all records together by a share of one standard deviation of the noise, as a z of that
size would: that is where the effect has to be told from nothing. Where a step and its triple disagree by more than a
tenth, no derivative is claimed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calib.diagnosis.bench import Run, Seen, Start, simulated
from calib.diagnosis.evidence import Evidence
from calib.effect import Effect
from calib.study import Pool

FIRST = 1e-4  # of the natural scale
TARGET = 0.3  # response that a step should make, in standard deviations
NEAR = 10.0  # factor by which it may miss that
TRIPLE = 3.0
AGREE = 0.10  # relative difference of two slopes that are called equal
FAINT = 1e-4  # response that is rounding
TRIES = 3  # steps until the response is near its target
BOUNDS = 1e-9, 0.3  # of the natural scale


@dataclass(frozen=True, eq=False)
class Direction:
    """A parameter along which simulations are differenced.

    Attributes
    ----------
    name : of the parameter
    at : where  [its unit]
    scale : natural scale  [its unit]
    low, high : values that make sense
    effects : beyond the ones that the point has
    values : of those effects, at the point
    """

    name: str
    at: float
    scale: float
    low: float
    high: float
    effects: tuple[Effect, ...] = ()
    values: Mapping[str, float] | None = None

    def step(self, size: float) -> float:
        """Signed step of this size: away from the bound that it would cross; where it crosses both, to the farther."""
        above, below = self.high - self.at, self.at - self.low
        if size <= above:
            return size
        if size <= below:
            return -size
        return above if above >= below else -below


@dataclass(frozen=True, eq=False)
class Slope:
    """Change of the records with a parameter.

    Attributes
    ----------
    column : (N,) per unit of the parameter, in units of the noise; None where there is none
    step : that it was taken with  [unit of the parameter]
    reliable : whether two steps agree
    doubt : by how much they differ, relative
    reason : why it is not
    """

    column: np.ndarray | None
    step: float
    reliable: bool
    reason: str = ""
    doubt: float = 0.0


@dataclass(frozen=True, eq=False)
class Point:
    """A point of a model with its simulations."""

    values: Mapping[str, float]
    effects: tuple[Effect, ...]
    seen: Mapping[str, Seen]

    def runs(
        self,
        names: Sequence[str],
        values: Mapping[str, float] | None = None,
        effects: Sequence[Effect] = (),
        starts: Mapping[str, Start | None] | None = None,
    ) -> list[Run]:
        """Runs of the records at other values, from the states of this point.

        starts : by record, initial states in the place of those of this point, where these are nuisances; of None they
            are solved for
        """
        changed, effects = {**self.values, **(values or {})}, (*self.effects, *effects)
        seen = [(name, self.seen[name]) for name in names]
        return [
            Run(name, changed, effects, view.state, start=(starts or {}).get(name, view.start))
            for name, view in seen
        ]


def slopes(
    pool: Pool,
    evidence: Evidence,
    point: Point,
    directions: Sequence[Direction],
    known: Mapping[str, float] | None = None,
    compared: bool = True,
) -> list[Slope]:
    """Difference all records along each direction, side by side.

    Initial states that are nuisances stay: what they would take of a change is projected out of it (Kaufman, BIT 15
    (1975) 49, of variable projection).

    Parameters
    ----------
    known : steps by parameter that were right before  [unit of the parameter]
    compared : whether a second step is taken to see that both agree
    """
    names = evidence.names
    found: dict[int, tuple[float, np.ndarray]] = {}
    reasons: dict[int, str] = {}

    def responses(steps: Mapping[int, float]) -> dict[int, np.ndarray | None]:
        runs = [run for k, h in steps.items() for run in _ahead(point, names, directions[k], h)]
        answers = iter(simulated(pool, runs))
        out = {}
        for k in steps:
            views = {name: next(answers) for name in names}
            bad = next((view for view in views.values() if not view.usable), None)
            if bad is None:
                out[k] = evidence.difference(point.seen, views)
            else:
                out[k], reasons[k] = None, f"{bad.status}: {bad.reason}" if bad.reason else bad.status
        return out

    known = known or {}
    sizes = {k: abs(known.get(d.name, FIRST * d.scale)) for k, d in enumerate(directions)}
    waiting = set(sizes)
    for _ in range(TRIES):
        steps = {k: directions[k].step(sizes[k]) for k in sorted(waiting)}
        for k, moved in responses(steps).items():
            if moved is None:
                sizes[k] /= 10.0
                continue
            length = float(np.linalg.norm(moved))
            found[k] = steps[k], moved
            ideal = sizes[k] * TARGET / max(length, FAINT)
            limit = np.array(BOUNDS) * directions[k].scale
            if length > FAINT and 1.0 / NEAR < length / TARGET < NEAR:
                waiting.discard(k)
            elif sizes[k] >= limit[1] and length < TARGET:
                waiting.discard(k)  # as far as it goes
            else:
                sizes[k] = float(np.clip(ideal, *limit))
        if not waiting:
            break
    lost = [Slope(None, 0.0, False, reasons.get(k, "no step")) for k in range(len(directions))]
    if not compared:
        known = {k: Slope(change / step, step, True) for k, (step, change) in found.items()}
        return [known.get(k, slope) for k, slope in enumerate(lost)]
    second = {k: directions[k].step(TRIPLE * abs(step)) for k, (step, _) in found.items()}
    again = responses(second)
    return [
        _compared(found[k], second[k], again[k], reasons.get(k, "")) if k in found else lost[k]
        for k in range(len(directions))
    ]


def _compared(first: tuple[float, np.ndarray], step: float, moved: np.ndarray | None, reason: str) -> Slope:
    small, change = first
    slope = change / small
    if np.linalg.norm(change) <= FAINT:
        return Slope(np.zeros_like(slope), small, True, "it does not show in any record")
    if moved is None or abs(step) <= abs(small):
        return Slope(slope, small, False, reason or "there is no room for a second step")
    other = moved / step
    apart = np.linalg.norm(other - slope) / max(np.linalg.norm(slope), np.linalg.norm(other))
    if apart > AGREE:
        return Slope(slope, small, False, f"two steps give slopes that differ by {apart:.0%}", apart)
    return Slope(slope, small, True, doubt=apart)


def _ahead(point: Point, names: Sequence[str], direction: Direction, step: float) -> list[Run]:
    values = {**(direction.values or {}), direction.name: direction.at + step}
    return point.runs(names, values, direction.effects)
