"""Profiles of the likelihood over the parameters of a calibrated study, and over pairs of them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np

from calib.confidence.constrained import ConstrainedFit, FittedPoint
from calib.confidence.derivatives import Evaluate
from calib.confidence.likelihood import AdjustedLikelihood
from calib.confidence.local import Confidence
from calib.confidence.lockstep import lockstep
from calib.confidence.pair import NODES, Node, Pair
from calib.confidence.profile import ACCURACY, Centre, Side, SideEnd, fit_accuracy, profile_side
from calib.errors import CalibError
from calib.study import Outcome

MAX_ROUNDS = 3  # from better and better points  [count]
MIN_IMPROVEMENT = 0.02  # of the quantile, by which a point is better than the best one  [1]
DEFAULT_ERROR = 0.1  # of the window: scale of steps where there is no local standard error  [1]
EXPECTED_POINTS = 5  # of one side, for the progress  [count]
EXPECTED_EVALUATIONS_PER_PARAMETER = 10  # of a point whose other parameters are fitted, for the progress  [count]
LOW, HIGH = "low", "high"
SIGNS = {LOW: -1.0, HIGH: 1.0}


@dataclass(frozen=True, eq=False)
class LocalAnalysis:
    """What is known about a point before profiles are followed from it.

    Attributes
    ----------
    outcome : of the point
    confidence : in it
    blocks : (m,) numbers of the blocks of the residuals; None: one block
    noise_draws : (number, m) residuals of drawn noise, where several terms share it
    """

    outcome: Outcome
    confidence: Confidence
    blocks: np.ndarray | None = None
    noise_draws: np.ndarray | None = None


class Notes(Protocol):
    """Where finished points are kept, so that an interrupted run goes on."""

    def get(self, key: str) -> FittedPoint | None:
        """Return the point of a key, None where there is none yet."""
        ...

    def add(self, key: str, point: FittedPoint) -> None:
        """Keep a point."""
        ...

    def add_all(self, points: Mapping[str, FittedPoint]) -> None:
        """Keep points that were made together."""
        ...


@dataclass(frozen=True, eq=False)
class Profiles:
    """Profiles about the best point.

    Attributes
    ----------
    centre : the best point
    analysis : of it
    sides : parameter -> (low, high) side
    points : parameter -> points of each side, from the best one outwards in the order of their making
    ends : parameter -> where each side ends
    pairs : that were profiled, with the points at their nodes
    moved : (dim,) from the calibrated to the best point, in the unit cube
    improved : whether the profiles met a better point than the calibrated one
    better : whether they met one that is better than this best one still
    """

    centre: Centre
    analysis: LocalAnalysis
    sides: Mapping[str, tuple[Side, Side]]
    points: Mapping[str, tuple[tuple[FittedPoint, ...], tuple[FittedPoint, ...]]]
    ends: Mapping[str, tuple[SideEnd, SideEnd]]
    pairs: tuple[tuple[Pair, Mapping[Node, FittedPoint]], ...]
    moved: np.ndarray
    improved: bool
    better: bool


def profiles(
    evaluate: Evaluate,
    analyse: Callable[[np.ndarray], LocalAnalysis],
    names: Sequence[str],
    u: np.ndarray,
    notes: Notes,
    *,
    pairs: Sequence[tuple[str, str]] = (),
    on_progress: Callable[[int, int], None] = lambda done, foreseen: None,
) -> Profiles:
    """Profile every parameter, and pairs of them, from the best point near `u` (dim,), in the unit cube.

    The point is fitted first. Where a profile meets a point that is clearly better, all begin again from that.

    Parameters
    ----------
    evaluate : points (n, dim) -> n outcomes
    analyse : local analysis of a point
    names : (dim,) of the parameters
    notes : finished points are taken from there, and added to it
    pairs : of names
    on_progress : called with the number of evaluations that are done, and of those that are foreseen

    Raises
    ------
    CalibError : the best point cannot be evaluated, or is not compared by residuals
    """
    start = np.array(u, dtype=float)
    improved = False
    progress = _Progress(on_progress, len(pairs) * NODES, len(names))
    for number in range(MAX_ROUNDS):
        progress.begin_round()
        round_ = _Round(evaluate, analyse, names, notes, number, progress)
        analysis, centre = round_.begin(start)
        found = round_.follow(analysis, centre)
        lowest = min((p for both in found[0].values() for own in both for p in own), key=lambda p: p.square)
        axis = int(np.argmin(centre.likelihood.degrees_of_freedom))
        least = MIN_IMPROVEMENT / ACCURACY * fit_accuracy(centre.likelihood, axis)
        better = lowest.square < centre.likelihood.square - least
        if not better:
            break
        if number + 1 < MAX_ROUNDS:
            start, improved = np.array(lowest.u), True
    points, ends = found
    sides = round_.sides(centre)
    grids = round_.grids(analysis, centre, ends, pairs)
    return Profiles(centre, analysis, sides, points, ends, grids, centre.u - np.array(u, dtype=float), improved, better)


def without_profiles(analysis: LocalAnalysis, centre: Centre, u: np.ndarray) -> Profiles:
    """Best point near `u` (dim,) with its analysis, and no profile about it."""
    return Profiles(centre, analysis, {}, {}, {}, (), centre.u - np.array(u, dtype=float), False, False)


def best_about(
    evaluate: Evaluate,
    analyse: Callable[[np.ndarray], LocalAnalysis],
    names: Sequence[str],
    u: np.ndarray,
    notes: Notes,
) -> tuple[LocalAnalysis, Centre]:
    """Fit the best point near `u` (dim,) as `profiles` does before they begin; the rest as there."""
    return _Round(evaluate, analyse, names, notes, 0, _Progress(lambda done, foreseen: None, 0, len(names))).begin(u)


def fit_about(analysis: LocalAnalysis, likelihood: AdjustedLikelihood, evaluate: Evaluate) -> ConstrainedFit:
    """Fit of parameters about a point that was analysed."""
    dim = likelihood.degrees_of_freedom.size
    errors = likelihood.standard_error if likelihood.differentiable else np.full(dim, DEFAULT_ERROR)
    residuals = np.asarray(analysis.outcome.residuals, dtype=float)
    accuracy = min(fit_accuracy(likelihood, axis) for axis in range(dim))
    return ConstrainedFit(evaluate, residuals, analysis.outcome.cost, errors, accuracy, likelihood.differentiable)


class _Progress:
    """Counts the evaluations of finished points of sides and of grids, and of those that are foreseen.

    A point that is foreseen counts with as many evaluations as the finished ones of a side, or of a grid, took in the
    mean.
    """

    def __init__(self, on_progress: Callable[[int, int], None], nodes: int, dim: int):
        self._on_progress, self._foreseen_nodes = on_progress, nodes
        self._points, self._nodes = _Mean(dim - 1), _Mean(dim - 2)
        self._sides: dict[str, tuple[int, bool]] = {}

    def begin_round(self) -> None:
        """Forget the sides of the round before; what it took stays counted."""
        self._sides.clear()

    def side(self, key: str, points: Sequence[FittedPoint], done: int, ended: bool = False) -> None:
        """Take in further points of a side, of which so many are done now."""
        self._sides[key] = done, ended
        self._points.add(points)
        self._tell()

    def nodes(self, points: Sequence[FittedPoint]) -> None:
        """Take in further nodes."""
        self._nodes.add(points)
        self._tell()

    def _tell(self) -> None:
        sides = sum(0 if ended else max(1, EXPECTED_POINTS - done) for done, ended in self._sides.values())
        left = sides * self._points.each + (self._foreseen_nodes - self._nodes.points) * self._nodes.each
        done = self._points.evaluations + self._nodes.evaluations
        self._on_progress(done, done + round(left))


class _Mean:
    """Evaluations that fits of a number of free parameters take in the mean."""

    def __init__(self, free: int):
        self._expected = max(1, EXPECTED_EVALUATIONS_PER_PARAMETER * free)
        self.points = self.evaluations = 0

    def add(self, points: Sequence[FittedPoint]) -> None:
        """Take in points."""
        self.points += len(points)
        self.evaluations += sum(point.evaluations for point in points)

    @property
    def each(self) -> float:
        """Evaluations of a further point."""
        return self.evaluations / self.points if self.points else self._expected


@dataclass(frozen=True, eq=False)
class _Round:
    """All profiles from one best point."""

    evaluate: Evaluate
    analyse: Callable[[np.ndarray], LocalAnalysis]
    names: Sequence[str]
    notes: Notes
    number: int
    progress: "_Progress"

    def begin(self, start: np.ndarray) -> tuple[LocalAnalysis, Centre]:
        """Fit the best point near the start, and analyse it."""
        analysis = self.analyse(start)
        likelihood = self._likelihood(analysis)
        key = f"{self.number}/best"
        point = self.notes.get(key)
        if point is None:
            point = fit_about(analysis, likelihood, self.evaluate)([start], np.ones(start.size, dtype=bool))
            self.notes.add(key, point)
        improvement = likelihood.square - point.square
        if improvement > fit_accuracy(likelihood, 0):
            analysis = self.analyse(np.array(point.u))
            likelihood = self._likelihood(analysis)
            return analysis, Centre(np.array(point.u), likelihood, analysis.outcome.kind)
        return analysis, Centre(start, likelihood, analysis.outcome.kind)

    def _likelihood(self, analysis: LocalAnalysis) -> AdjustedLikelihood:
        if analysis.outcome.residuals is None:
            raise CalibError(
                f"the calibrated point cannot be evaluated (status {analysis.outcome.status!r}): run the study again"
            )
        linearised = analysis.confidence.linearised
        if linearised is not None:
            return AdjustedLikelihood.of(linearised)
        residuals = np.asarray(analysis.outcome.residuals, dtype=float)
        blocks = np.zeros(residuals.size, dtype=int) if analysis.blocks is None else analysis.blocks
        return AdjustedLikelihood.without_derivatives(residuals, blocks, len(self.names))

    def sides(self, centre: Centre) -> dict[str, tuple[Side, Side]]:
        """Both sides of each parameter."""
        return {name: (Side(centre, k, -1.0), Side(centre, k, 1.0)) for k, name in enumerate(self.names)}

    def follow(
        self, analysis: LocalAnalysis, centre: Centre
    ) -> tuple[dict[str, tuple[tuple[FittedPoint, ...], tuple[FittedPoint, ...]]], dict[str, tuple[SideEnd, SideEnd]]]:
        """Points and ends of each parameter's profile, all sides side by side."""
        functions = []
        for name, both in self.sides(centre).items():
            for label, side in zip(SIGNS, both, strict=True):
                key = f"{self.number}/{name}/{label}"
                known = self._known(key)
                self.progress.side(key, known, len(known))
                functions.append(partial(self._side, side, analysis, key, known))
        results = lockstep(self.evaluate, functions)
        pairs = [(results[2 * k], results[2 * k + 1]) for k in range(len(self.names))]
        points = {name: (low[0], high[0]) for name, (low, high) in zip(self.names, pairs, strict=True)}
        return points, {name: (low[1], high[1]) for name, (low, high) in zip(self.names, pairs, strict=True)}

    def _side(
        self, side: Side, analysis: LocalAnalysis, key: str, known: Sequence[FittedPoint], evaluate: Evaluate
    ) -> tuple[tuple[FittedPoint, ...], SideEnd]:
        def keep(number: int, point: FittedPoint) -> None:
            self.notes.add(f"{key}/{number}", point)
            self.progress.side(key, [point], number + 1)

        points, end = profile_side(side, fit_about(analysis, side.centre.likelihood, evaluate), known, keep)
        self.progress.side(key, [], len(points), ended=True)
        return points, end

    def _known(self, key: str) -> list[FittedPoint]:
        known: list[FittedPoint] = []
        while (point := self.notes.get(f"{key}/{len(known)}")) is not None:
            known.append(point)
        return known

    def grids(
        self,
        analysis: LocalAnalysis,
        centre: Centre,
        ends: Mapping[str, tuple[SideEnd, SideEnd]],
        pairs: Sequence[tuple[str, str]],
    ) -> tuple[tuple[Pair, Mapping[Node, FittedPoint]], ...]:
        """Profiles over pairs of parameters."""
        grids = []
        for one, other in pairs:
            pair = Pair.about(centre, (self.names.index(one), self.names.index(other)), (ends[one], ends[other]))
            fit = partial(fit_about, analysis, centre.likelihood)
            grids.append((pair, self._nodes(pair, fit, f"{self.number}/{one}+{other}")))
        return tuple(grids)

    def _nodes(self, pair: Pair, fit: Callable[[Evaluate], ConstrainedFit], key: str) -> dict[Node, FittedPoint]:
        size = pair.positions.shape[1] // 2
        nodes = [(i, j) for i in range(-size, size + 1) for j in range(-size, size + 1)]
        found = {node: self.notes.get(f"{key}/{node[0]}/{node[1]}") for node in nodes}
        known = {node: point for node, point in found.items() if point is not None}
        self.progress.nodes(list(known.values()))

        def keep(node: Node, point: FittedPoint) -> None:
            self.notes.add(f"{key}/{node[0]}/{node[1]}", point)
            self.progress.nodes([point])

        return pair.fitted(self.evaluate, fit, known, keep)
