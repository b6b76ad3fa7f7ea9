"""What an extension brings on data that had no part in finding it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from calib.cycles import kind_of_motion
from calib.diagnosis.bench import Bench, Run, Seen, simulated
from calib.diagnosis.evidence import Evidence, Part, gathered
from calib.diagnosis.refit import Fit, Fitter, direction
from calib.diagnosis.score import Projection
from calib.diagnosis.selection import Suspect
from calib.diagnosis.signature import slopes
from calib.study import Pool

DRAWS = 2000  # of the bootstrap
LEVEL = 0.95  # of its interval
METRIC = "root mean square residual over the root mean square of the channel about its mean"
RECORDS, BLOCKS = "records held out", "blocks of the calibrated records"


@dataclass(frozen=True)
class Transfer:
    """Size of an effect as one record alone has it, the calibrated parameters as they are.

    Attributes
    ----------
    record, parameter : whose size
    size, error : estimate and standard error  [unit of the parameter]
    held : whether the record had no part in calibration and naming
    """

    record: str
    parameter: str
    size: float
    error: float
    held: bool


@dataclass(frozen=True)
class Shift:
    """What the extension does to a calibrated parameter.

    Attributes
    ----------
    parameter : name
    before, after : values, in SI
    errors : by how many standard errors (of the value after) it moves
    """

    parameter: str
    before: float
    after: float
    errors: float


@dataclass(frozen=True)
class Gain:
    """Held-out misfit before and after.

    Attributes
    ----------
    kind : RECORDS, or BLOCKS where no record was held out (weak evidence)
    records : names of what was held out
    before, after : METRIC over all that was held out  [1]
    interval : of before less after, by a bootstrap over segments  [1]
    each : record -> (before, after)
    failed : record -> why it could not be simulated
    transfers, shifts : see there
    """

    kind: str
    records: tuple[str, ...]
    before: float
    after: float
    interval: tuple[float, float]
    each: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    failed: Mapping[str, str] = field(default_factory=dict)
    transfers: tuple[Transfer, ...] = ()
    shifts: tuple[Shift, ...] = ()

    @property
    def proven(self) -> bool:
        """Whether the misfit falls for sure."""
        return self.interval[0] > 0.0


def gained(
    pool: Pool, bench: Bench, fitter: Fitter, null: Fit, final: Fit, causes: Sequence[Suspect], seed: int
) -> Gain | None:
    """Try the calibrated and the extended model on what was held out; None where nothing can be.

    On a record held out only its own nuisances are solved for.
    """
    references = bench.objective.references
    held = [name for name, reference in references.items() if reference.use == "holdout"]
    shifts = _shifts(null, final)
    if not held:
        return _of_blocks(fitter, null, final, causes, shifts, seed)
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
    if not usable:
        return Gain(RECORDS, (), np.nan, np.nan, (np.nan, np.nan), failed=failed, shifts=shifts)
    cycle = {name: kind_of_motion(references[name].record).period or 1 for name in usable}
    chosen = {name: references[name] for name in usable}
    evidence = gathered(chosen, bench.rows, cycle, after).with_weights([before, after])
    parts = [(part, before[part.name], after[part.name]) for part in evidence.parts]
    transfers = (
        *_transfers(pool, fitter.evidence, final, causes, held=False),
        *_transfers(pool, evidence, replace(final, point=replace(final.point, seen=after)), causes, held=True),
    )
    return _summed(RECORDS, parts, seed, failed=failed, transfers=transfers, shifts=shifts)


def _of_blocks(
    fitter: Fitter, null: Fit, final: Fit, causes: Sequence[Suspect], shifts: tuple[Shift, ...], seed: int
) -> Gain | None:
    """Fit both models to one half of every record and try them on the other, and the other way round."""
    candidates = tuple(cause.candidate for cause in causes)
    parts = []
    for half in (0, 1):
        own = Evidence(tuple(_half(part, half) for part in fitter.evidence.parts))
        other = Evidence(tuple(_half(part, 1 - half) for part in fitter.evidence.parts))
        halved = Fitter(fitter.pool, own, fitter.space, fitter.model)
        without = halved.fit(null.point)
        sizes = {name: final.value(name) for c in candidates for name in c.free}
        extended = halved.fit(final.point, candidates, sizes)
        for part in other.parts:
            parts.append((part, without.point.seen[part.name], extended.point.seen[part.name]))
    transfers = _transfers(fitter.pool, fitter.evidence, final, causes, held=False)
    return _summed(BLOCKS, parts, seed, transfers=transfers, shifts=shifts)


def _half(part: Part, half: int) -> Part:
    """Return the part compared in its first or second half only."""
    n = part.time.size
    kept = (np.arange(n) >= n // 2) == bool(half)
    return replace(part, weight=part.weight * kept)


def _summed(kind: str, parts: Sequence[tuple[Part, Seen, Seen]], seed: int, **rest) -> Gain:
    """Misfit before and after over (part, before, after), with the bootstrap over their segments."""
    squares, each = [], {}
    for part, before, after in parts:
        rows = [_by_segment(part, view) for view in (before, after)]
        squares.append(np.stack(rows))
        each[part.name] = tuple(float(np.sqrt(row.mean())) for row in rows)
    values = _distance(squares)
    rng = np.random.default_rng(seed)
    drawn = []
    for _ in range(DRAWS):
        picked = [s[:, rng.integers(s.shape[1], size=s.shape[1])] for s in squares]
        one = _distance(picked)
        drawn.append(one[0] - one[1])
    tail = 0.5 * (1.0 - LEVEL)
    interval = tuple(float(x) for x in np.quantile(drawn, [tail, 1.0 - tail]))
    names = tuple(dict.fromkeys(part.name for part, _, _ in parts))
    return Gain(kind, names, float(values[0]), float(values[1]), interval, each=each, **rest)


def _distance(squares: Sequence[np.ndarray]) -> np.ndarray:
    """Misfit before and after (2,) of squares (2, segment) of each record."""
    return np.sqrt(np.mean([s.mean(axis=1) for s in squares], axis=0))


def _by_segment(part: Part, view: Seen) -> np.ndarray:
    """Mean square residual of each segment that counts, over the channels' mean squares about their mean."""
    spread = part.measured - part.measured.mean(axis=1, keepdims=True)
    size = (spread**2).mean(axis=1, keepdims=True)
    weight = (part.weight**2).ravel()
    square = ((part.measured - view.rows) ** 2 / np.where(size > 0.0, size, 1.0)).ravel() * weight
    segments = part.segments()
    total, count = np.bincount(segments, square), np.bincount(segments, weight)
    return total[count > 0.0] / count[count > 0.0]


def _transfers(
    pool: Pool, evidence: Evidence, final: Fit, causes: Sequence[Suspect], held: bool
) -> tuple[Transfer, ...]:
    """Sizes of the causes as each record alone has them, what its nuisances absorb taken out."""
    parameters = [(cause.candidate, p) for cause in causes for p in cause.candidate.parameters]
    directions = [direction(final.point, candidate, p) for candidate, p in parameters]
    columns = [slope.column for slope in slopes(pool, evidence, final.point, directions, compared=False)]
    residual = evidence.residual(final.point.seen)
    found = []
    for part in evidence.parts:
        own = evidence.of(part.name)
        free = Projection(part.tangents(final.point.seen[part.name]))
        left = free(residual[own])
        for (_, p), column in zip(parameters, columns, strict=True):
            s = None if column is None else free(column[own])
            if s is None or not np.linalg.norm(s) > 0.0:
                continue
            step, error = float(s @ left / (s @ s)), float(1.0 / np.linalg.norm(s))
            found.append(Transfer(part.name, p.name, final.value(p.name) + step, error, held))
    return tuple(found)


def _shifts(null: Fit, final: Fit) -> tuple[Shift, ...]:
    errors = dict(zip(final.names, np.sqrt(np.maximum(0.0, np.diag(final.covariance))), strict=True))
    return tuple(
        Shift(name, null.value(name), final.value(name), (final.value(name) - null.value(name)) / errors[name])
        for name in null.names
        if errors.get(name, 0.0) > 0.0
    )
