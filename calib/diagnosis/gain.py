"""The gain by an extension of the model on records held out of calibration and naming."""

import math
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial
from types import MappingProxyType
from typing import Any, TypedDict

import numpy as np
import scipy

from calib.diagnosis.bench import Bench, Run, SimulatedRows, simulated
from calib.diagnosis.clock import clock_slopes
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.excess import bias_std, chi2_std, excess_chi2, excess_of_gross_errors, significant
from calib.diagnosis.fit import Fit
from calib.diagnosis.gathering import cycle_of, gathered
from calib.diagnosis.harmonic_excess import harmonic_excess, model_error_chi2
from calib.diagnosis.joint_misfit import JointMisfit, joint_misfit
from calib.diagnosis.part import Part
from calib.diagnosis.refit import Fitter
from calib.diagnosis.score import Projection
from calib.diagnosis.suspect import Refitted
from calib.diagnosis.transfer import (
    Agreement,
    Transfer,
    acting_causes,
    agreements,
    derivatives_by_record,
    refitted_to_each_record,
)
from calib.objective import Squares, misfit, row_weights
from calib.study import Pool

BOOTSTRAP_DRAWS = 2000  # of the segments of the records  [count]
NOT_COMPARED = "none of its samples counts"
RECORDS, BLOCKS = "records held out", "blocks of the calibrated records"


@dataclass(frozen=True)
class Shift:
    """The change of a calibrated parameter by the extension.

    Attributes
    ----------
    parameter : name
    before, after : values, in SI
    before_error : standard error of the calibrated value, in SI
    after_error : of the other, with its possible bias by the model error of the extended model, in SI
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
        """Its change in standard errors of the calibrated value  [1]."""
        return (self.after - self.before) / self.before_error


@dataclass(frozen=True)
class Gain:
    """Held-out misfit before and after.

    Attributes
    ----------
    kind : RECORDS, or BLOCKS where no record was held out (weak evidence)
    records : names of those held out
    before, after : `calib.objective.MISFIT` of all that was held out: of the calibrated model, refitted to the records
        as the diagnosis weighs them, and of the extended one; NaN where nothing could be compared  [1]
    interval : of before less after, by a bootstrap over segments; infinite where there is a single one  [1]
    each : record -> (before, after)
    failed : record -> why it could not be simulated or compared
    unaffected : those of the records that no cause changes: they test only the rest of the model
    transfers, agreements, shifts : see there
    fitted_agree : whether the records of the fit agree on all sizes, without the records held out
    of_one_time_record : whether both models were fitted to a single record, one over time: the points of a frequency
        response are motions of their own
    cosine : of the angle between what the causes change in the records held out and the model error that is left there;
        -inf where noise alone is left, NaN where no record was held out or could be simulated  [1]
    joint : misfit of the extended model refitted to all records at once; None where none was held out, or could not be
        simulated
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
    of_one_time_record: bool = False
    cosine: float = np.nan
    joint: JointMisfit | None = None

    @property
    def omitted(self) -> bool:
        """Whether blocks were to be compared, and the budget was spent before."""
        return self.kind == BLOCKS and not self.records

    @property
    def proven(self) -> bool:
        """Whether the misfit falls significantly."""
        return self.interval[0] > 0.0

    @property
    def refutes(self) -> bool:
        """Whether the misfit of all records held out together, of which a cause changes some, rises significantly.

        That is beyond noise, and beyond what a model error makes by chance whose direction has nothing to do with the
        causes. Or rises at all, where the causes were fitted to a single record over time, in which nothing else tests
        a prediction.
        """
        by_chance = self.cosine >= -CRITERIA.max_model_error_cosine
        rises = self.after > self.before if self.of_one_time_record else self.interval[1] < 0.0 and not by_chance
        return self.kind == RECORDS and rises and set(self.unaffected) < set(self.records)

    def covers(self, other: "Gain") -> bool:
        """Whether all records on which another gain was evaluated could be simulated here too."""
        same = self.kind == other.kind and set(self.records) >= set(other.records)
        return same and math.isfinite(self.before)


def gained(
    fitter: Fitter,
    bench: Bench,
    null: Fit,
    final: Fit,
    causes: Sequence[Refitted],
    seed: int,
    threshold: float,
) -> Gain:
    """Compare the calibrated and the extended model on records held out, or else on blocks of the calibrated ones.

    On a record held out only its own nuisances are solved for.

    Parameters
    ----------
    threshold : of the normal deviate, from which the records' sizes differ
    """
    shifts = _shifts(fitter, null, final)
    fitted = derivatives_by_record(fitter, fitter.evidence, final, final.columns)
    significant_remainder = significant(excess_chi2(fitter.evidence, final), chi2_std(fitter.evidence))
    transfers = refitted_to_each_record(fitter.evidence, final, fitted, significant_remainder, held=False)
    held = [name for name, reference in bench.objective.references.items() if reference.use == "holdout"]
    if not held:
        return _of_blocks(fitter, null, final, causes, seed, shifts=shifts, **_sizes(transfers, threshold))
    before, after, failed = _simulated(fitter.pool, held, null, final)
    if not before:
        nan = np.nan
        return Gain(RECORDS, (), nan, nan, (nan, nan), failed=failed, shifts=shifts, **_sizes(transfers, threshold))
    evidence = _held_out_evidence(fitter.pool, bench, final, before, after)
    parts = [(part, before[part.name], after[part.name]) for part in evidence.parts]
    there = replace(final, point=replace(final.point, simulated=after))
    columns = derivatives_by_record(fitter, evidence, there)
    transfers += refitted_to_each_record(evidence, there, columns, significant_remainder, held=True)
    unaffected = tuple(name for name, own in columns.items() if not acting_causes(there, own))
    everything = [(fitter.evidence, final.point.simulated, fitted), (evidence, after, columns)]
    rest = {
        "shifts": shifts,
        "of_one_time_record": [part.is_swept for part in fitter.evidence.parts] == [False],
        "cosine": _cosine_with_model_error(evidence, before, after),
        "joint": joint_misfit(final, everything),
        **_sizes(transfers, threshold),
    }
    return _summed(RECORDS, parts, seed, failed=failed, unaffected=unaffected, **rest)


def _simulated(
    pool: Pool, held: Sequence[str], null: Fit, final: Fit
) -> tuple[dict[str, SimulatedRows], dict[str, SimulatedRows], dict[str, str]]:
    """Simulations of records held out by both models, where both succeed; else why not, by name."""
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
    """Records held out with their noise, compared where the simulations of both models are reliable."""
    references = {name: bench.objective.references[name] for name in after}
    cycle = {name: cycle_of(reference) for name, reference in references.items()}
    clocks = clock_slopes(pool, bench, after, final.point.values, final.point.effects)
    evidence = gathered(references, bench.rows, cycle, after, clocks=clocks).with_weights([before, after])
    return evidence.with_remainder(Projection(evidence.tangents(after))(evidence.residual(after)))


def _cosine_with_model_error(
    evidence: Evidence, before: Mapping[str, SimulatedRows], after: Mapping[str, SimulatedRows]
) -> float:
    """Cosine between what causes change in records and the model error that is left, beyond the records' nuisances.

    The square of the latter is the excess chi-square without that of gross errors; -inf without any. The misfit rises
    where the cosine is below minus half of the length of the change over that of the model error.
    """
    nuisances = Projection(evidence.tangents(after))
    left, change = nuisances(evidence.residual(after)), nuisances(evidence.difference(before, after))
    excess = float(left @ left) - excess_of_gross_errors(evidence, after, left) - (evidence.counted() - nuisances.rank)
    size = float(np.linalg.norm(change)) * math.sqrt(max(0.0, excess))
    return float(left @ change) / size if size > 0.0 else -math.inf


def _of_blocks(fitter: Fitter, null: Fit, final: Fit, causes: Sequence[Refitted], seed: int, **rest: Any) -> Gain:
    """Fit both models to one half of every record and compare them on the other, and the other way round.

    Where the budget does not suffice for both halves, nothing is compared.
    """
    candidates = tuple(cause.candidate for cause in causes)
    sizes = {name: final.value(name) for c in candidates for name in c.free}

    def fitted(half: int, own: Fitter) -> tuple[Fit, Fit] | None:
        halved = own.on(Evidence(tuple(_half(part, half) for part in own.evidence.parts)))
        return own.attempt(lambda: (halved.fit(null.point), halved.fit(final.point, candidates, sizes)))

    parts = []
    with closing(fitter.in_turn([partial(fitted, 0), partial(fitted, 1)])) as pairs:
        for half in range(2):
            fits = next(pairs)
            if fits is None:
                return Gain(BLOCKS, (), np.nan, np.nan, (np.nan, np.nan), **rest)
            for part in (_half(part, 1 - half) for part in fitter.evidence.parts):
                before, after = (fit.point.simulated[part.name] for fit in fits)
                parts.append((part, before, after))
    return _summed(BLOCKS, parts, seed, **rest)


def _half(part: Part, half: int) -> Part:
    """Return the part compared in its first or second half only."""
    n = part.time.size
    own = (np.arange(n) >= n // 2) == bool(half)
    return replace(part, used=part.used & own, weight=part.weight * own)


def _summed(
    kind: str,
    parts: Sequence[tuple[Part, SimulatedRows, SimulatedRows]],
    seed: int,
    failed: Mapping[str, str] = MappingProxyType({}),
    **rest: Any,
) -> Gain:
    """Misfit before and after over (part, before, after); a record none of whose samples counts is left out."""
    names = tuple(dict.fromkeys(part.name for part, _, _ in parts))
    squares = {name: _squares([own for own in parts if own[0].name == name]) for name in names}
    each = {name: (misfit([one]), misfit([other])) for name, (one, other) in squares.items()}
    failed = {**failed, **{name: NOT_COMPARED for name, own in each.items() if not np.isfinite(own).all()}}
    each = {name: own for name, own in each.items() if name not in failed}
    if not each:
        return Gain(kind, (), np.nan, np.nan, (np.nan, np.nan), failed=failed, **rest)
    pairs = [squares[name] for name in each]
    before, after = misfit([one for one, _ in pairs]), misfit([other for _, other in pairs])
    return Gain(kind, tuple(each), before, after, interval_of_gain(pairs, seed), each=each, failed=failed, **rest)


def interval_of_gain(pairs: Sequence[tuple[Squares, Squares]], seed: int) -> tuple[float, float]:
    """95 % interval of the misfit before less after, of which each record has squares, by a bootstrap over segments.

    The percentiles are moved away from the estimate as Student's t asks for with so few segments (Hesterberg, The
    American Statistician 69 (2015) 371), up to the misfit before, for none is negative. A single one tells nothing of
    the error: the interval is infinite.
    """
    segments = sum(one.count.shape[1] for one, _ in pairs)
    if segments == 1:
        return -math.inf, math.inf
    rng = np.random.default_rng(seed)
    times = [_times_drawn(one.count.shape[1], rng) for one, _ in pairs]
    drawn = [[own.resampled(n) for own in pair] for pair, n in zip(pairs, times, strict=True)]
    misfits = np.sqrt(np.mean(drawn, axis=0))  # before and after
    tail = CRITERIA.tail_probability
    quantiles = np.nanquantile(misfits[0] - misfits[1], [tail, 1.0 - tail])
    before = misfit([one for one, _ in pairs])
    gain = before - misfit([other for _, other in pairs])
    wider = math.sqrt(segments / (segments - 1.0)) * scipy.stats.t.isf(tail, segments - 1) / scipy.stats.norm.isf(tail)
    low, high = gain + wider * (quantiles - gain)
    return float(low), min(float(high), before)


def _times_drawn(segments: int, rng: np.random.Generator) -> np.ndarray:
    """How often (draw, segment) each segment is among as many drawn with replacement."""
    drawn = rng.integers(segments, size=(BOOTSTRAP_DRAWS, segments)) + segments * np.arange(BOOTSTRAP_DRAWS)[:, None]
    return np.bincount(drawn.ravel(), minlength=BOOTSTRAP_DRAWS * segments).reshape(BOOTSTRAP_DRAWS, segments)


def _squares(parts: Sequence[tuple[Part, SimulatedRows, SimulatedRows]]) -> tuple[Squares, Squares]:
    """Squares of one record, of which each part has some segments, before and after."""
    squares = [[_by_segment(part, view) for view in views] for part, *views in parts]
    counted = [(one.count + other.count).sum(axis=0) > 0.0 for one, other in squares]
    drawn = [[s.drawn(c) for s in pair] for pair, c in zip(squares, counted, strict=True)]
    before, after = (
        Squares(np.hstack([s.total for s in side]), np.hstack([s.count for s in side]))
        for side in zip(*drawn, strict=True)
    )
    return before, after


def _by_segment(part: Part, view: SimulatedRows) -> Squares:
    """Squares of one record, by its segments: points of a frequency response are measured one by one."""
    weight = row_weights(part.rows, part.used, view.trust)
    segments = part.segments(1) if part.is_swept else part.segments()
    return Squares.of(part.measured, view.rows, weight, segments[: part.time.size])


class _Sizes(TypedDict):
    """The attributes of a gain on the sizes by record."""

    transfers: tuple[Transfer, ...]
    agreements: tuple[Agreement, ...]
    fitted_agree: bool


def _sizes(transfers: tuple[Transfer, ...], threshold: float) -> _Sizes:
    """Sizes by record, and whether the records agree on them."""
    fitted = agreements([t for t in transfers if not t.held], threshold)
    return {
        "transfers": transfers,
        "agreements": agreements(transfers, threshold),
        "fitted_agree": all(agreement.agree for agreement in fitted),
    }


def _shifts(fitter: Fitter, null: Fit, final: Fit) -> tuple[Shift, ...]:
    """Changes of the calibrated parameters whose standard errors are finite."""
    evidence = fitter.evidence
    harmonics = harmonic_excess(evidence, final)
    model_error = model_error_chi2(excess_chi2(evidence, final), chi2_std(evidence), harmonics)
    biases = [bias_std(model_error, final.information(name)) for name in null.names]
    errors = zip(null.names, null.error(null.names), np.hypot(final.error(null.names), biases), strict=True)
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
