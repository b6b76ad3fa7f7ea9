"""Derivatives of the simulations by a parameter: differences whose steps are scaled to the noise, two of them compared.

A step is chosen so that the response of all records together is a share of one standard deviation of the noise, as a z
of that size would make: that is where the effect has to be distinguishable from nothing. Differences are one-sided, for
many parameters stand at the end of their range, where their effect is absent. Where a small step changes nothing and a
larger one does, as of an effect whose sign makes no difference, there is no derivative to test. Where a step and its
triple disagree by more than a tenth, the simulations may have numerical noise, as those of contact by time stepping do:
triple steps are tried as long as slopes agree better, or as the larger step has no larger response. Where none agree
within a tenth, no derivative is claimed. The other places that choose a step do so for another purpose: see
`calib.confidence.derivatives`, from which the comparison of slopes comes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calib.confidence.derivatives import MAX_SLOPE_DIFFERENCE, relative_difference
from calib.diagnosis.bench import Run, SimulatedRows, Start, simulated
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.score import Projection
from calib.modelling.effect import Effect
from calib.study import Pool

FIRST_SCALE_STEP = 1e-4  # of the natural scale  [1]
TARGET_RESPONSE = 0.3  # norm of the response that a step should make  [standard deviations of the noise]
MAX_RESPONSE_RATIO = 10.0  # of a response to its target, or of the target to it  [1]
SECOND_STEP_RATIO = 3.0  # of the second step over the first  [1]
MAX_JUMP_RATIO = 1.2  # of the response to the second step over that to the first, where both are one jump  [1]
MIN_RESPONSE = 1e-4  # below it a response is rounding  [standard deviations of the noise]
ZERO_DERIVATIVE = "its derivative is zero where it is absent, but it changes the records at larger sizes"
FAILURE_STEP_REDUCTION = 10.0  # of a step whose simulation fails  [1]
MAX_TRIES = 3  # steps until the response is near its target  [count]
MAX_COMPARISONS = 5  # of the slope by a step with that by its triple  [count]
STEP_BOUNDS = 1e-9, 0.3  # of the natural scale  [1]


@dataclass(frozen=True, eq=False)
class Direction:
    """A parameter along which simulations are differenced.

    Attributes
    ----------
    name : of the parameter
    at : where  [its unit]
    scale : natural scale  [its unit]
    low, high : of its admissible range
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


@dataclass(frozen=True)
class Step:
    """A step with which a derivative was taken.

    Attributes
    ----------
    size : unsigned  [unit of the parameter]
    response : norm  [standard deviations of the noise]
    relative_error : of the slope by it beside what else is fitted, as `Slope.error_beside`  [1]
    """

    size: float
    response: float
    relative_error: float = 0.0


@dataclass(frozen=True, eq=False)
class Slope:
    """Change of the records with a parameter.

    Attributes
    ----------
    column : (N,) per unit of the parameter, in units of the noise; None where there is none
    step : that it was taken with  [unit of the parameter]
    reliable : whether two steps agree
    relative_error : difference of the slopes by both, over their norm  [1]
    reason : why it is not reliable
    error_beside : the same difference of what is left of both beside what else is fitted  [1]
    """

    column: np.ndarray | None
    step: float
    reliable: bool
    reason: str = ""
    relative_error: float = 0.0
    error_beside: float = 0.0

    @property
    def taken(self) -> Step | None:
        """Return the step that it was taken with, and its response; None where there is none to take again."""
        if self.column is None or not self.step:
            return None
        response = abs(self.step) * float(np.linalg.norm(self.column))
        return Step(abs(self.step), response, self.error_beside) if response > MIN_RESPONSE else None


@dataclass(frozen=True, eq=False)
class Point:
    """A point of a model with its simulations.

    Attributes
    ----------
    values : of its parameters, in SI
    effects : beyond those of the calibrated model
    simulated : records by name
    """

    values: Mapping[str, float]
    effects: tuple[Effect, ...]
    simulated: Mapping[str, SimulatedRows]

    def runs(
        self,
        names: Sequence[str],
        values: Mapping[str, float] | None = None,
        effects: Sequence[Effect] = (),
        starts: Mapping[str, Start | None] | None = None,
        to_first_order: bool = False,
    ) -> list[Run]:
        """Runs of the records at other values, from the states of this point.

        starts : by record, initial states in the place of those of this point, where these are nuisances; of None they
            are solved for
        to_first_order : whether the differences from this point are wanted to first order
        """
        changed, effects = {**self.values, **(values or {})}, (*self.effects, *effects)
        views = [(name, self.simulated[name]) for name in names]
        return [
            Run(
                name,
                changed,
                effects,
                view.state,
                start=(starts or {}).get(name, view.start),
                sweeps=view.sweeps,
                to_first_order=to_first_order,
            )
            for name, view in views
        ]


def slopes(
    pool: Pool,
    evidence: Evidence,
    point: Point,
    directions: Sequence[Direction],
    known: Mapping[str, Step] | None = None,
    compared: Literal["all", "new", "none"] = "all",
    absorbed: np.ndarray | None = None,
    together: bool = False,
) -> list[Slope]:
    """Difference all records along each direction, side by side.

    Initial states that are nuisances are held: what they would absorb of a change is projected out of it (Kaufman, BIT
    15 (1975) 49, of variable projection).

    Parameters
    ----------
    known : steps by parameter with which a derivative was taken before
    compared : of which directions the slopes by further steps are compared; "new": of those without a known step whose
        response is what it was
    absorbed : (N, m) changes that are fitted to the records anyway: slopes are compared beside these
    together : whether the directions are of one model, where each is fitted beside the others
    """
    known = known or {}
    responses = _Responses(pool, evidence, point, directions)
    first = _first_responses(responses, directions, known)
    quotients = {k: response / step for k, (step, response) in first.items()}
    errors = {k: _known_error(own, known.get(directions[k].name)) for k, own in first.items()}
    taken = {k: Slope(quotients[k], step, True, error_beside=errors[k] or 0.0) for k, (step, _) in first.items()}
    tried = {k: own for k, own in first.items() if compared == "all" or errors[k] is None}
    if tried and compared != "none":
        beside = {k: [q for j, q in quotients.items() if together and j != k] for k in tried}
        fixed = [] if absorbed is None else [absorbed]
        projections = {k: Projection(np.column_stack([*fixed, *own])) for k, own in beside.items() if fixed or own}
        taken |= _agreeing(responses, tried, projections)
    return [taken.get(k, Slope(None, 0.0, False, responses.reasons.get(k, "no step"))) for k in range(len(directions))]


class _Responses:
    """Responses of all records to steps along directions, simulated side by side.

    Attributes
    ----------
    reasons : number of a direction -> why the simulation of a step failed
    largest : number of a direction -> norm of the largest response so far  [standard deviations of the noise]
    """

    def __init__(self, pool: Pool, evidence: Evidence, point: Point, directions: Sequence[Direction]):
        self.pool, self.evidence, self.point, self.directions = pool, evidence, point, directions
        self.reasons: dict[int, str] = {}
        self.largest: dict[int, float] = {}

    def __call__(self, steps: Mapping[int, float]) -> dict[int, np.ndarray | None]:
        """Change (N,) of the records by a step along each of the directions, None where a simulation fails."""
        names = self.evidence.names
        runs = [run for k, step in steps.items() for run in _runs(self.point, names, self.directions[k], step)]
        answers = iter(simulated(self.pool, runs))
        responses: dict[int, np.ndarray | None] = {}
        for k in steps:
            views = {name: next(answers) for name in names}
            bad = next((view for view in views.values() if not view.usable), None)
            if bad is None:
                response = self.evidence.difference(self.point.simulated, views)
                self.largest[k] = max(self.largest.get(k, 0.0), float(np.linalg.norm(response)))
                responses[k] = response
            else:
                responses[k], self.reasons[k] = None, f"{bad.status}: {bad.reason}" if bad.reason else bad.status
        return responses


def _first_responses(
    responses: _Responses, directions: Sequence[Direction], known: Mapping[str, Step]
) -> dict[int, tuple[float, np.ndarray]]:
    """Step along each direction whose response is near its target, as far as that can be, and the response (N,).

    Of a simulation that jumps no smaller step has a smaller response: of the steps tried, the one of the least slope.
    """
    usual = {k: known.get(d.name, Step(FIRST_SCALE_STEP * d.scale, TARGET_RESPONSE)) for k, d in enumerate(directions)}
    sizes = {k: step.size for k, step in usual.items()}
    first: dict[int, tuple[float, np.ndarray]] = {}
    slopes_so_far: dict[int, float] = {}
    waiting = set(sizes)
    for _ in range(MAX_TRIES):
        steps = {k: directions[k].step(sizes[k]) for k in sorted(waiting)}
        for k, response in responses(steps).items():
            if response is None:
                sizes[k] /= FAILURE_STEP_REDUCTION
                continue
            length = float(np.linalg.norm(response))
            smallest, largest = np.array(STEP_BOUNDS) * directions[k].scale
            target = usual[k].response
            near = _is_near(length, target)
            last = near or (sizes[k] >= largest and length < target)
            if last or not slopes_so_far.get(k) or MIN_RESPONSE < length < slopes_so_far[k] * sizes[k]:
                first[k], slopes_so_far[k] = (steps[k], response), length / sizes[k]
            if last:
                waiting.discard(k)
            else:
                ideal = sizes[k] * target / max(length, MIN_RESPONSE)
                sizes[k] = float(np.clip(ideal, smallest, largest))
        if not waiting:
            break
    return first


def _is_near(response: float, target: float) -> bool:
    """Whether a response is more than rounding, and of the magnitude of its target."""
    return response > MIN_RESPONSE and 1.0 / MAX_RESPONSE_RATIO < response / target < MAX_RESPONSE_RATIO


def _known_error(own: tuple[float, np.ndarray], known: Step | None) -> float | None:
    """Relative error of the slope by a step, where that is a known one whose response is as before; None elsewhere."""
    if known is None or abs(own[0]) != known.size or not _is_near(float(np.linalg.norm(own[1])), known.response):
        return None
    return known.relative_error


def _agreeing(
    responses: _Responses, first: Mapping[int, tuple[float, np.ndarray]], projections: Mapping[int, Projection]
) -> dict[int, Slope]:
    """Slopes by steps (step, response) along directions, or by larger ones that agree better with their triples.

    projections : by direction, beside which its slopes are compared; whether a slope is reliable is judged as a whole
    """
    best: dict[int, Slope] = {}
    least: dict[int, float] = {}
    latest = dict(first)
    for _ in range(MAX_COMPARISONS):
        steps = {k: responses.directions[k].step(SECOND_STEP_RATIO * abs(step)) for k, (step, _) in latest.items()}
        seconds, further = responses(steps), {}
        for k, own in latest.items():
            second = seconds[k]
            slope = _compared(own, steps[k], second, responses.reasons.get(k, ""), responses.largest[k])
            error = np.inf
            if second is not None and abs(steps[k]) > abs(own[0]):
                slopes_by_both = own[1] / own[0], second / steps[k]
                if k in projections:
                    slopes_by_both = projections[k](slopes_by_both[0]), projections[k](slopes_by_both[1])
                error = relative_difference(*slopes_by_both)
            better = k not in best or error < least[k]
            if better:
                best[k], least[k] = replace(slope, error_beside=error if np.isfinite(error) else 0.0), error
            if second is not None and MAX_SLOPE_DIFFERENCE < error < np.inf and (better or _jumps(own[1], second)):
                further[k] = steps[k], second
        latest = further
        if not latest:
            break
    return best


def _jumps(first: np.ndarray, second: np.ndarray) -> bool:
    """Whether a second, larger step has no larger response (N,) than the first."""
    return bool(np.linalg.norm(second) < MAX_JUMP_RATIO * np.linalg.norm(first))


def _compared(
    first: tuple[float, np.ndarray], step: float, second: np.ndarray | None, reason: str, largest: float
) -> Slope:
    """Slope by the first step and its response, judged by a second step and its response (N,).

    largest : norm of the response to any step
    """
    first_step, response = first
    slope = response / first_step
    if np.linalg.norm(response) <= MIN_RESPONSE:
        if largest > TARGET_RESPONSE / MAX_RESPONSE_RATIO:
            return Slope(None, 0.0, False, ZERO_DERIVATIVE)
        return Slope(np.zeros_like(slope), first_step, True, "it changes no record")
    if second is None or abs(step) <= abs(first_step):
        return Slope(slope, first_step, False, reason or "its range leaves no second step")
    difference = relative_difference(slope, second / step)
    if difference > MAX_SLOPE_DIFFERENCE:
        reason = f"its derivative is not reliable: finite differences with two step sizes differ by {difference:.0%}"
        return Slope(slope, first_step, False, reason, difference)
    return Slope(slope, first_step, True, relative_error=difference)


def _runs(point: Point, names: Sequence[str], direction: Direction, step: float) -> list[Run]:
    """Simulations of the records one step along a direction."""
    values = {**(direction.values or {}), direction.name: direction.at + step}
    return point.runs(names, values, direction.effects, to_first_order=True)
