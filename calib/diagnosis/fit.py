"""A model fitted to the evidence: its residual, its derivatives, and the errors of its parameters."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from calib.confidence.covariance import sandwich
from calib.confidence.derivatives import MAX_CLAIMED_DIFFERENCE
from calib.diagnosis.candidate import Candidate
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.score import Projection, Signature
from calib.diagnosis.signature import Point


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted model.

    Attributes
    ----------
    point : values, effects and simulations
    candidates : whose effects are in it
    residual : (N,) in units of the noise, without what nuisances absorb
    columns : (N, k) its derivatives by the calibrated parameters and those of the candidates, in that order; as
        updated during the fit unless they were recomputed (`Fitter.with_derivatives`)
    names : of these parameters
    steps : of the differences  [units of the parameters]; empty where the derivatives were given
    nuisances : (N, m) tangents of the nuisances
    rows : (N,) number of the row, among those of all records, that each residual belongs to
    reason : why it did not converge; "" where it did
    relative_errors : of the derivatives beside one another, as by differences of two steps  [1]; empty where these were
        not compared
    """

    point: Point
    candidates: tuple[Candidate, ...]
    residual: np.ndarray
    columns: np.ndarray
    names: tuple[str, ...]
    steps: tuple[float, ...]
    nuisances: np.ndarray
    rows: np.ndarray
    reason: str = ""
    relative_errors: tuple[float, ...] = ()

    @property
    def chi2(self) -> float:
        """Sum of squares of the residual: chi-square."""
        return float(self.residual @ self.residual)

    @cached_property
    def projection(self) -> Projection:
        """Projection that removes what calibrated parameters, effects in the model and nuisances absorb."""
        return Projection(np.column_stack([self.columns, self.nuisances]))

    @cached_property
    def _without_nuisances(self) -> Projection:
        return Projection(self.nuisances)

    def free(self, columns: np.ndarray) -> np.ndarray:
        """Return columns (N, k) without what the nuisances absorb."""
        return self._without_nuisances(columns)

    @cached_property
    def _sandwich(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Covariance (k, k) of the parameters `names`, degrees of freedom and variances by the noise alone (k,).

        In their units; the degrees of freedom are those of the covariance's variances.

        The model error beside the noise has a level and an autocorrelation of its own in each channel of each record,
        as in the intervals of a calibration; no variance is less than that by the noise alone.
        """
        free = self.free(self.columns)
        counted = (self.residual != 0.0) | free.any(axis=1)
        covariance, freedom = sandwich(free[counted], self.residual[counted], self.rows[counted])
        scale = np.linalg.norm(free, axis=0)
        scale[scale == 0.0] = 1.0
        noise = np.diag(np.linalg.pinv((free / scale).T @ (free / scale), rcond=1e-12, hermitian=True)) / scale**2
        wider = np.sqrt(np.maximum(1.0, noise / np.diag(covariance)))
        return covariance * np.outer(wider, wider), freedom, noise

    @property
    def _differentiable(self) -> np.ndarray:
        """Whether (k,) there is a derivative, and not zero: differences by two steps do not contradict each other."""
        errors = np.array(self.relative_errors) if self.relative_errors else np.zeros(len(self.names))
        return self.columns.any(axis=0) & (errors <= MAX_CLAIMED_DIFFERENCE)

    def information(self, name: str) -> float:
        """Fisher information of a parameter beside all others: 1 over its variance by the noise alone.

        In units of 1 over the square of the parameter's; 0 where there is no derivative.
        """
        if not self._differentiable[self.names.index(name)]:
            return 0.0
        _, _, noise = self._sandwich
        return 1.0 / max(float(noise[self.names.index(name)]), 1e-300)

    def is_changed_by(self, candidate: Candidate, columns: np.ndarray) -> bool:
        """Whether data change where a candidate is removed, by more than the noise of one residual.

        From its size to where it is absent; where that is at infinity, by its own size.

        Parameters
        ----------
        columns : (n, k) derivatives of the data by the parameters, in units of the noise
        """
        size = np.array([self.value(name) for name in candidate.free])
        away = size - np.where(np.isfinite(candidate.null), candidate.null, 0.0)
        change = columns[:, [self.names.index(name) for name in candidate.free]] @ away
        return float(change @ change) > CRITERIA.min_change_chi2

    def error(self, names: Sequence[str]) -> np.ndarray:
        """Standard errors of these parameters, jointly with all others.

        Infinite where the derivative is zero, or where there is none: the simulation jumps.
        """
        if not self.names:
            return np.full(len(names), np.inf)
        covariance, _, _ = self._sandwich
        known = np.where(self._differentiable, np.sqrt(np.maximum(0.0, np.diag(covariance))), np.inf)
        return known[[self.names.index(name) for name in names]]

    def covariance(self, names: Sequence[str]) -> np.ndarray:
        """Covariance (n, n) of these parameters, jointly with all others; infinite where the standard error is."""
        if not self.names:
            return np.full((len(names), len(names)), np.inf)
        index = [self.names.index(name) for name in names]
        covariance, _, _ = self._sandwich
        known = self._differentiable[index]
        return np.where(np.outer(known, known), covariance[np.ix_(index, index)], np.inf)

    def inflation(self, names: Sequence[str]) -> float:
        """Largest variance of what these parameters change over that by the noise alone; at least 1.

        Of their changes beside all other parameters, in any combination: some of them may be indistinguishable.
        """
        own = np.isin(self.names, names)
        others = Projection(np.column_stack([self.columns[:, ~own], self.nuisances]))
        changed = Signature.of(self.columns[:, own], others, np.zeros(own.sum())).columns
        directions = np.column_stack([others.basis, Projection(changed).basis])
        counted = (self.residual != 0.0) | directions.any(axis=1)
        covariance, _ = sandwich(directions[counted], self.residual[counted], self.rows[counted])
        return max(1.0, float(np.diag(covariance)[others.rank :].max(initial=1.0)))

    def half_width(self, names: Sequence[str]) -> np.ndarray:
        """Half widths of the 95 % intervals of these parameters, by Student's t."""
        if not self.names:
            return np.full(len(names), np.inf)
        _, freedom, _ = self._sandwich
        index = [self.names.index(name) for name in names]
        return self.error(names) * scipy.stats.t.isf(CRITERIA.tail_probability, freedom[index])

    def value(self, name: str) -> float:
        """Value of a parameter, in SI."""
        return float(self.point.values[name])

    def residual_over(self, evidence: Evidence) -> np.ndarray:
        """Residual over (other) evidence, without what nuisances absorb, in units of the noise (N,)."""
        simulated = self.point.simulated
        return Projection(evidence.tangents(simulated))(evidence.residual(simulated))

    def chi2_over(self, evidence: Evidence) -> float:
        """Chi-square over (other) evidence, without what nuisances absorb."""
        residual = self.residual_over(evidence)
        return float(residual @ residual)
