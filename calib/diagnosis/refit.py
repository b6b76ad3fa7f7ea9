"""A model fitted to the evidence with all its parameters: what the linear test promises, made good."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import stats
from scipy.optimize import lsq_linear

from calib.confidence.covariance import sandwich
from calib.diagnosis.bench import Seen, Start, simulated
from calib.diagnosis.candidate import Candidate
from calib.diagnosis.effort import Effort
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.score import Projection
from calib.diagnosis.signature import Direction, Point, Slope, slopes
from calib.model import Model
from calib.objective import INITIAL_STATE
from calib.parameter import Parameter, Space
from calib.study import Pool

MOST = 30  # steps of a fit
PATIENCE = 5  # steps after which a fit that promises no more than another one has is ended
TRUST = 2.0  # times what fresh derivatives promise: a fit that may bring no more is not gone on with
ENOUGH = 0.1  # fall of the sum of squares, in units of the mean square: a step that promises less ends a fit
WELL = 0.25  # of what a step promises: where it brings less, the derivatives are taken anew, not only updated
BENT = 0.1  # of what a step promises: where what it brings differs by more, old derivatives do not end a fit
DIFFERENCES = 4  # simulations of each record for the derivative by a candidate's parameter, as measured
DERIVATIVES, EVALUATIONS = 1, 5  # of the model in a fit, as measured
INITIAL_SIMULATIONS = 20  # of each record in a fit, where its initial state is a nuisance, as measured
INITIAL_STEP = 1e-3  # of the rows: change by a step of the initial state, for a derivative
HALVINGS = 5  # of a step that does not lower the sum of squares
LEVEL = 0.95  # of intervals
RIDGE = 1e-10  # on the normal equations, of unit diagonal: directions that the data do not know stay where they are


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted model.

    Attributes
    ----------
    point : values, effects and simulations
    found : the candidates in it
    residual : (N,) in units of the noise, without what nuisances absorb
    columns : (N, k) its derivatives by the calibrated parameters and those of the candidates, in that order; of a fit
        that is not sharpened as they were updated on the way
    names : of these parameters
    steps : that the derivatives were taken with  [units of the parameters]; empty where they were given
    nuisances : (N, m) tangents of the nuisances
    rows : (N,) number of the row, among those of all records, that each residual belongs to
    reason : why it is not to be trusted; "" where it converged
    """

    point: Point
    found: tuple[Candidate, ...]
    residual: np.ndarray
    columns: np.ndarray
    names: tuple[str, ...]
    steps: tuple[float, ...]
    nuisances: np.ndarray
    rows: np.ndarray
    reason: str = ""

    @property
    def square(self) -> float:
        """Sum of squares of the residual."""
        return float(self.residual @ self.residual)

    @property
    def absorbing(self) -> Projection:
        """Projection that takes out what calibrated parameters, effects in the model and nuisances absorb."""
        return Projection(np.column_stack([self.columns, self.nuisances]))

    def free(self, columns: np.ndarray) -> np.ndarray:
        """Return columns (N, k) without what the nuisances absorb."""
        return Projection(self.nuisances)(columns)

    @cached_property
    def _sandwich(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Covariance (k, k) of the parameters `names`, in their units, and degrees of freedom (k,) of its variances.

        Beside these the variances (k,) that the noise alone makes.

        What the model leaves beside the noise has a level and an autocorrelation of its own in each channel of each
        record, as in the intervals of a calibration; no variance is less than what the noise alone makes.
        """
        free = self.free(self.columns)
        counted = (self.residual != 0.0) | free.any(axis=1)
        covariance, freedom = sandwich(free[counted], self.residual[counted], self.rows[counted])
        scale = np.linalg.norm(free, axis=0)
        scale[scale == 0.0] = 1.0
        noise = np.diag(np.linalg.pinv((free / scale).T @ (free / scale), rcond=1e-12, hermitian=True)) / scale**2
        wider = np.sqrt(np.maximum(1.0, noise / np.diag(covariance)))
        return covariance * np.outer(wider, wider), freedom, noise

    def error(self, names: Sequence[str]) -> np.ndarray:
        """Standard errors of these parameters, jointly with all others; infinite where no derivative tells."""
        if not self.names:
            return np.full(len(names), np.inf)
        covariance, _, _ = self._sandwich
        known = np.where(self.columns.any(axis=0), np.sqrt(np.maximum(0.0, np.diag(covariance))), np.inf)
        return known[[self.names.index(name) for name in names]]

    def inflation(self, names: Sequence[str]) -> float:
        """Variance of these parameters over what the noise alone makes, the largest; 1 where nothing else is left."""
        covariance, _, noise = self._sandwich
        index = [self.names.index(name) for name in names]
        return float((np.diag(covariance)[index] / np.maximum(noise[index], 1e-300)).max())

    def half_width(self, names: Sequence[str]) -> np.ndarray:
        """Half widths of the 95 % intervals of these parameters, by Student's t."""
        if not self.names:
            return np.full(len(names), np.inf)
        _, freedom, _ = self._sandwich
        index = [self.names.index(name) for name in names]
        return self.error(names) * stats.t.isf(0.5 * (1.0 - LEVEL), freedom[index])

    def value(self, name: str) -> float:
        """Value of a parameter, in SI."""
        return float(self.point.values[name])

    def judged(self, evidence: Evidence) -> float:
        """Sum of squares over (other) evidence, without what nuisances absorb."""
        seen = self.point.seen
        left = Projection(evidence.tangents(seen))(evidence.residual(seen))
        return float(left @ left)


def direction(point: Point, candidate: Candidate, parameter: Parameter) -> Direction:
    """Direction of a parameter of a candidate that is in the model."""
    name = parameter.name
    return Direction(name, point.values[name], candidate.scale[name], parameter.low, parameter.high)


def _own(point: Point, candidate: Candidate) -> list[Direction]:
    """Directions of a candidate in the model: of its parameters, then of its form."""
    form = [Direction(n, point.values[n], candidate.scale[n], *candidate.bounds[n]) for n in candidate.form]
    return [direction(point, candidate, p) for p in candidate.parameters] + form


class Fitter:
    """Fit models to evidence, from a calibrated point on.

    Parameters
    ----------
    pool : maps `calib.diagnosis.bench.Run` to `Seen`; counted in `effort`
    space : of the calibrated parameters
    model : calibrated
    """

    def __init__(self, pool: Pool, evidence: Evidence, space: Space, model: Model):
        self.effort = pool if isinstance(pool, Effort) else Effort(pool)
        self.evidence, self.space, self.model = evidence, space, model
        self.steps: dict[str, float] = {}  # of the differences, as they were right last

    def fit(
        self,
        start: Point,
        found: Sequence[Candidate] = (),
        sizes: Mapping[str, float] | None = None,
        columns: np.ndarray | None = None,
        rival: float = np.inf,
    ) -> Fit:
        """Fit calibrated parameters and those of the candidates `found`, from `start` and their `sizes` on.

        Gauss and Newton's steps within the windows of the calibrated parameters and the ranges of the others. The
        derivatives are updated by what a step brings (Broyden, Math. Comp. 19 (1965) 577), and taken anew where it
        brings less than a quarter of what it promises. That no step promises anything any more is believed of updated
        ones only where all steps since brought what they promised.

        Parameters
        ----------
        columns : (N, k) derivatives near the start by the parameters in the order of `directions`; None: taken there
        rival : sum of squares that another model reaches: a fit that promises no better after a few steps is not gone
            on with
        """
        point = _extended(start, found, sizes or {})
        directions = self.directions(point, found)
        low, high = np.array([d.low for d in directions]), np.array([d.high for d in directions])
        x = np.clip([d.at for d in directions], low, high)
        now = self._evaluated(point, directions, x, found, solved=True)
        if now is None:
            return self._failed(start, found)
        fresh = columns is None
        now, bent = self.sharpened(now) if fresh else replace(now, columns=columns), False
        for number in range(MOST):
            step, promise = _step(now, x, low, high)
            if number >= PATIENCE and now.square - TRUST * promise > rival:
                if fresh or not bent:
                    return replace(now, reason=f"after {number} steps it promises less than another explanation brings")
                now, fresh, bent = self.sharpened(now), True, False
                continue
            done = promise < ENOUGH * max(1.0, now.square / now.residual.size)
            if done and bent and not fresh:
                now, fresh, bent = self.sharpened(now), True, False
                continue
            if done:
                return replace(now, reason="")
            ahead = self._ahead(now, directions, x, step, found)
            if ahead is None:
                if fresh:
                    return replace(now, reason="no step lowers the sum of squares further")
                now, fresh, bent = self.sharpened(now), True, False
                continue
            there, fit = ahead
            brought = (now.square - fit.square) / promise
            fresh = brought <= WELL
            bent = not fresh and (bent or abs(brought - 1.0) > BENT)
            now, x = self.sharpened(fit) if fresh else _updated(fit, now, there - x), there
        return replace(now, reason=f"{MOST} steps were not enough")

    def expected(self, scored: int, fits: int) -> int:
        """Simulations that scores of so many parameters and so many fits of one candidate beside all should take."""
        parts, parameters = self.evidence.parts, len(self.space.windows) + 1
        free = sum(INITIAL_STATE in part.nuisance for part in parts)
        each = len(parts) * (DERIVATIVES * parameters + EVALUATIONS) + free * INITIAL_SIMULATIONS
        return len(parts) * DIFFERENCES * scored + fits * each

    def sharpened(self, fit: Fit) -> Fit:
        """Return the fit with the derivatives at its own point."""
        fit = self._with_initial_slopes(fit)
        directions = self.directions(fit.point, fit.found)
        found = slopes(self.effort, self.evidence, fit.point, directions, self.steps, compared=False)
        self.steps |= {d.name: abs(s.step) for d, s in zip(directions, found, strict=True) if s.step}
        none = np.zeros(fit.residual.size)
        columns = [none if s.column is None else s.column for s in found]
        return replace(
            fit,
            columns=np.column_stack(columns) if columns else np.zeros((none.size, 0)),
            names=tuple(d.name for d in directions),
            steps=tuple(s.step for s in found),
        )

    def _ahead(
        self, now: Fit, directions: Sequence[Direction], x: np.ndarray, step: np.ndarray, found: Sequence[Candidate]
    ) -> tuple[np.ndarray, Fit] | None:
        """Go the step, or the largest half of a half of it that lowers the sum of squares.

        Where the whole step does not, with initial states as they are foreseen, these are solved for once.
        """
        free = any(view.start is not None for view in now.point.seen.values())
        tried = [(1.0, False), (1.0, True), *((0.5**k, False) for k in range(1, HALVINGS))]
        for share, solved in tried if free else [pair for pair in tried if not pair[1]]:
            there = x + share * step
            fit = self._evaluated(now.point, directions, there, found, share * (now.columns @ step), solved)
            if fit is not None and fit.square < now.square:
                return there, fit
        return None

    def _with_initial_slopes(self, fit: Fit) -> Fit:
        """Return the fit with the derivatives by initial states that are nuisances taken anew: forward differences."""
        seen, runs, places = dict(fit.point.seen), [], []
        for name, view in seen.items():
            components = () if view.start is None else view.start.state
            for k, (component, slope) in enumerate(zip(components, view.initial, strict=True)):
                size = float(np.linalg.norm(slope))
                if size > 0.0:
                    step = INITIAL_STEP * float(np.linalg.norm(view.rows)) / size
                    runs += fit.point.runs([name], starts={name: view.start.moved({component: step})})
                    places.append((name, k, step))
        if not runs:
            return fit
        for (name, k, step), ahead in zip(places, simulated(self.effort, runs), strict=True):
            if ahead.usable:
                slopes = seen[name].start.slopes.copy()
                slopes[k] = (ahead.rows - seen[name].rows) / step
                seen[name] = replace(seen[name], start=replace(seen[name].start, slopes=slopes))
        nuisances = self.evidence.tangents(seen)
        residual = Projection(nuisances)(self.evidence.residual(seen))
        return replace(fit, point=replace(fit.point, seen=seen), residual=residual, nuisances=nuisances)

    def _starts(self, seen: Mapping[str, Seen], change: float | np.ndarray) -> dict[str, Start]:
        """Initial states that are nuisances, by record, where the simulations change by so much (N,)."""
        moves = self.evidence.initial_moves(seen, self.evidence.residual(seen) - change)
        return {name: seen[name].start.moved(own) for name, own in moves.items()}

    def _evaluated(
        self,
        origin: Point,
        directions: Sequence[Direction],
        x: np.ndarray,
        found: Sequence[Candidate],
        change: float | np.ndarray = 0.0,
        solved: bool = False,
    ) -> Fit | None:
        """Simulate all records at x; None where one of them fails.

        change : (N,) that is foreseen of the simulations; initial states that are nuisances go where it leaves them
        solved : whether these are solved for instead
        """
        starts = dict.fromkeys(self.evidence.names) if solved else self._starts(origin.seen, change)
        values = {**origin.values, **{d.name: float(value) for d, value in zip(directions, x, strict=True)}}
        names = self.evidence.names
        views = dict(zip(names, simulated(self.effort, origin.runs(names, values, starts=starts)), strict=True))
        if not all(view.usable for view in views.values()):
            return None
        nuisances = self.evidence.tangents(views)
        residual = Projection(nuisances)(self.evidence.residual(views))
        none = np.zeros((residual.size, 0))
        parameters = tuple(d.name for d in directions)
        rows = self.evidence.rows()
        return Fit(Point(values, origin.effects, views), tuple(found), residual, none, parameters, (), nuisances, rows)

    def _failed(self, start: Point, found: Sequence[Candidate]) -> Fit:
        nuisances = self.evidence.tangents(start.seen)
        residual = self.evidence.residual(start.seen)
        none = np.zeros((residual.size, 0))
        rows = self.evidence.rows()
        return Fit(start, tuple(found), residual, none, (), (), nuisances, rows, "the motion fails there")

    def begun(self, base: Fit, candidate: Candidate, sizes: np.ndarray) -> tuple[float, np.ndarray] | None:
        """What a candidate of these sizes (p,) promises: a fall of the sum of squares, and the sizes for it.

        Its change of the records is scaled to fit best, and the sizes with it; not where it has no finite null. None
        where the motion fails, or the sign is impossible.
        """
        names, null = self.evidence.names, candidate.null
        runs = base.point.runs(names, candidate.values(sizes), (candidate.effect,))
        views = dict(zip(names, simulated(self.effort, runs), strict=True))
        if not all(view.usable for view in views.values()):
            return None
        absorbing = base.absorbing
        residual, change = absorbing(base.residual), absorbing(self.evidence.difference(base.point.seen, views))
        length = float(change @ change)
        if candidate.effect.guess is not None or not np.isfinite(null).all():
            left = residual - change
            return float(residual @ residual - left @ left), sizes
        if not length > 0.0:
            return None
        factor = float(residual @ change) / length
        there = null + factor * (sizes - null)
        if (there < candidate.low).any() or (there > candidate.high).any():
            return None
        return factor**2 * length, there

    def directions(self, point: Point, found: Sequence[Candidate]) -> list[Direction]:
        """Directions of the calibrated parameters, then of those of the candidates in the model, at a point."""
        values = point.values
        searched = [
            Direction(name, values[name], window.slope(values[name]), window.low, window.high)
            for name, window in self.space.windows.items()
        ]
        return searched + [d for candidate in found for d in _own(point, candidate)]

    def suspected(self, point: Point, candidates: Sequence[Candidate]) -> list[list[Slope]]:
        """Slopes of each candidate's parameters at null, all side by side."""
        directions, owner = [], []
        for index, candidate in enumerate(candidates):
            for p in candidate.parameters:
                directions.append(
                    Direction(
                        p.name, p.null, candidate.scale[p.name], p.low, p.high, (candidate.effect,), candidate.absent()
                    )
                )
                owner.append(index)
        found = slopes(self.effort, self.evidence, point, directions)
        return [[slope for slope, o in zip(found, owner, strict=True) if o == k] for k in range(len(candidates))]


def _updated(ahead: Fit, behind: Fit, step: np.ndarray) -> Fit:
    """Return the fit with the derivatives behind it, changed in the direction of the step (k,) to what it brought."""
    slopes = behind.free(behind.columns)
    scale = np.linalg.norm(slopes, axis=0)
    along = scale**2 * step
    missed = behind.residual - ahead.residual - slopes @ step
    columns = behind.columns + np.outer(missed, along) / max(float(along @ step), 1e-300)
    return replace(ahead, columns=columns, steps=behind.steps)


def _extended(start: Point, found: Sequence[Candidate], sizes: Mapping[str, float]) -> Point:
    """Return the point with these candidates in its model, and no others, at these sizes."""
    effects = tuple(candidate.effect for candidate in found)
    held = {name: value for candidate in found for name, value in candidate.absent().items()}
    present = {name: value for name, value in start.values.items() if name in held}
    return Point({**start.values, **held, **present, **sizes}, effects, start.seen)


def _step(fit: Fit, x: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, float]:
    """Step (k,) of Gauss and Newton within the bounds, and by how much it should lower the sum of squares."""
    slopes = fit.free(fit.columns)
    scale = np.linalg.norm(slopes, axis=0)
    moving = scale > 0.0
    step = np.zeros(x.size)
    if not moving.any():
        return step, 0.0
    unit = slopes[:, moving] / scale[moving]
    room = (low - x)[moving] * scale[moving], (high - x)[moving] * scale[moving]
    room = np.minimum(room[0], -1e-12), np.maximum(room[1], 1e-12)
    gram = unit.T @ unit
    # the same minimum from small matrices: |L' y - L^-1 b|, gram = L L'
    lower = np.linalg.cholesky(gram + RIDGE * np.eye(len(gram)))
    target = np.linalg.solve(lower, unit.T @ fit.residual)
    y = lsq_linear(lower.T, target, room, method="bvls").x
    step[moving] = np.clip(y / scale[moving], (low - x)[moving], (high - x)[moving])
    y = step[moving] * scale[moving]
    return step, float(2.0 * y @ (unit.T @ fit.residual) - y @ gram @ y)
