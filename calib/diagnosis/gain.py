"""What an extension brings on data that had no part in finding it."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import stats

from calib.confidence.covariance import sandwich
from calib.diagnosis.bench import Bench, Run, SimulatedRows, simulated
from calib.diagnosis.clock import clock_slopes
from calib.diagnosis.constancy import cochran, variation
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.evidence import Evidence, Part, gathered
from calib.diagnosis.excess import bias_std, chi2_std, excess_chi2, significant
from calib.diagnosis.refit import Fit, Fitter
from calib.diagnosis.score import Projection, Signature, deviate
from calib.diagnosis.signature import Direction, slopes
from calib.diagnosis.suspect import Refitted
from calib.objective import Squares, misfit, row_weights
from calib.records.cycles import kind_of_motion
from calib.study import Pool

BOOTSTRAP_DRAWS = 2000
DERIVATIVE_ERROR = 0.003  # relative, of differences: by it a signature is distinguished from rounding
RECORDS, BLOCKS = "records held out", "blocks of the calibrated records"


@dataclass(frozen=True)
class Transfer:
    """Size of an effect refitted to one record alone, to first order about the size that all records have.

    All other parameters, calibrated ones included, and the nuisances of the record are free; so are the values that the
    study fixes for this record of parameters that are searched for others.

    Attributes
    ----------
    record, parameter : whose size
    size, error : estimate and standard error  [unit of the parameter]
    held : whether the record had no part in calibration and naming
    freedom : degrees of freedom of the error: few where what is left changes slowly  [1]
    bias : standard deviation of the bias by what is left in this record beside the noise  [unit of the parameter]
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
        return self.error * float(stats.t.isf(CRITERIA.tail_probability, self.freedom))

    @property
    def normal_error(self) -> float:
        """Standard error of a normal distribution that has the same 95 % interval."""
        return self.half_width / float(stats.norm.isf(CRITERIA.tail_probability))


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
    detectable : variation from which on they would not agree  [1]
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


@dataclass(frozen=True)
class Shift:
    """What the extension does to a calibrated parameter.

    Attributes
    ----------
    parameter : name
    before, after : values, in SI
    before_error : standard error of the calibrated value, in SI
    after_error : of the other, with the bias that what the extended model leaves may make, in SI
    unit : of all these
    """

    parameter: str
    before: float
    after: float
    before_error: float
    after_error: float
    unit: str = "1"

    @property
    def errors(self) -> float:
        """By how many standard errors of the calibrated value it moves."""
        return (self.after - self.before) / self.before_error


@dataclass(frozen=True)
class Gain:
    """Held-out misfit before and after.

    Attributes
    ----------
    kind : RECORDS, or BLOCKS where no record was held out (weak evidence)
    records : names of what was held out
    before, after : `calib.objective.MISFIT` of all that was held out: of the calibrated model, refitted to the records
        as the diagnosis weighs them, and of the extended one  [1]
    interval : of before less after, by a bootstrap over segments  [1]
    each : record -> (before, after)
    failed : record -> why it could not be simulated
    unaffected : those of the records in which no cause changes anything: they try only what else the model has
    transfers, agreements, shifts : see there
    fitted_agree : whether the records of the fit agree on all sizes, the records held out left aside
    """

    kind: str
    records: tuple[str, ...]
    before: float
    after: float
    interval: tuple[float, float]
    each: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    failed: Mapping[str, str] = field(default_factory=dict)
    unaffected: tuple[str, ...] = ()
    transfers: tuple[Transfer, ...] = ()
    agreements: tuple[Agreement, ...] = ()
    shifts: tuple[Shift, ...] = ()
    fitted_agree: bool = True

    @property
    def proven(self) -> bool:
        """Whether the misfit falls for sure."""
        return self.interval[0] > 0.0

    @property
    def refutes(self) -> bool:
        """Whether the misfit of all records held out together, of which a cause changes some, rises for sure."""
        return self.kind == RECORDS and self.interval[1] < 0.0 and set(self.unaffected) < set(self.records)

    def tries_as_much_as(self, other: "Gain") -> bool:
        """Whether all that another was tried on could be simulated here too."""
        same = self.kind == other.kind and set(self.records) >= set(other.records)
        return same and bool(np.isfinite(self.interval).all())


def gained(
    pool: Pool,
    bench: Bench,
    fitter: Fitter,
    null: Fit,
    final: Fit,
    causes: Sequence[Refitted],
    seed: int,
    threshold: float,
) -> Gain | None:
    """Try the calibrated and the extended model on what was held out; None where nothing can be.

    On a record held out only its own nuisances are solved for.

    Parameters
    ----------
    threshold : of the normal deviate, from which the records' sizes differ
    """
    shifts = _shifts(fitter, null, final)
    columns = _columns(pool, fitter, fitter.evidence, final, final.columns)
    remains = significant(excess_chi2(fitter.evidence, final), chi2_std(fitter.evidence))
    transfers = _transfers(fitter.evidence, final, columns, remains, held=False)
    held = [name for name, reference in bench.objective.references.items() if reference.use == "holdout"]
    if not held:
        return _of_blocks(fitter, null, final, causes, seed, shifts=shifts, **_sizes(transfers, threshold))
    before, after, failed = _simulated(pool, held, null, final)
    if not before:
        nan, sizes = np.nan, _sizes(transfers, threshold)
        return Gain(RECORDS, (), nan, nan, (nan, nan), failed=failed, shifts=shifts, **sizes)
    evidence = _held_out_evidence(pool, bench, final, before, after)
    parts = [(part, before[part.name], after[part.name]) for part in evidence.parts]
    there = replace(final, point=replace(final.point, simulated=after))
    columns = _columns(pool, fitter, evidence, there)
    transfers += _transfers(evidence, there, columns, remains, held=True)
    unaffected = tuple(name for name, own in columns.items() if not _changed(there, own))
    rest = {"failed": failed, "unaffected": unaffected, "shifts": shifts, **_sizes(transfers, threshold)}
    return _summed(RECORDS, parts, seed, **rest)


def _changed(final: Fit, columns: np.ndarray) -> tuple[str, ...]:
    """Names of the causes that change a record, of which these are the derivatives (n, k) by `final.names`."""
    return tuple(c.name for c in final.candidates if final.is_changed_by(c, columns))


def _simulated(
    pool: Pool, held: Sequence[str], null: Fit, final: Fit
) -> tuple[dict[str, SimulatedRows], dict[str, SimulatedRows], dict[str, str]]:
    """Records held out by the calibrated and by the extended model, as far as both can be; else why not, by name."""
    runs = [Run(name, fit.point.values, fit.point.effects) for fit in (null, final) for name in held]
    answers = simulated(pool, runs)
    before, after = dict(zip(held, answers, strict=False)), dict(zip(held, answers[len(held) :], strict=True))
    failed = {
        name: f"{which}: {view.status} {view.reason}".strip()
        for which, views in (("without the extension", before), ("with it", after))
        for name, view in views.items()
        if not view.usable
    }
    usable = [name for name in held if name not in failed]
    return {name: before[name] for name in usable}, {name: after[name] for name in usable}, failed


def _held_out_evidence(
    pool: Pool, bench: Bench, final: Fit, before: Mapping[str, SimulatedRows], after: Mapping[str, SimulatedRows]
) -> Evidence:
    """Records held out with their noise, compared where the simulations of both models are to be trusted."""
    references = {name: bench.objective.references[name] for name in after}
    cycle = {name: kind_of_motion(reference.record).period or 1 for name, reference in references.items()}
    clocks = clock_slopes(pool, bench, after, final.point.values, final.point.effects)
    evidence = gathered(references, bench.rows, cycle, after, clocks=clocks).with_weights([before, after])
    return evidence.with_remainder(Projection(evidence.tangents(after))(evidence.residual(after)))


def _of_blocks(fitter: Fitter, null: Fit, final: Fit, causes: Sequence[Refitted], seed: int, **rest) -> Gain | None:
    """Fit both models to one half of every record and try them on the other, and the other way round."""
    candidates = tuple(cause.candidate for cause in causes)
    parts = []
    for half in (0, 1):
        own = Evidence(tuple(_half(part, half) for part in fitter.evidence.parts))
        other = Evidence(tuple(_half(part, 1 - half) for part in fitter.evidence.parts))
        halved = Fitter(fitter.effort, own, fitter.space, fitter.model)
        without = halved.fit(null.point)
        sizes = {name: final.value(name) for c in candidates for name in c.free}
        extended = halved.fit(final.point, candidates, sizes)
        for part in other.parts:
            parts.append((part, without.point.simulated[part.name], extended.point.simulated[part.name]))
    return _summed(BLOCKS, parts, seed, **rest)


def _half(part: Part, half: int) -> Part:
    """Return the part compared in its first or second half only."""
    n = part.time.size
    kept = (np.arange(n) >= n // 2) == bool(half)
    return replace(part, used=part.used & kept, weight=part.weight * kept)


def _summed(kind: str, parts: Sequence[tuple[Part, SimulatedRows, SimulatedRows]], seed: int, **rest) -> Gain:
    """Misfit before and after over (part, before, after), with the bootstrap over segments of the records."""
    names = tuple(dict.fromkeys(part.name for part, _, _ in parts))
    squares = [_squares([own for own in parts if own[0].name == name]) for name in names]
    each = {name: (misfit([one]), misfit([other])) for name, (one, other) in zip(names, squares, strict=True)}
    before, after = misfit([one for one, _ in squares]), misfit([other for _, other in squares])
    rng = np.random.default_rng(seed)
    drawn = []
    for _ in range(BOOTSTRAP_DRAWS):
        picked = [rng.integers(one.count.shape[1], size=one.count.shape[1]) for one, _ in squares]
        again = [(one.drawn(p), other.drawn(p)) for (one, other), p in zip(squares, picked, strict=True)]
        drawn.append(misfit([one for one, _ in again]) - misfit([other for _, other in again]))
    tail = CRITERIA.tail_probability
    interval = tuple(float(x) for x in np.nanquantile(drawn, [tail, 1.0 - tail]))
    return Gain(kind, names, before, after, interval, each=each, **rest)


def _squares(parts: Sequence[tuple[Part, SimulatedRows, SimulatedRows]]) -> tuple[Squares, Squares]:
    """Squares of one record, of which each part has some segments, before and after."""
    squares = [[_by_segment(part, view) for view in views] for part, *views in parts]
    counted = [(one.count + other.count).sum(axis=0) > 0.0 for one, other in squares]
    kept = [[s.drawn(c) for s in pair] for pair, c in zip(squares, counted, strict=True)]
    before, after = (
        Squares(np.hstack([s.total for s in side]), np.hstack([s.count for s in side]))
        for side in zip(*kept, strict=True)
    )
    return before, after


def _by_segment(part: Part, view: SimulatedRows) -> Squares:
    weight = row_weights(part.rows, part.used, view.trust)
    return Squares.of(part.measured, view.rows, weight, part.segments()[: part.time.size])


def _transfers(
    evidence: Evidence, final: Fit, columns: Mapping[str, np.ndarray], remains: bool, held: bool
) -> tuple[Transfer, ...]:
    """Sizes of the causes refitted to each record alone, with all other parameters and its nuisances free.

    Parameters
    ----------
    columns : record -> (n, k) derivatives by the parameters `final.names`, then by what else is free
    remains : whether the model leaves more than noise in the records of its fit
    """
    residual, nuisances = evidence.residual(final.point.simulated), evidence.tangents(final.point.simulated)
    numbers, transfers = evidence.rows(), []
    for part in evidence.parts:
        if part.name not in columns:
            continue
        own, changed = evidence.of(part.name), _changed(final, columns[part.name])
        for name in (name for c in final.candidates if c.name in changed for name in c.free):
            index = final.names.index(name)
            others = np.column_stack([np.delete(columns[part.name], index, axis=1), nuisances[own]])
            alone = _refitted(residual[own], columns[part.name][:, index], others, numbers[own], remains)
            if alone is not None:
                step, error, freedom, bias = alone
                transfers.append(Transfer(part.name, name, final.value(name) + step, error, held, freedom, bias))
    return tuple(transfers)


def _refitted(
    residual: np.ndarray, column: np.ndarray, others: np.ndarray, rows: np.ndarray, remains: bool
) -> tuple[float, float, float, float] | None:
    """Step of one parameter, its standard error and its degrees of freedom, and the standard deviation of its bias.

    A partial regression: the `others` (n, k) are free as well. What it leaves biases the step as in `bias_std`, where
    that is more than noise here, or all records together show that something remains: by a standard deviation of its
    sum of squares more then, for a sum that shows nothing may hide as much.

    The error counts what the model leaves beside the noise, as that of the joint size does; it is none less than what
    the noise alone makes. None where the others absorb the column but for the error of the derivatives.

    Parameters
    ----------
    rows : (n,) number of the row that each residual belongs to
    remains : whether the model leaves more than noise in all records together
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
    excess, std = float(remaining @ remaining) - degrees, math.sqrt(2.0 * max(degrees, 1.0))
    may_be_biased = remains or significant(excess, std)
    bias = bias_std(max(0.0, excess) + std, information) if may_be_biased else 0.0
    return step, error, max(1.0, float(freedom[0]) - projection.rank), bias  # the others take theirs


def _columns(
    pool: Pool, fitter: Fitter, evidence: Evidence, final: Fit, known: np.ndarray | None = None
) -> dict[str, np.ndarray]:
    """Derivatives (n, k) of each record by all parameters of the final model, then by values of its own that are fixed.

    A record without one of them is left out.

    Parameters
    ----------
    known : (N, k) derivatives by all parameters of the final model; None: they are taken
    """
    shared, columns_by_record = fitter.directions(final.point, final.candidates) if known is None else [], {}
    for name in evidence.names:
        directions = [*shared, *_fixed_alone(fitter, final, name)]
        own = slopes(pool, evidence.only([name]), final.point, directions, fitter.steps, "none")
        columns = [slope.column for slope in own]
        if all(column is not None for column in columns):
            first = [] if known is None else [known[evidence.of(name)]]
            columns_by_record[name] = np.column_stack([*first, *columns])
    return columns_by_record


def _fixed_alone(fitter: Fitter, final: Fit, record: str) -> list[Direction]:
    """Directions of what is fixed for this record and searched for others, such as its initial state."""
    searched = {name.partition("@")[0]: window for name, window in fitter.space.windows.items()}
    directions = []
    for name, value in final.point.values.items():
        base, _, owner = name.partition("@")
        if owner == record and base in searched and name not in final.names:
            parameter, window = fitter.model.parameters[base], searched[base]
            directions.append(Direction(name, value, window.high - window.low, parameter.low, parameter.high))
    return directions


def _sizes(transfers: tuple[Transfer, ...], threshold: float) -> dict[str, object]:
    fitted = agreements([t for t in transfers if not t.held], threshold)
    return {
        "transfers": transfers,
        "agreements": agreements(transfers, threshold),
        "fitted_agree": all(agreement.agree for agreement in fitted),
    }


def agreements(transfers: Sequence[Transfer], threshold: float) -> tuple[Agreement, ...]:
    """Whether the records agree on each size that several of them have: chi-square about the weighted mean.

    An error of few degrees of freedom counts as that of the normal distribution with the same 95 % interval. What is
    left in a record beside the noise widens it by the bias that it may make, but takes no weight from the record
    where it is asked by how much sizes vary.

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
        limit = float(stats.chi2.isf(2.0 * stats.norm.sf(threshold), degrees))
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


def _shifts(fitter: Fitter, null: Fit, final: Fit) -> tuple[Shift, ...]:
    remaining, after = excess_chi2(fitter.evidence, final), final.error(null.names)
    if significant(remaining, chi2_std(fitter.evidence)):
        after = np.hypot(after, [bias_std(remaining, final.information(name)) for name in null.names])
    errors = zip(null.names, null.error(null.names), after, strict=True)
    parameters = fitter.model.parameters
    return tuple(
        Shift(
            name,
            null.value(name),
            final.value(name),
            float(before),
            float(after),
            parameters[name.partition("@")[0]].unit,
        )
        for name, before, after in errors
        if 0.0 < before < np.inf and 0.0 < after < np.inf
    )
