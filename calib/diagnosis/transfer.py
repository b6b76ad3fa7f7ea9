"""Sizes of causes refitted to each record alone, and whether the records agree on them."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy

from calib.confidence.covariance import sandwich
from calib.diagnosis.constancy import cochran, variation
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.excess import bias_std, gross_excess_by_row, significant
from calib.diagnosis.fit import Fit
from calib.diagnosis.refit import Fitter
from calib.diagnosis.score import Projection, Signature, deviate
from calib.diagnosis.signature import Direction, Slope, slopes

DERIVATIVE_ERROR = 0.003  # relative, of finite differences, beyond which a signature is no numerical error  [1]


@dataclass(frozen=True)
class Transfer:
    """Size of an effect refitted to one record alone, to first order about the size that all records have.

    All other parameters, calibrated ones included, and the nuisances of the record are free; so are the values that the
    study fixes for this record of parameters that are searched for others.

    Attributes
    ----------
    record, parameter : to which, and of which the size is
    size, error : estimate and standard error  [unit of the parameter]
    held : whether the record was held out of calibration and naming
    freedom : degrees of freedom of the error: few where the remainder changes slowly  [1]
    bias : standard deviation of the bias by the model error in this record  [unit of the parameter]
    """

    record: str
    parameter: str
    size: float
    error: float
    held: bool
    freedom: float = np.inf
    bias: float = 0.0

    @property
    def half_width(self) -> float:
        """Half width of its 95 % interval, by Student's t."""
        return self.error * float(scipy.stats.t.isf(CRITERIA.tail_probability, self.freedom))

    @property
    def normal_error(self) -> float:
        """Standard error of a normal distribution that has the same 95 % interval."""
        return self.half_width / float(scipy.stats.norm.isf(CRITERIA.tail_probability))


@dataclass(frozen=True)
class Agreement:
    """Whether the sizes that the records have of one parameter, each alone, agree.

    Attributes
    ----------
    parameter : name
    chi2 : of the sizes about their weighted mean  [1]
    degrees : of freedom
    z : normal deviate of the same probability  [1]
    variation : standard deviation of the sizes beyond their errors, over their mean  [1]
    agree : whether z is not above the threshold of the diagnosis
    detectable : variation above which they would not agree  [1]
    records : that have such a size, in order
    """

    parameter: str
    chi2: float
    degrees: int
    z: float
    variation: float
    agree: bool
    detectable: float
    records: tuple[str, ...]


def acting_causes(final: Fit, columns: np.ndarray) -> tuple[str, ...]:
    """Names of the causes that change a record, of which these are the derivatives (n, k) by `final.names`."""
    return tuple(c.name for c in final.candidates if final.is_changed_by(c, columns))


def refitted_to_each_record(
    evidence: Evidence, final: Fit, columns: Mapping[str, np.ndarray], is_remainder_significant: bool, held: bool
) -> tuple[Transfer, ...]:
    """Sizes of the causes refitted to each record alone, with all other parameters and its nuisances free.

    Parameters
    ----------
    columns : record -> (n, k) derivatives by the parameters `final.names`, then by what else is free
    is_remainder_significant : whether the model leaves more than noise in the records of its fit
    """
    residual, nuisances = evidence.residual(final.point.simulated), evidence.tangents(final.point.simulated)
    numbers, transfers = evidence.rows(), []
    for part in evidence.parts:
        if part.name not in columns:
            continue
        own, changed = evidence.of(part.name), acting_causes(final, columns[part.name])
        gross = partial(gross_excess_by_row, part, final.point.simulated[part.name])
        for name in (name for c in final.candidates if c.name in changed for name in c.free):
            index = final.names.index(name)
            others = np.column_stack([np.delete(columns[part.name], index, axis=1), nuisances[own]])
            column = columns[part.name][:, index]
            alone = _refitted(residual[own], column, others, numbers[own], gross, is_remainder_significant)
            if alone is not None:
                step, error, freedom, bias = alone
                transfers.append(Transfer(part.name, name, final.value(name) + step, error, held, freedom, bias))
    return tuple(transfers)


def _refitted(
    residual: np.ndarray,
    column: np.ndarray,
    others: np.ndarray,
    rows: np.ndarray,
    gross: Callable[[np.ndarray], np.ndarray],
    is_remainder_significant: bool,
) -> tuple[float, float, float, float] | None:
    """Step of one parameter, its standard error and its degrees of freedom, and the standard deviation of its bias.

    A partial regression: the `others` (n, k) are free as well. Its remainder biases the step as in `bias_std`, where
    that is more than noise here, or where all records together have a significant remainder: then with one standard
    deviation of its sum of squares added, for an insignificant sum may contain as much.

    The error includes the model error beside the noise, as that of the joint size does; it is no less than that by the
    noise alone. None where the others absorb the column but for the error of the derivatives.

    Parameters
    ----------
    rows : (n,) number of the row that each residual belongs to
    gross : residual (n,) -> excess chi-square (row,) of the record's gross errors
    is_remainder_significant : whether the model leaves more than noise in all records together
    """
    projection = Projection(others)
    signature = Signature.of(column[:, None], projection, np.array([DERIVATIVE_ERROR]))
    if not signature.columns.any():
        return None
    alone, remaining = signature.columns[:, 0], projection(residual)
    information = float(alone @ alone)
    step = float(alone @ remaining) / information
    remaining = remaining - alone * step
    counted = (remaining != 0.0) | (alone != 0.0)
    covariance, freedom = sandwich(alone[counted, None], remaining[counted], rows[counted])
    error = float(np.sqrt(max(covariance[0, 0], 1.0 / information)))
    degrees = float(np.count_nonzero(remaining)) - projection.rank - 1.0
    excess, std = float(remaining @ remaining - gross(remaining).sum()) - degrees, math.sqrt(2.0 * max(degrees, 1.0))
    may_be_biased = is_remainder_significant or significant(excess, std)
    bias = bias_std(max(0.0, excess) + std, information) if may_be_biased else 0.0
    return step, error, max(1.0, float(freedom[0]) - projection.rank), bias  # the others take theirs


def derivatives_by_record(
    fitter: Fitter, evidence: Evidence, final: Fit, known: np.ndarray | None = None
) -> dict[str, np.ndarray]:
    """Derivatives (n, k) of each record by all parameters of the final model, then by values of its own that are fixed.

    A record without one of them is left out.

    Parameters
    ----------
    known : (N, k) derivatives by all parameters of the final model; None: they are computed
    """
    shared, columns_by_record = fitter.directions(final.point, final.candidates) if known is None else [], {}

    def own_slopes(name: str, own: Fitter) -> list[Slope]:
        directions = [*shared, *_fixed_alone(own, final, name)]
        return slopes(own.pool, evidence.only([name]), final.point, directions, own.steps, "none")

    several = fitter.in_turn([partial(own_slopes, name) for name in evidence.names])
    for name, own in zip(evidence.names, several, strict=True):
        columns = [slope.column for slope in own if slope.column is not None]
        if len(columns) == len(own):
            first = [] if known is None else [known[evidence.of(name)]]
            columns_by_record[name] = np.column_stack([*first, *columns])
    return columns_by_record


def _fixed_alone(fitter: Fitter, final: Fit, record: str) -> list[Direction]:
    """Directions of parameters fixed for this record and searched for others, such as its initial state."""
    searched = {name.partition("@")[0]: window for name, window in fitter.space.windows.items()}
    directions = []
    for name, value in final.point.values.items():
        base, _, owner = name.partition("@")
        if owner == record and base in searched and name not in final.names:
            parameter, window = fitter.model.parameters[base], searched[base]
            directions.append(Direction(name, value, window.high - window.low, parameter.low, parameter.high))
    return directions


def agreements(transfers: Sequence[Transfer], threshold: float) -> tuple[Agreement, ...]:
    """Whether the records agree on each size that several of them have: chi-square about the weighted mean.

    An error of few degrees of freedom counts as that of the normal distribution with the same 95 % interval. The model
    error in a record widens it by its possible bias, but does not lower the weight of the record in the estimate of the
    variation of the sizes.

    Parameters
    ----------
    threshold : of the normal deviate, from which sizes differ
    """
    compared = []
    for name in dict.fromkeys(t.parameter for t in transfers):
        own = [t for t in transfers if t.parameter == name and 0.0 < t.normal_error < np.inf]
        if len(own) < 2:
            continue
        size, same = np.array([t.size for t in own]), np.zeros(len(own), dtype=int)
        raw_variance = np.array([t.normal_error**2 for t in own])
        raw, _, raw_mean_chi2 = cochran(size, np.diag(raw_variance), same)
        variance = raw_variance + np.array([t.bias**2 for t in own])
        q, degrees, mean_chi2 = cochran(size, np.diag(variance), same)
        z = float(deviate(q, degrees))
        limit = float(scipy.stats.chi2.isf(2.0 * scipy.stats.norm.sf(threshold), degrees))
        compared.append(
            Agreement(
                parameter=name,
                chi2=q,
                degrees=degrees,
                z=z,
                variation=variation(raw, degrees, raw_mean_chi2 * _dersimonian_laird_factor(raw_variance)),
                agree=z <= threshold,
                detectable=variation(limit, degrees, mean_chi2 * _dersimonian_laird_factor(variance)),
                records=tuple(t.record for t in own),
            )
        )
    return tuple(compared)


def _dersimonian_laird_factor(variance: np.ndarray) -> float:
    """Return 1 less the sum of squares of the shares in the information of sizes with these variances (m,).

    Over the total information it is the denominator of the moment estimator of the variance between records.
    """
    share = (1.0 / variance) / (1.0 / variance).sum()
    return float(1.0 - share @ share)
