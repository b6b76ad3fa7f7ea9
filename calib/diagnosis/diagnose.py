"""Diagnosis: what the simulation gets wrong, which effect is missing, and what it would bring."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from calib.cycles import kind_of_motion
from calib.diagnosis.bench import Bench, Run, simulated
from calib.diagnosis.candidate import Candidate, candidates
from calib.diagnosis.effort import Budget, Effort
from calib.diagnosis.evidence import Evidence, gathered, looked_at, outliers, rounding
from calib.diagnosis.gain import Gain, gained
from calib.diagnosis.gates import Gate, above_noise, converged, fine_enough, noise_known, same_kind, simulates
from calib.diagnosis.laboratory import UNRESTRICTED, Laboratory
from calib.diagnosis.misfit import Misfit, misfit
from calib.diagnosis.next_measurement import Design, next_measurement
from calib.diagnosis.noise import RESIDUAL, SAME
from calib.diagnosis.refit import Fit, Fitter
from calib.diagnosis.score import Projection
from calib.diagnosis.selection import HALF, NIBBLE, Selection, select
from calib.diagnosis.signature import Point
from calib.effect import Effect
from calib.objective import Objective, Reference
from calib.pool import LocalPool
from calib.study import Pool, Study

NONE, NAMED, ONE_OF, UNEXPLAINED = "none", "named", "one_of", "unexplained"
NOT_DIAGNOSABLE = "not_diagnosable"
OUTLIERS, QUANTISATION = "outliers", "quantisation"  # seen in the records themselves
FORESEEN_FITS = 4  # before anything is known: of the calibrated model, and of a few candidates
SPOILT = 3  # outliers that are taken out at least: fewer may be chance


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What a diagnosis came to.

    Attributes
    ----------
    verdict : "none", "named", "one_of", "unexplained" or "not_diagnosable"
    said : the verdict in a sentence
    gates : that were looked at first
    selection : the search for causes; None where a gate failed
    evidence : the records of calibration and naming; None where nothing could be simulated
    refused : effect -> why it was no candidate
    misfit : of the calibrated model; None where a gate failed
    outliers : share of the samples that were taken out as such  [1]
    rounding : share of the noise of a channel that its converter's steps make, where that is a cause, else 0  [1]
    gain : on records held out; None where there is nothing to try
    design : of the next measurement, where the records leave several causes indistinguishable
    seconds : wall-clock time  [s]
    simulations : that were run
    """

    verdict: str
    said: str
    gates: tuple[Gate, ...]
    selection: Selection | None = None
    evidence: Evidence | None = None
    refused: Mapping[str, str] = field(default_factory=dict)
    misfit: Misfit | None = None
    outliers: float = 0.0
    rounding: float = 0.0
    gain: Gain | None = None
    design: Design | None = None
    seconds: float = 0.0
    simulations: int = 0

    @property
    def causes(self) -> tuple[str, ...]:
        """Names of the effects that are named."""
        return (*self._spoilt, *(c.name for c in self.selection.causes)) if self.verdict == NAMED else ()

    @property
    def stand_ins(self) -> tuple[str, ...]:
        """Effects whose sizes differ among the records' channels: what acts like them is a cause that is not known."""
        selection = self.selection
        if self.verdict != UNEXPLAINED or selection is None or not selection.explained:
            return ()
        return tuple(cause.effect for cause in selection.varying)

    @property
    def _spoilt(self) -> tuple[str, ...]:
        return tuple(name for name, share in ((OUTLIERS, self.outliers), (QUANTISATION, self.rounding)) if share)

    @property
    def classes(self) -> tuple[tuple[str, ...], ...]:
        """Alternatives of which one is the cause, each a tuple of effects that act together."""
        if self.verdict not in (NAMED, ONE_OF):
            return ()
        found = self.selection.classes
        return tuple((*self._spoilt, *names) for names in found) if found else (self._spoilt,)


def diagnose(
    study: Study,
    others: Mapping[str, Reference],
    values: Mapping[str, float],
    effects: Sequence[Effect],
    seed: int = 0,
    pool: Callable[[Bench], Pool] | None = None,
    on_stage: Callable[[str], None] = lambda text: None,
    on_progress: Callable[[int, int], None] = lambda done, foreseen: None,
    budget: Budget | None = None,
    laboratory: Laboratory | None = UNRESTRICTED,
) -> Diagnosis:
    """Diagnose a calibrated study.

    Parameters
    ----------
    study : its model, objective and windows
    others : references that it is not calibrated on, by name: of use "name" and "holdout"
    values : calibrated, in SI
    effects : that may be suspected; those of site "numerical" are gates
    seed : of the noise that is drawn for the threshold
    pool : makes a pool of the function it maps; None: child processes, as many as the study's jobs
    on_stage : called with what is being done
    on_progress : called with the simulations that are done, and those that are foreseen in all
    budget : after which no further fit begins; None: none
    laboratory : within what it can do the next measurement is sought; None: none is sought

    Raises
    ------
    CalibError : a mistake in what was given
    """
    begin = time.monotonic()
    bench = bench_of(study, others)
    make = pool or (lambda function: LocalPool(function, study.jobs, study.timeout))
    with make(bench) as open_pool:
        effort = Effort(open_pool, budget, on_progress)
        found = _diagnosed(effort, bench, study, values, effects, seed, on_stage, laboratory)
    return replace(found, seconds=time.monotonic() - begin)


@dataclass(frozen=True, eq=False)
class Prepared:
    """A calibrated study, ready to be searched for causes.

    Attributes
    ----------
    gates : looked at so far
    fitter : with the evidence; None where a gate failed
    null : the calibrated model, fitted to the evidence; None where a gate failed
    suspects, refused : candidates, and effect -> why it is none
    outliers, rounding : as in `Diagnosis`
    """

    gates: tuple[Gate, ...]
    fitter: Fitter | None = None
    null: Fit | None = None
    suspects: tuple[Candidate, ...] = ()
    refused: Mapping[str, str] = field(default_factory=dict)
    outliers: float = 0.0
    rounding: float = 0.0


def bench_of(study: Study, others: Mapping[str, Reference]) -> Bench:
    """Return what the simulations of a diagnosis need of a study and of its other references."""
    objective = Objective({**study.objective.references, **others}, study.objective.terms)
    return Bench(study.model, objective, looked_at(objective))


def prepared(
    pool: Pool, bench: Bench, study: Study, values: Mapping[str, float], effects: Sequence[Effect], on_stage
) -> Prepared:
    """Look at the gates, gather the evidence, and fit the calibrated model to it."""
    references = bench.objective.references
    named = {name: r for name, r in references.items() if r.use != "holdout"}
    on_stage("gates")
    seen = dict(zip(named, simulated(pool, [Run(name, values) for name in named]), strict=True))
    gates = [simulates(seen)]
    if gates[0].passed:
        gates.append(same_kind(seen, any(reference.excitation.periodic for reference in named.values())))
        if not gates[-1].passed:
            gates += fine_enough(pool, study.model, values, seen, _numerical(effects))
    if not all(gate.passed for gate in gates):
        return Prepared(tuple(gates))
    cycle = {name: kind_of_motion(reference.record).period or 1 for name, reference in named.items()}
    evidence = gathered(named, bench.rows, cycle, seen)
    gates.append(noise_known(evidence))
    if not gates[-1].passed:
        return Prepared(tuple(gates))
    suspects, refused = candidates(study.model, effects, named, study.space.names)
    fitter = Fitter(pool, evidence, study.space, study.model)
    on_stage("calibrated model")
    scores = 1 + any(noise.source == RESIDUAL for part in evidence.parts for noise in part.noise)  # it is judged by one
    fitter.effort.foresee(fitter.expected(scores * sum(len(c.free) for c in suspects), FORESEEN_FITS))
    null = fitter.fit(Point(values, (), seen))
    spoilt = {part.name: outliers(part, null.point.seen[part.name]) for part in evidence.parts}
    share = sum(s.sum() for s in spoilt.values()) / sum(s.size for s in spoilt.values())
    sought = any(effect.noise for effect in effects)
    if not sought or sum(s.sum() for s in spoilt.values()) < SPOILT:
        spoilt, share = None, 0.0
    if spoilt is not None:
        if _spoilt_part(fitter, null, spoilt) < NIBBLE:
            share = 0.0  # taken out, but no cause to be named: the misfit is elsewhere
        fitter.evidence = gathered(named, bench.rows, cycle, null.point.seen, spoilt=spoilt)
        gates[-1] = noise_known(fitter.evidence)
        null = fitter.fit(null.point)
    if _noise_is_open(fitter.evidence, null):
        left = _left(fitter, null, [c for c in suspects if not c.effect.rough])
        fitter.evidence = gathered(named, bench.rows, cycle, null.point.seen, left, spoilt)
        gates[-1] = noise_known(fitter.evidence)
        null = fitter.fit(null.point)
    gates.append(above_noise(fitter.evidence, null))
    if not gates[-1].passed:
        return Prepared(tuple(gates), refused=refused)
    steps = min(1.0, max(float(rounding(part).max(initial=0.0)) for part in fitter.evidence.parts))
    if steps < NIBBLE or QUANTISATION not in {effect.name for effect in effects}:
        steps = 0.0
    return Prepared(tuple(gates), fitter, null, tuple(suspects), refused, float(share), steps)


def _spoilt_part(fitter: Fitter, null: Fit, spoilt: Mapping[str, np.ndarray]) -> float:
    """Share of the calibrated model's sum of squares that outliers make."""
    residual = fitter.evidence.residual(null.point.seen)
    mask = np.concatenate([spoilt[part.name].ravel() for part in fitter.evidence.parts])
    return float((residual[mask] ** 2).sum() / max((residual**2).sum(), 1e-300))


def _rounded(evidence: Evidence) -> float:
    """Sum of squares that the steps of converters add to the residual."""
    return sum(
        float(share * (1.0 + noise.memory @ noise.memory) / noise.innovation**2 * (weight**2).sum())
        for part in evidence.parts
        for share, noise, weight in zip(rounding(part), part.noise, part.weight, strict=True)
    )


def _diagnosed(
    pool: Effort,
    bench: Bench,
    study: Study,
    values: Mapping[str, float],
    effects: Sequence[Effect],
    seed: int,
    on_stage: Callable[[str], None],
    laboratory: Laboratory | None,
) -> Diagnosis:
    ready = prepared(pool, bench, study, values, effects, on_stage)
    if ready.null is None:
        failed = "; ".join(f"{gate.name}: {gate.said}" for gate in ready.gates if not gate.passed)
        return Diagnosis(NOT_DIAGNOSABLE, failed, ready.gates, simulations=pool.done)
    fitter = ready.fitter
    selection = select(fitter, ready.null, ready.suspects, seed, on_stage)
    if ready.rounding and not selection.material:
        if _rounded(fitter.evidence) < HALF * selection.excess:
            ready = replace(ready, rounding=0.0)  # seen, but no cause to be named: the misfit is elsewhere
        else:
            selection = selection.without_causes()
    gain, limit = None, selection.rounds[0].threshold
    if selection.causes:
        on_stage("gain")
        gain = gained(pool, bench, fitter, selection.null, selection.final, selection.causes, seed, limit)
    gates = (*ready.gates, *converged(fitter, selection.final, _numerical(effects), limit, selection.margin))
    if QUANTISATION in {cause.name for cause in selection.causes}:
        ready = replace(ready, rounding=0.0)
    verdict, said = _verdict(selection, gates, ready)
    said += _untried(selection)
    if verdict == ONE_OF and laboratory is not None and pool.spent:
        said += " (the budget was spent before a next measurement was sought)"
    design = None
    if verdict == ONE_OF and laboratory is not None and not pool.spent:
        on_stage("next measurement")
        pool.foresee(laboratory.simulations)
        design = next_measurement(pool, bench, fitter, selection.rivals, laboratory)
    on_stage("misfit")
    return Diagnosis(
        verdict=verdict,
        said=said,
        gates=gates,
        selection=selection,
        evidence=fitter.evidence,
        refused=ready.refused,
        outliers=ready.outliers,
        rounding=ready.rounding,
        misfit=misfit(pool, bench, fitter.evidence, selection.null, seed),
        gain=gain,
        design=design,
        simulations=pool.done,
    )


def _numerical(effects: Sequence[Effect]) -> list[Effect]:
    return [effect for effect in effects if effect.site == "numerical"]


def _noise_is_open(evidence: Evidence, null: Fit) -> bool:
    """Whether noise is to be read off what no candidate explains: its level, or the memory of a level that is stated.

    The latter only where what the calibrated model leaves is about as large as the noise: more is error of the model.
    """
    noises = [noise for part in evidence.parts for noise in part.noise]
    unknown = any(noise.source == RESIDUAL for noise in noises)
    return unknown or (null.square < SAME**2 * evidence.counted() and any(not noise.repeated for noise in noises))


def _left(fitter: Fitter, null: Fit, suspects: Sequence) -> dict[str, np.ndarray]:
    """What is left of the measured rows when all candidates are fitted to them at once, by record (row, n)."""
    slopes = [slope for own in fitter.suspected(null.point, suspects) for slope in own]
    columns = [slope.column for slope in slopes if slope.column is not None and slope.column.any()]
    everything = Projection(np.column_stack([null.columns, null.nuisances, *columns]))
    counted = fitter.evidence.counted()
    left, found = everything(null.residual), {}
    left *= np.sqrt(counted / max(1.0, counted - everything.rank))  # as large as the noise, on average
    for part in fitter.evidence.parts:
        rows = part.restored(left[fitter.evidence.of(part.name), None])[:, :, 0]
        found[part.name] = part.without_clock(rows)
    return found


def _verdict(selection: Selection, gates: Sequence[Gate], ready: Prepared) -> tuple[str, str]:
    failed = [gate for gate in gates if not gate.passed]
    if failed:
        return NOT_DIAGNOSABLE, "; ".join(f"{gate.name}: {gate.said}" for gate in failed)
    if not selection.causes:
        spoilt = [f"outliers, {ready.outliers:.1%} of the samples"] if ready.outliers else []
        spoilt += [f"quantisation, {ready.rounding:.0%} of the noise of a channel"] if ready.rounding else []
        if ready.rounding and selection.marked:
            return NAMED, f"{' and '.join(spoilt)}; no effect beside that explains what is left"
        if selection.marked:
            first = selection.rounds[0]
            said = "the misfit is more than noise, and no candidate explains it"
            if first.rejected is not None:
                return UNEXPLAINED, f"{said}; {first.rejected.name} comes closest, but {first.rejection}"
            closest = f"; {first.suspects[0].name} comes closest" if first.suspects else ""
            return UNEXPLAINED, said + closest
        if spoilt:
            return NAMED, f"{' and '.join(spoilt)}; beside that the residual is what noise leaves"
        return NONE, "the residual is what noise leaves; nothing that could be named is missing"
    names = " and ".join(c.name for c in selection.causes)
    share = f"{selection.share:.0%} of the excess misfit"
    s = "s" if len(selection.causes) == 1 else ""
    if not selection.material:
        if selection.share < HALF:
            return UNEXPLAINED, f"{names} come{s} closest, but explain{s} only {share}"
        if selection.explained:
            explain = f" and explain{s} {share}" if selection.marked else ""
            most = max(selection.varying, key=lambda c: c.z)
            differ = f"the size of {most.effect} differs among the channels of the records (z = {most.z:.2g})"
            why = "it changes, or stands for another cause"
            return UNEXPLAINED, f"{names} come{s} closest{explain}, but {differ}: {why}"
        return UNEXPLAINED, f"{names} come{s} closest and explain{s} {share}, but leave{s} more than noise"
    if len(selection.rivals) > 1:
        alike = f"; they explain {share} alike" if selection.marked else ""
        ways = [_one_of([rival.name for rival in rivals]) for rivals in selection.alternatives]
        return ONE_OF, " and ".join(ways) + alike
    return NAMED, f"{names}: explain{s} {share}" if selection.marked else names


def _untried(selection: Selection) -> str:
    """What was left out where the budget was spent, as the end of a sentence; "" where nothing was."""
    if not selection.cut_short:
        return ""
    names = [name for r in selection.rounds for name in r.untried]
    fits = f"not fitted: {', '.join(names)}; " if names else ""
    return f" (the budget was spent: {fits}further causes and exchanges of causes were not all looked for)"


def _one_of(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else "one of " + ", ".join(names)
