"""A force as a formula and a smooth function beside it.

Where a formula predicts as well as the free function, roughness that the formula has costs the free function precision
for nothing. In a partial spline (Wahba, Spline Models for Observational Data, 1990, chapter 9) penalised is only what a
function adds to the formula, and the numbers of the formula are free beside it. Nothing is expected to be added, a
linear function as little as a rough one: both are penalised. A linear function that calibrated parameters nearly
express would else add its whole error to a formula that is known well. The weights of the penalties are by REML, as
those of the free function; the problem is linearised about the refitted formula.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from calib.diagnosis.discovery.formula import Formula
from calib.diagnosis.discovery.formulas import FormulaTrial
from calib.diagnosis.discovery.penalised import FreeModel, PenalisedFit
from calib.diagnosis.discovery.smoothing import BesideFormula, Smoothing
from calib.diagnosis.score import Projection

DIFFERENCE_SHARE = 1e-5  # of a number, by which it is moved for the derivative of the formula  [1]
Part = Callable[[Formula], np.ndarray]  # of a formula: its values (n,) at some states


@dataclass(frozen=True, eq=False)
class PartialSpline:
    """A formula of a force, and the function that the records add to it.

    Attributes
    ----------
    formula : with its refitted values
    model : of the function
    absorbed : (p, a) linear functions that calibration absorbs, by the coefficients of the splines
    smoothing : the problem for the p coefficients, and for q changes of the numbers of the formula, in `scales`
    scales : (q,) of these changes, so that each changes the force by its natural scale  [units of the numbers]
    dispersion : mean square of the residual of the formula, in units of the variance of the noise; at least 1
    """

    formula: Formula
    model: FreeModel
    absorbed: np.ndarray
    smoothing: Smoothing
    scales: np.ndarray
    dispersion: float

    @classmethod
    def of(cls, fitted: PenalisedFit, trial: FormulaTrial) -> "PartialSpline":
        """Set it up of a free force that was fitted, and of a formula of it that was refitted."""
        model, fit = fitted.model, trial.fit
        slopes = _slopes(trial.formula, lambda formula: formula.values(model.states.x, model.states.v))
        size = np.sqrt(np.mean(slopes**2, axis=0))
        scales = model.scale / np.where(size > 0.0, size, 1.0)
        numbers = [fit.names.index(f"{trial.prefix}_{number.name}") for number in trial.formula.numbers]
        whole, splines = fit.free(fit.columns), np.isin(fitted.fit.names, model.coefficients)
        columns = np.column_stack([fit.free(fitted.fit.columns[:, splines]), scales * whole[:, numbers]])
        others = Projection(np.column_stack([np.delete(whole, numbers, axis=1), fit.nuisances]))
        slopes = scales * slopes / model.scale
        smoothing = Smoothing.of(
            columns,
            others(columns),
            others(fit.residual),
            fit.residual.size - others.rank,
            model.differences,
            block_diag(model.prior, slopes.T @ slopes / len(slopes)),
            BesideFormula(model.visited, fitted.smoothing.absorbed),
        )
        effective = smoothing.effective_parameters(smoothing.weight)
        dispersion = max(1.0, fit.chi2 / max(1.0, smoothing.freedom - effective))
        return cls(trial.formula, model, fitted.smoothing.absorbed, smoothing, scales, dispersion)

    def surface(self, x: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Force per unit mass (n,) and its standard error (n,) at states (n,), without what calibration absorbs."""
        return self.combination(self.model.matrix(x, v), lambda formula: formula.values(x, v))

    def combination(self, rows: np.ndarray, part: Part) -> tuple[np.ndarray, np.ndarray]:
        """Values (n,) and standard errors of rows (n, p) by the coefficients, and of a part of the formula."""
        basis = np.column_stack([rows, self.scales * _slopes(self.formula, part)])
        basis = basis - rows @ self.absorbed @ (self._share @ self._visited)
        weight = self.smoothing.weight
        values = self.formula_alone(rows, part) + basis @ self.smoothing.coefficients(weight)
        return values, np.sqrt(self.dispersion) * self.smoothing.errors(basis, weight)

    def formula_alone(self, rows: np.ndarray, part: Part) -> np.ndarray:
        """Values (n,) of a part of the formula, without what calibration absorbs of the whole.

        rows : (n, p) as of `combination`
        """
        whole = self.formula.values(self.model.states.x, self.model.states.v)
        return np.asarray(part(self.formula) - rows @ self.absorbed @ (self._share @ whole))

    @cached_property
    def _share(self) -> np.ndarray:
        """Coefficients (a, n) of the absorbed functions in values (n,) at the visited states."""
        return np.linalg.pinv(self.model.visited @ self.absorbed)

    @cached_property
    def _visited(self) -> np.ndarray:
        """Values (n, p + q) at the visited states, by coefficients and changes of numbers."""
        x, v = self.model.states.x, self.model.states.v
        slopes = _slopes(self.formula, lambda formula: formula.values(x, v))
        return np.column_stack([self.model.visited, self.scales * slopes])


def _slopes(formula: Formula, part: Part) -> np.ndarray:
    """Derivatives (n, q) of a part of a formula by its numbers."""
    values = {number.name: number.value for number in formula.numbers}
    columns = []
    for name, value in values.items():
        step = DIFFERENCE_SHARE * (abs(value) or 1.0)
        ahead, behind = (part(formula.at({**values, name: value + s})) for s in (step, -step))
        columns.append((ahead - behind) / (2.0 * step))
    return np.column_stack(columns)
