"""Fits of models to the evidence with all their parameters, by the method of Gauss and Newton."""

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from copy import copy
from dataclasses import replace
from functools import partial
from typing import TypeVar

import numpy as np
from scipy.optimize import lsq_linear

from calib.confidence.local import MAX_EDGE_DISTANCE
from calib.diagnosis.bench import Run, SimulatedRows, Start, simulated
from calib.diagnosis.candidate import Candidate
from calib.diagnosis.effort import SCORE, Effort
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.fit import Fit
from calib.diagnosis.score import Projection
from calib.diagnosis.signature import Direction, Point, Slope, Step, slopes
from calib.modelling.model import Model
from calib.modelling.parameter import Parameter, Space
from calib.objective import INITIAL_STATE
from calib.study import Pool

MAX_FIT_STEPS = 30  # of a fit  [count]
MIN_STEPS_BEFORE_ABANDONING = 5  # a fit that is predicted to attain no lower chi-square than another  [count]
MAX_GAIN_RATIO = 2.0  # reduction that a step may bring at most, over the predicted one  [1]
MIN_REDUCTION = 0.1  # of chi-square, in units of the mean square: a step of a smaller predicted reduction ends a fit
MIN_UPDATE_GAIN_RATIO = 0.25  # actual over predicted reduction: below it derivatives are taken anew, not updated  [1]
MAX_GAIN_ERROR = 0.1  # departure of the gain ratio from 1 beyond which updated derivatives do not end a fit  [1]
SIMULATIONS_PER_SCORE = 4  # of each record for the derivative by a candidate's parameter, as measured  [count]
JACOBIANS_PER_FIT, STEPS_PER_FIT = 1, 5  # as measured  [count]
INITIAL_STATE_SIMULATIONS = 20  # of each record in a fit, where its initial state is a nuisance, as measured  [count]
INITIAL_RELATIVE_STEP = 1e-3  # change of the rows by a step of the initial state over their norm  [1]
MAX_FIT_HALVINGS = 5  # of a step that does not reduce chi-square  [count]
RIDGE = 1e-10  # added to the unit diagonal of the normal equations: undetermined directions are not moved  [1]
MIN_ROOM = 1e-12  # of a scaled step on its bound, where the solver needs an open interval  [1]

T = TypeVar("T")


def direction(point: Point, candidate: Candidate, parameter: Parameter) -> Direction:
    """Direction of a parameter of a candidate that is in the model."""
    name = parameter.name
    return Direction(name, point.values[name], candidate.scale[name], parameter.low, parameter.high)


def _at_null(candidate: Candidate, parameter: Parameter) -> Direction:
    """Direction of a parameter of a candidate that is absent."""
    name, effect = parameter.name, candidate.effect
    null, scale = effect.null[name], candidate.scale[name]
    return Direction(name, null, scale, parameter.low, parameter.high, (effect,), candidate.absent())


def _directions_of(point: Point, candidate: Candidate) -> list[Direction]:
    """Directions of a candidate in the model: of its parameters, then of its form."""
    form = [Direction(n, point.values[n], candidate.scale[n], *candidate.bounds[n]) for n in candidate.form]
    return [direction(point, candidate, p) for p in candidate.parameters] + form


class Fitter:
    """Fit models to evidence, from a calibrated point on.

    Parameters
    ----------
    pool : maps `calib.diagnosis.bench.Run` to `SimulatedRows`; `effort` counts its simulations
    space : of the calibrated parameters
    model : calibrated
    """

    def __init__(self, pool: Pool, evidence: Evidence, space: Space, model: Model):
        self.effort = pool if isinstance(pool, Effort) else Effort(pool)
        self.pool: Pool = self.effort  # on which it simulates: another one where it fits ahead of its turn
        self.evidence, self.space, self.model = evidence, space, model
        self.steps: dict[str, Step] = {}  # of the differences, from the latest derivatives

    def in_turn(self, tasks: Sequence[Callable[["Fitter"], T]]) -> Generator[T, None, None]:
        """Yield the results of tasks of this fitter one after the other, as they are asked for.

        Those whose turn has not come are run ahead on idle processes, with what is known by then: each task has to read
        what the ones before it change when it is called. No result depends on that (`SpeculativePool`).
        """
        if self.pool is not self.effort:
            return (task(self) for task in tasks)
        ahead = [partial(self._ahead, task) for task in tasks]
        return self.effort.pool.in_turn([partial(task, self) for task in tasks], ahead)

    def _ahead(self, task: Callable[["Fitter"], object], pool: Pool) -> None:
        """Run a task by a copy that simulates on a pool of its own, and keeps to itself what it takes for steps."""
        fitter = copy(self)
        fitter.pool, fitter.steps = pool, dict(self.steps)
        task(fitter)

    def attempt(self, step: Callable[[], T | None]) -> T | None:
        """Result of a step of the search; None where the budget ends it: then it is as if it had not begun."""
        if self.pool is not self.effort:  # ahead of its turn no budget counts
            return step()
        evidence = self.evidence
        result = self.effort.attempt(step)
        self.evidence = evidence if result is None else self.evidence
        return result

    def measuring(self, kind: str, count: float = 1.0) -> AbstractContextManager[None]:
        """Measure the simulations of steps of a kind, but for what is run ahead."""
        return self.effort.measuring(kind, count) if self.pool is self.effort else nullcontext()

    def foresee(self, kind: str, count: float) -> None:
        """Foresee so many steps of a kind in this stage, but for what is run ahead."""
        if self.pool is self.effort:
            self.effort.foresee(self.effort.expected(kind, count))

    def on(self, evidence: Evidence) -> "Fitter":
        """Return a fitter of the same model to other evidence."""
        fitter = copy(self)
        fitter.evidence, fitter.steps = evidence, {}
        return fitter

    def fit(
        self,
        start: Point,
        candidates: Sequence[Candidate] = (),
        sizes: Mapping[str, float] | None = None,
        columns: np.ndarray | None = None,
        rival: float = np.inf,
    ) -> Fit:
        """Fit calibrated parameters and those of the candidates, beginning at `start` and their `sizes`.

        Steps of Gauss and Newton within the windows of the calibrated parameters and the ranges of the others. The
        derivatives are updated by the residual after a step (Broyden, Math. Comp. 19 (1965) 577), and recomputed where
        the gain ratio, of the actual over the predicted reduction of chi-square, is low. Convergence by updated ones
        counts only where the gain ratio of all steps since was near 1.

        Parameters
        ----------
        columns : (N, k) derivatives near the start by the parameters in the order of `directions`; None: computed there
        rival : chi-square that another model attains: a fit that is predicted to attain no less is abandoned after a
            few steps
        """
        point = extended(start, candidates, sizes or {})
        directions = self.directions(point, candidates)
        low, high = np.array([d.low for d in directions]), np.array([d.high for d in directions])
        x = np.clip([d.at for d in directions], low, high)
        now = self.evaluated(point, directions, x, candidates, solved=True)
        if now is None:
            return self._failed(start, candidates)
        fresh, nonlinear = columns is None, False
        now = self.with_derivatives(now) if columns is None else replace(now, columns=columns)
        for number in range(MAX_FIT_STEPS):
            step, predicted = _step(now, x, low, high)
            inferior = number >= MIN_STEPS_BEFORE_ABANDONING and now.chi2 - MAX_GAIN_RATIO * predicted > rival
            converged = predicted < MIN_REDUCTION * max(1.0, now.chi2 / now.residual.size)
            if (inferior or converged) and (fresh or not nonlinear):
                reason = f"after {number} steps a rival has a lower chi-square than is predicted for this fit"
                return replace(now, reason=reason if inferior else "")
            ahead = None if inferior or converged else self._line_search(now, directions, x, step, candidates)
            if ahead is None:
                if fresh:
                    return replace(now, reason="no step reduces chi-square further")
                now, fresh, nonlinear = self.with_derivatives(now), True, False
                continue
            x_ahead, fit = ahead
            gain_ratio = (now.chi2 - fit.chi2) / predicted
            fresh = gain_ratio <= MIN_UPDATE_GAIN_RATIO
            nonlinear = not fresh and (nonlinear or abs(gain_ratio - 1.0) > MAX_GAIN_ERROR)
            now, x = self.with_derivatives(fit) if fresh else updated(fit, now, x_ahead - x), x_ahead
        return replace(now, reason=f"no convergence in {MAX_FIT_STEPS} steps")

    def is_at_an_edge(self, fit: Fit) -> bool:
        """Whether a calibrated value is at an edge of its window."""
        positions = [window.position(fit.value(name)) for name, window in self.space.windows.items()]
        return min(positions, default=0.5) < MAX_EDGE_DISTANCE or max(positions, default=0.5) > 1.0 - MAX_EDGE_DISTANCE

    def in_the_middle(self, fit: Fit) -> Fit | None:
        """The model of a fit with the calibrated values in the middle of their windows, and the derivatives there.

        None where some record cannot be simulated there. Of an earlier call for the same fit only the
        simulations at the middle itself would repeat: the derivatives have the noise of the present evidence, and their
        steps are those of the latest ones.
        """
        directions = self.directions(fit.point, fit.candidates)
        windows = self.space.windows
        x = np.array([windows[d.name].value(0.5) if d.name in windows else d.at for d in directions])
        now = self.evaluated(fit.point, directions, x, fit.candidates, solved=True)
        return None if now is None else self.with_derivatives(now)

    def expected_simulations(self, scored: int, fits: int) -> int:
        """Expected number of simulations for scores of so many parameters and so many fits of one candidate each."""
        parts, parameters = self.evidence.parts, len(self.space.windows) + 1
        free = sum(INITIAL_STATE in part.nuisance for part in parts)
        each = len(parts) * (JACOBIANS_PER_FIT * parameters + STEPS_PER_FIT) + free * INITIAL_STATE_SIMULATIONS
        return len(parts) * SIMULATIONS_PER_SCORE * scored + fits * each

    def with_derivatives(self, fit: Fit) -> Fit:
        """Return the fit with the derivatives at its own point."""
        fit = self._with_initial_slopes(fit)
        directions = self.directions(fit.point, fit.candidates)
        taken = slopes(self.pool, self.evidence, fit.point, directions, self.steps, "new", fit.nuisances, together=True)
        self.steps |= {d.name: s.taken for d, s in zip(directions, taken, strict=True) if s.taken}
        none = np.zeros(fit.residual.size)
        columns = [none if s.column is None else s.column for s in taken]
        return replace(
            fit,
            columns=np.column_stack(columns) if columns else np.zeros((none.size, 0)),
            names=tuple(d.name for d in directions),
            steps=tuple(s.step for s in taken),
            relative_errors=tuple(s.error_beside for s in taken),
        )

    def _line_search(
        self,
        now: Fit,
        directions: Sequence[Direction],
        x: np.ndarray,
        step: np.ndarray,
        candidates: Sequence[Candidate],
    ) -> tuple[np.ndarray, Fit] | None:
        """Take the step, or the first of its successive halves that reduces chi-square.

        Where the whole step does not, with predicted initial states, these are solved for once.
        """
        free = any(view.start is not None for view in now.point.simulated.values())
        tried = [(1.0, False), (1.0, True), *((0.5**k, False) for k in range(1, MAX_FIT_HALVINGS))]
        for share, solved in tried if free else [pair for pair in tried if not pair[1]]:
            x_ahead, change = x + share * step, share * (now.columns @ step)
            fit = self.evaluated(now.point, directions, x_ahead, candidates, change, solved)
            if fit is not None and fit.chi2 < now.chi2:
                return x_ahead, fit
        return None

    def _with_initial_slopes(self, fit: Fit) -> Fit:
        """Return the fit with the derivatives by initial states that are nuisances recomputed: forward differences."""
        views = dict(fit.point.simulated)
        starts = {name: view.start for name, view in views.items() if view.start is not None}
        runs: list[Run] = []
        places = []
        for name, start in starts.items():
            for k, (component, slope) in enumerate(zip(start.state, start.slopes, strict=True)):
                size = float(np.linalg.norm(slope))
                if size > 0.0:
                    step = INITIAL_RELATIVE_STEP * float(np.linalg.norm(views[name].rows)) / size
                    runs += fit.point.runs([name], starts={name: start.moved({component: step})})
                    places.append((name, k, step))
        if not runs:
            return fit
        for (name, k, step), ahead in zip(places, simulated(self.pool, runs), strict=True):
            if ahead.usable:
                slopes = starts[name].slopes.copy()
                slopes[k] = (ahead.rows - views[name].rows) / step
                starts[name] = replace(starts[name], slopes=slopes)
                views[name] = replace(views[name], start=starts[name])
        nuisances = self.evidence.tangents(views)
        residual = Projection(nuisances)(self.evidence.residual(views))
        return replace(fit, point=replace(fit.point, simulated=views), residual=residual, nuisances=nuisances)

    def _starts(self, views: Mapping[str, SimulatedRows], change: float | np.ndarray) -> dict[str, Start | None]:
        """Initial states that are nuisances, by record, where the simulations change by this (N,)."""
        moves = self.evidence.initial_moves(views, self.evidence.residual(views) - change)
        starts = {name: view.start for name, view in views.items() if view.start is not None}
        return {name: starts[name].moved(own) for name, own in moves.items()}

    def evaluated(
        self,
        origin: Point,
        directions: Sequence[Direction],
        x: np.ndarray,
        candidates: Sequence[Candidate],
        change: float | np.ndarray = 0.0,
        solved: bool = False,
    ) -> Fit | None:
        """Simulate all records at x; None where one of them fails.

        change : (N,) predicted change of the simulations; initial states that are nuisances are those that fit it best
        solved : whether these are solved for instead
        """
        starts: Mapping[str, Start | None]
        starts = dict.fromkeys(self.evidence.names) if solved else self._starts(origin.simulated, change)
        values = {**origin.values, **{d.name: float(value) for d, value in zip(directions, x, strict=True)}}
        names = self.evidence.names
        views = dict(zip(names, simulated(self.pool, origin.runs(names, values, starts=starts)), strict=True))
        if not all(view.usable for view in views.values()):
            return None
        nuisances = self.evidence.tangents(views)
        residual = Projection(nuisances)(self.evidence.residual(views))
        none = np.zeros((residual.size, 0))
        parameters = tuple(d.name for d in directions)
        point, rows = Point(values, origin.effects, views), self.evidence.rows()
        return Fit(point, tuple(candidates), residual, none, parameters, (), nuisances, rows)

    def _failed(self, start: Point, candidates: Sequence[Candidate]) -> Fit:
        """A fit without parameters, for one that cannot begin."""
        nuisances = self.evidence.tangents(start.simulated)
        residual = self.evidence.residual(start.simulated)
        none = np.zeros((residual.size, 0))
        rows = self.evidence.rows()
        return Fit(
            start, tuple(candidates), residual, none, (), (), nuisances, rows, "its simulation fails at the start"
        )

    def trials(
        self, base: Fit, candidate: Candidate, sizes: Sequence[np.ndarray]
    ) -> list[tuple[float, np.ndarray] | None]:
        """Predicted reduction of chi-square by a candidate of about each of the sizes (p,), and the sizes of best fit.

        Its change of the records is scaled to fit best, and the sizes with it, by the power with which the change grows
        from one size to the next; not where its null is infinite. None where the simulation fails, or the sizes are not
        admissible.
        """
        names = self.evidence.names
        runs = [run for x in sizes for run in base.point.runs(names, candidate.values(x), (candidate.effect,))]
        answers = iter(simulated(self.pool, runs))
        views = [{name: next(answers) for name in names} for _ in sizes]
        changes = [
            base.projection(self.evidence.difference(base.point.simulated, own))
            if all(view.usable for view in own.values())
            else None
            for own in views
        ]
        orders = _orders(candidate, sizes, changes)
        return [self._trial(base, candidate, *own) for own in zip(sizes, changes, orders, strict=True)]

    def _trial(
        self, base: Fit, candidate: Candidate, sizes: np.ndarray, change: np.ndarray | None, order: int
    ) -> tuple[float, np.ndarray] | None:
        """Predicted reduction of chi-square and sizes of best fit, by the change (N,) at these sizes (p,).

        order : of the power of the sizes with which the change grows
        """
        if change is None:
            return None
        null, residual = candidate.null, base.projection(base.residual)
        if candidate.effect.guess is not None or not np.isfinite(null).all():
            remainder = residual - change
            return float(residual @ residual - remainder @ remainder), sizes
        squared_length = float(change @ change)
        if not squared_length > 0.0:
            return None
        factor = float(residual @ change) / squared_length
        scaled = null + np.copysign(abs(factor) ** (1.0 / order), factor) * (sizes - null)
        if (scaled < candidate.low).any() or (scaled > candidate.high).any():
            return None
        return factor**2 * squared_length, scaled

    def directions(self, point: Point, candidates: Sequence[Candidate]) -> list[Direction]:
        """Directions of the calibrated parameters, then of those of the candidates in the model, at a point."""
        values = point.values
        searched = [
            Direction(name, values[name], window.slope(values[name]), window.low, window.high)
            for name, window in self.space.windows.items()
        ]
        return searched + [d for candidate in candidates for d in _directions_of(point, candidate)]

    def candidate_slopes(self, base: Fit, candidates: Sequence[Candidate]) -> list[list[Slope]]:
        """Slopes of each candidate's parameters at null beside a model, all side by side."""

        def taken(owners: Sequence[Candidate], pool: Pool) -> list[Slope]:
            directions = [_at_null(candidate, p) for candidate in owners for p in candidate.parameters]
            return slopes(pool, self.evidence, base.point, directions, absorbed=base.projection.basis)

        each = [partial(taken, [candidate]) for candidate in candidates]
        parameters = sum(len(candidate.parameters) for candidate in candidates)
        with self.effort.pool.expecting(each if self.pool is self.effort else []), self.measuring(SCORE, parameters):
            together = iter(taken(candidates, self.pool))
        return [[next(together) for _ in candidate.parameters] for candidate in candidates]


def _orders(candidate: Candidate, sizes: Sequence[np.ndarray], changes: Sequence[np.ndarray | None]) -> list[int]:
    """Powers with which changes (N,) of the records grow with the sizes (p,), from one to the next: 1 at least."""
    null = np.where(np.isfinite(candidate.null), candidate.null, 0.0)
    lengths = [0.0 if change is None else float(np.linalg.norm(change)) for change in changes]
    places = [float(np.linalg.norm(own - null)) for own in sizes]
    orders = [1] * len(sizes)
    for k in range(1, len(sizes)):
        if min(lengths[k - 1 : k + 1] + places[k - 1 : k + 1]) > 0.0 and places[k] != places[k - 1]:
            growth = np.log(lengths[k] / lengths[k - 1]) / np.log(places[k] / places[k - 1])
            orders[k] = max(1, round(growth))
    orders[:1] = orders[1:2] or orders[:1]  # of the first size that of the next
    return orders


def updated(ahead: Fit, behind: Fit, step: np.ndarray) -> Fit:
    """Return the fit ahead of a step (k,) with the derivatives behind it, by Broyden's update."""
    slopes = behind.free(behind.columns)
    scale = np.linalg.norm(slopes, axis=0)
    along = scale**2 * step
    error = behind.residual - ahead.residual - slopes @ step
    columns = behind.columns + np.outer(error, along) / max(float(along @ step), 1e-300)
    return replace(ahead, columns=columns, steps=behind.steps, relative_errors=behind.relative_errors)


def extended(start: Point, candidates: Sequence[Candidate], sizes: Mapping[str, float]) -> Point:
    """Return the point with these candidates in its model, and no others, at these sizes."""
    effects = tuple(candidate.effect for candidate in candidates)
    held = {name: value for candidate in candidates for name, value in candidate.absent().items()}
    present = {name: value for name, value in start.values.items() if name in held}
    return Point({**start.values, **held, **present, **sizes}, effects, start.simulated)


def _step(fit: Fit, x: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, float]:
    """Step (k,) of Gauss and Newton within the bounds, and its predicted reduction of chi-square."""
    slopes = fit.free(fit.columns)
    scale = np.linalg.norm(slopes, axis=0)
    moving = scale > 0.0
    step = np.zeros(x.size)
    if not moving.any():
        return step, 0.0
    unit = slopes[:, moving] / scale[moving]
    room = (low - x)[moving] * scale[moving], (high - x)[moving] * scale[moving]
    room = np.minimum(room[0], -MIN_ROOM), np.maximum(room[1], MIN_ROOM)
    gram = unit.T @ unit
    # the same minimum from small matrices: |L' y - L^-1 b|, gram = L L'
    lower = np.linalg.cholesky(gram + RIDGE * np.eye(len(gram)))
    target = np.linalg.solve(lower, unit.T @ fit.residual)
    y = lsq_linear(lower.T, target, room, method="bvls").x
    step[moving] = np.clip(y / scale[moving], (low - x)[moving], (high - x)[moving])
    y = step[moving] * scale[moving]
    return step, float(2.0 * y @ (unit.T @ fit.residual) - y @ gram @ y)
