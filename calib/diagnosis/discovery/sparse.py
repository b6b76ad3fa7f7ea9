"""Sparse selection: formulas of few terms that fit the records best, by the linearised problem of a free force.

The records are linear in the coefficients c of the splines near a fit, |y - A c|^2, with what calibrated parameters
and nuisances absorb taken out of both; a formula stands in it by the splines that come closest to it over the visited
states. The weight is thus the information that the records have on each part of the function, no derivative of a signal
is needed, and a formula costs no simulation. Terms are added to the best formulas of one term fewer (a beam search; the
first two by all pairs). The best structures are refined in the numbers in which they are nonlinear, by variable
projection (Golub & Pereyra, SIAM Journal on Numerical Analysis 10 (1973) 413).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.discovery.dictionary import dictionary
from calib.diagnosis.discovery.formula import Formula, FormulaTerm, structure_of
from calib.diagnosis.discovery.penalised import PenalisedFit
from calib.diagnosis.discovery.shapes import MAX_TERMS
from calib.diagnosis.discovery.smoothing import MIN_LEFT_SHARE
from calib.diagnosis.score import Projection

MAX_STATES = 800  # visited ones at which a shape is compared with splines  [count]
BEAM_WIDTH = 40  # structures of each number of terms to which a further term is added  [count]
REFINED = 8  # structures of each number of terms that are refined  [count]
ODD_TOLERANCE = 1e-9  # of the sum of opposite values, over the largest  [1]
MAX_EVALUATIONS = 30  # of a refinement  [count]
MIN_INDEPENDENCE = 1e-3  # squared length of a column that the others leave, over the whole: less is the same term  [1]
SPLINE_RANK_TOLERANCE = 1e-8  # singular value over the largest, below which a combination of splines is none  [1]


@dataclass(frozen=True, eq=False)
class Selected:
    """A formula, as the linearised problem has it.

    Attributes
    ----------
    formula : with its values
    chi2 : predicted
    """

    formula: Formula
    chi2: float

    def aic(self, dispersion: float) -> float:
        """Quasi-AIC, but for a constant."""
        return self.chi2 / dispersion + 2.0 * self.formula.length


class LinearisedForce:
    """The linearised problem of a free force, in which formulas are fitted.

    Attributes
    ----------
    terms : of the dictionary over its arguments; of an odd force the odd ones
    price : of a term of a formula, in units of chi-square: twice the logarithm of the number of different terms  [1]

    Parameters
    ----------
    fitted : the free force
    """

    def __init__(self, fitted: PenalisedFit):
        model, fit = fitted.model, fitted.fit
        self.model, self.dispersion = model, fitted.dispersion
        step = max(1, model.states.x.size // MAX_STATES)
        self.x, self.v = model.states.x[::step], model.states.v[::step]
        terms = dictionary(tuple(force.arguments for force in model.forces), model.states.region)
        odd = all(force.odd for force in model.forces)
        self.terms = [term for term in terms if not odd or _is_odd(term, self.x, self.v)]
        self.price = 2.0 * math.log(len({structure_of([term]) for term in self.terms}))
        visited = model.matrix(self.x, self.v)
        self._inverse = np.linalg.pinv(visited, rcond=SPLINE_RANK_TOLERANCE)
        self._coefficients = self._inverse @ (visited @ fitted.coefficients)
        own = np.isin(fit.names, model.coefficients)
        whole = fit.free(fit.columns)
        self._own, self._whole, self._fit = own, whole, fit
        others = Projection(np.column_stack([whole[:, ~own], fit.nuisances]))
        columns = others(whole[:, own])
        target = others(fit.residual + columns @ self._coefficients)  # whose splines are those that terms have too
        basis, self._columns = np.linalg.qr(columns)
        self._target = basis.T @ target
        self._rest = float(target @ target - self._target @ self._target)
        self._raw = np.linalg.qr(whole[:, own], mode="r")

    def splines(self, term: FormulaTerm) -> np.ndarray:
        """Coefficients (p,) of the splines that come closest to a term."""
        return np.asarray(self._inverse @ term.values(self.x, self.v))

    def column(self, term: FormulaTerm) -> np.ndarray:
        """Change (p,) of the records with the coefficient of a term."""
        return np.asarray(self._columns @ self.splines(term))

    def is_determined(self, term: FormulaTerm) -> bool:
        """Whether calibration leaves enough of its change to determine a coefficient."""
        splines = self.splines(term)
        left, whole = np.linalg.norm(self._columns @ splines), np.linalg.norm(self._raw @ splines)
        return bool(np.isfinite(whole) and left > MIN_LEFT_SHARE * whole)

    def fitted(self, terms: Sequence[FormulaTerm]) -> Selected:
        """Fit the coefficients of terms."""
        columns = np.column_stack([self.column(term) for term in terms])
        size, left = _solved(columns, self._target)
        formula = Formula(tuple(replace(t, coefficient=float(c)) for t, c in zip(terms, size, strict=True)))
        return Selected(formula, self._rest + float(left @ left))

    def calibrated(self, formula: Formula) -> dict[str, float]:
        """Values that fit best with a formula, by name, of the parameters beside the free force."""
        own, fit = self._own, self._fit
        splines = sum((t.coefficient * self.splines(t) for t in formula.terms), np.zeros(int(own.sum())))
        left = fit.residual + self._whole[:, own] @ (self._coefficients - splines)
        step, _ = _solved(self._whole[:, ~own], left)
        names = np.array(fit.names)[~own].tolist()
        return {name: fit.value(name) + float(s) for name, s in zip(names, step, strict=True)}

    def refined(self, selected: Selected) -> Selected:
        """Fit the numbers of its shapes too."""
        terms = selected.formula.terms
        free = selected.formula.shape_numbers
        if not free:
            return selected
        scale = np.array([_scale(n.value, n.low, n.high) for n in free])
        low, high = np.array([n.low for n in free]) / scale, np.array([n.high for n in free]) / scale
        begin = np.clip([n.value for n in free] / scale, low + 1e-9 * abs(low), high - 1e-9 * abs(high))
        answer = least_squares(
            lambda u: _solved(np.column_stack([self.column(t) for t in _moved(terms, u * scale)]), self._target)[1],
            begin, bounds=(low, high), max_nfev=MAX_EVALUATIONS, diff_step=1e-4,
        )  # fmt: skip
        return self.fitted(_moved(terms, answer.x * scale))

    def search(self, terms: Sequence[FormulaTerm]) -> list[Selected]:
        """Best formulas of one to four terms, refined, each structure once."""
        known = [term for term in terms if self.is_determined(term)]
        if not known:
            return []
        columns = np.column_stack([self.column(term) for term in known])
        columns = columns / np.linalg.norm(columns, axis=0)
        beam: list[tuple[int, ...]] = [()]
        selected: list[Selected] = []
        best = np.inf
        for number in range(1, MAX_TERMS + 1):
            beam = _leading(self._extended(beam, columns), known, len(known) if number == 1 else BEAM_WIDTH)
            leaders = _leading([(0.0, own) for own in beam], known, REFINED)
            refined = [self.refined(self.fitted([known[k] for k in own])) for own in leaders]
            if not refined:
                break
            plain = [self.fitted([known[k]]) for (k, *_) in beam if not known[k].free] if number == 1 else []
            selected += [*refined, *plain]
            least = min(s.aic(self.dispersion) for s in refined)
            if least > best - CRITERIA.aic_tie and number > 2:
                break
            best = min(best, least)
        return selected

    def _extended(self, beam: Sequence[tuple[int, ...]], columns: np.ndarray) -> list[tuple[float, tuple[int, ...]]]:
        """Each set with each further column (p, K) of unit length, and the squares that are left."""
        answers: dict[tuple[int, ...], float] = {}
        for own in beam:
            basis = np.linalg.qr(columns[:, own])[0] if own else np.zeros((len(columns), 0))
            target = self._target - basis @ (basis.T @ self._target)
            left = columns - basis @ (basis.T @ columns)
            length = np.sum(left**2, axis=0)
            reduction = np.where(length > MIN_INDEPENDENCE, (target @ left) ** 2 / np.maximum(length, 1e-300), -np.inf)
            for k in np.flatnonzero(np.isfinite(reduction)):
                answers.setdefault(tuple(sorted((*own, int(k)))), float(target @ target - reduction[k]))
        return [(left, own) for own, left in answers.items()]


def _is_odd(term: FormulaTerm, x: np.ndarray, v: np.ndarray) -> bool:
    """Whether a term has opposite values at states (n,) and at the opposite ones."""
    values, opposite = term.values(x, v), term.values(-x, -v)
    return bool(np.abs(values + opposite).max() <= ODD_TOLERANCE * np.abs(values).max())


def selected_formulas(problem: LinearisedForce) -> list[Selected]:
    """Formulas of a free force by its linearised problem, the lowest predicted AIC first."""
    refined = problem.search(problem.terms)
    unique: dict[tuple[str, ...], Selected] = {}
    for selected in sorted(refined, key=lambda s: s.aic(problem.dispersion)):
        unique.setdefault(selected.formula.structure, selected)
    return list(unique.values())


def _leading(
    sets: Sequence[tuple[float, tuple[int, ...]]], terms: Sequence[FormulaTerm], number: int
) -> list[tuple[int, ...]]:
    """Sets of the least squares left, each structure once but where all are wanted."""
    ordered = sorted(sets, key=lambda pair: pair[0])
    if number >= len(terms):
        return [own for _, own in ordered]
    unique: dict[tuple[str, ...], tuple[int, ...]] = {}
    for _, own in ordered:
        unique.setdefault(structure_of([terms[k] for k in own]), own)
        if len(unique) == number:
            break
    return list(unique.values())


def _solved(columns: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least-squares coefficients (k,), and the residual (p,)."""
    scale = np.linalg.norm(columns, axis=0)
    scale[~(scale > 0.0)] = 1.0
    size = np.linalg.lstsq(columns / scale, target, rcond=1e-10)[0] / scale
    return size, target - columns @ size


def _scale(value: float, low: float, high: float) -> float:
    """Scale of a number of a shape: of the width of its bounds where it may be zero, else its value."""
    return high - low if low < 0.0 < high or not value else abs(value)


def _moved(terms: Sequence[FormulaTerm], numbers: np.ndarray) -> list[FormulaTerm]:
    """Terms with other free numbers, one after the other."""
    moved, first = [], 0
    for term in terms:
        count = len(term.free)
        moved.append(term.at(numbers[first : first + count].tolist()))
        first += count
    return moved
