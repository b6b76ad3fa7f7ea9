"""A model fitted to the evidence with all its parameters: what the linear test promises, made good."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from calib.diagnosis.bench import simulated
from calib.diagnosis.candidate import Candidate
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.score import Projection
from calib.diagnosis.signature import Direction, Point, Slope, slopes
from calib.model import Model
from calib.parameter import Parameter, Space
from calib.study import Pool

MOST = 12  # evaluations of a fit
ENOUGH = 0.05  # of the sum of squares: a step that promises less ends a fit
WORSE = 30.0  # times the residual of the start stands for a motion that fails


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted model.

    Attributes
    ----------
    point : values, effects and simulations
    found : the candidates in it
    residual : (N,) in units of the noise, without what nuisances absorb
    columns : (N, k) its derivatives by the calibrated parameters and those of the candidates, in that order
    names : of these parameters
    steps : that the derivatives were taken with  [units of the parameters]
    nuisances : (N, m) tangents of the nuisances
    reason : why it is not to be trusted; "" where it converged
    """

    point: Point
    found: tuple[Candidate, ...]
    residual: np.ndarray
    columns: np.ndarray
    names: tuple[str, ...]
    steps: tuple[float, ...]
    nuisances: np.ndarray
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

    @property
    def covariance(self) -> np.ndarray:
        """Covariance (k, k) of the parameters `names`, in their units, where the noise is what it is taken for."""
        free = self.free(self.columns)
        scale = np.linalg.norm(free, axis=0)
        scale[scale == 0.0] = 1.0
        inverse = np.linalg.pinv((free / scale).T @ (free / scale), rcond=1e-12, hermitian=True)
        return inverse / np.outer(scale, scale)

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


class Fitter:
    """Fit models to evidence, from a calibrated point on.

    Parameters
    ----------
    pool : maps `calib.diagnosis.bench.Run` to `Seen`
    space : of the calibrated parameters
    model : calibrated
    """

    def __init__(self, pool: Pool, evidence: Evidence, space: Space, model: Model):
        self.pool, self.evidence, self.space, self.model = pool, evidence, space, model
        self.runs = 0
        self.steps: dict[str, float] = {}  # of the differences, as they were right last

    def fit(self, start: Point, found: Sequence[Candidate] = (), sizes: Mapping[str, float] | None = None) -> Fit:
        """Fit calibrated parameters and those of the candidates `found`, from `start` and their `sizes` on.

        Bounds are the windows of the calibrated parameters and the ranges of the others.
        """
        problem = _Problem(self, start, found, sizes or {})
        best = problem.best
        if best is None:
            return problem.failed(start)
        answer = least_squares(
            problem.residual,
            problem.start,
            problem.jacobian,
            bounds=(problem.low, problem.high),
            x_scale=problem.step,
            ftol=ENOUGH / max(1.0, best.square),
            xtol=1e-10,
            gtol=1e-12,
            max_nfev=MOST,
        )
        return problem.finished("" if answer.status > 0 else f"{MOST} evaluations were not enough")

    def begun(self, base: Fit, candidate: Candidate, sizes: np.ndarray) -> tuple[float, np.ndarray] | None:
        """Sum of squares with the candidate at these sizes (p,), and the sizes; None where the motion fails."""
        runs = base.point.runs(self.evidence.names, candidate.values(sizes), (candidate.effect,))
        views = dict(zip(self.evidence.names, simulated(self.pool, runs), strict=True))
        self.runs += len(views)
        if not all(view.usable for view in views.values()):
            return None
        residual = Projection(np.column_stack([self.evidence.tangents(views), base.columns]))(
            self.evidence.residual(views)
        )
        return float(residual @ residual), sizes

    def directions(self, point: Point, found: Sequence[Candidate]) -> list[Direction]:
        """Directions of the calibrated parameters, then of those of the candidates in the model, at a point."""
        values = point.values
        searched = [
            Direction(name, values[name], window.slope(values[name]), window.low, window.high)
            for name, window in self.space.windows.items()
        ]
        return searched + [direction(point, candidate, p) for candidate in found for p in candidate.parameters]

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
        found = slopes(self.pool, self.evidence, point, directions)
        return [[slope for slope, o in zip(found, owner, strict=True) if o == k] for k in range(len(candidates))]


class _Problem:
    """One fit, as scipy's least squares ask for it; what was simulated is kept."""

    def __init__(self, fitter: Fitter, start: Point, found: Sequence[Candidate], sizes: Mapping[str, float]):
        self.fitter, self.found = fitter, tuple(found)
        known = {c.name for c in found}
        effects = tuple(e for e in start.effects if e.name not in known) + tuple(c.effect for c in found)
        held = {k: v for c in found for k, v in c.absent().items() if k not in start.values}
        values = {**start.values, **held, **sizes}
        self.first = Point(values, effects, start.seen)
        directions = fitter.directions(self.first, found)
        self.names = tuple(d.name for d in directions)
        self.low, self.high = np.array([d.low for d in directions]), np.array([d.high for d in directions])
        self.step = np.array([d.scale for d in directions])
        inside = np.array([d.at for d in directions])
        margin = 1e-6 * np.where(np.isfinite(self.high - self.low), self.high - self.low, self.step)
        self.start = np.clip(inside, self.low + margin, self.high - margin)
        self.best: Fit | None = None
        self.slopes: list[Slope] = []
        self._at: tuple[bytes, Fit | None] = (b"", None)
        self.best = self._evaluated(self.start)

    def failed(self, start: Point) -> Fit:
        """What a fit that cannot even start comes to."""
        seen = start.seen
        nuisances = self.fitter.evidence.tangents(seen)
        residual = self.fitter.evidence.residual(seen)
        none = np.zeros((residual.size, 0))
        return Fit(start, self.found, residual, none, (), (), nuisances, "the motion fails there")

    def _evaluated(self, x: np.ndarray) -> Fit | None:
        key = x.tobytes()
        if self._at[0] == key:
            return self._at[1]
        origin = self.first if self.best is None else self.best.point
        evidence = self.fitter.evidence
        values = {**self.first.values, **dict(zip(self.names, map(float, x), strict=True))}
        point = Point(values, self.first.effects, origin.seen)
        views = dict(zip(evidence.names, simulated(self.fitter.pool, point.runs(evidence.names)), strict=True))
        self.fitter.runs += len(views)
        fit = None
        if all(view.usable for view in views.values()):
            nuisances = evidence.tangents(views)
            residual = Projection(nuisances)(evidence.residual(views))
            fit = Fit(
                Point(values, self.first.effects, views), self.found, residual, np.zeros((residual.size, 0)),
                self.names, (), nuisances,
            )  # fmt: skip
            if self.best is None or fit.square < self.best.square:
                self.best = fit
        self._at = key, fit
        return fit

    def residual(self, x: np.ndarray) -> np.ndarray:
        """Residual (N,) at x."""
        fit = self._evaluated(x)
        return WORSE * self.best.residual if fit is None else fit.residual

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """Derivative (N, k) of the residual at x; a direction that fails counts as having no influence."""
        fit = self._evaluated(x)
        columns, _ = self._columns(fit.point)
        return -Projection(fit.nuisances)(columns)

    def _columns(self, point: Point) -> tuple[np.ndarray, tuple[float, ...]]:
        fitter = self.fitter
        found = slopes(
            fitter.pool, fitter.evidence, point, fitter.directions(point, self.found), fitter.steps, compared=False
        )
        fitter.steps |= {name: abs(s.step) for name, s in zip(self.names, found, strict=True) if s.step}
        size = sum(part.measured.size for part in fitter.evidence.parts)
        columns = np.column_stack([np.zeros(size) if s.column is None else s.column for s in found])
        return columns, tuple(s.step for s in found)

    def finished(self, reason: str) -> Fit:
        """Return the best point with its derivatives."""
        best = self.best
        columns, steps = self._columns(best.point)
        return replace(best, columns=columns, steps=steps, reason=reason)
