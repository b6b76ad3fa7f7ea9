"""Diagnosis of a calibrated study: its misfit, the missing effect, and the gain by it."""

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace

from calib.diagnosis.bench import Bench
from calib.diagnosis.candidate import Candidate
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.effort import Budget, Effort
from calib.diagnosis.elimination import several_sizes
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.gain import Gain, gained
from calib.diagnosis.gates import Gate, above_noise, converged, noise_known
from calib.diagnosis.laboratory import UNRESTRICTED, Laboratory
from calib.diagnosis.misfit import Misfit, misfit
from calib.diagnosis.model_selection import select
from calib.diagnosis.next_measurement import Design, next_measurement
from calib.diagnosis.preparation import OUTLIERS, QUANTISATION, NotDiagnosable, Prepared, bench_of, numerical, prepared
from calib.diagnosis.record_faults import rounding
from calib.diagnosis.refit import Fitter
from calib.diagnosis.revision import exchanged, left_out, paired
from calib.diagnosis.search import simplest
from calib.diagnosis.selection import Selection
from calib.diagnosis.suspect import Refitted
from calib.diagnosis.verdict import NAMED, NOT_DIAGNOSABLE, ONE_OF, UNEXPLAINED, failures, untried, verdict_of
from calib.execution.pool import workers
from calib.modelling.effect import Effect
from calib.objective import Reference
from calib.study import CalibrationStudy, Pool

ONE_SIZE, NOT_REFUTED = "it has one size in all records", "the records held out refute the others"


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The result of a diagnosis.

    Attributes
    ----------
    verdict : "none", "named", "one_of", "unexplained" or "not_diagnosable"
    summary : the verdict in a sentence
    gates : that were tested
    selection : the search for causes; None where a gate failed
    evidence : the records of calibration and naming; None where nothing could be simulated
    refused : effect -> why it was no candidate
    misfit : of the calibrated model; None where a gate failed
    outliers : share of the samples that were removed as such  [1]
    rounding : share of the noise of a channel that is due to its converter's steps, where that is a cause, else 0  [1]
    gain : on records held out; None without causes
    design : of the next measurement, where the records leave several causes indistinguishable
    seconds : wall-clock time  [s]
    simulations : number of runs
    """

    verdict: str
    summary: str
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
        if self.verdict != NAMED or self.selection is None:
            return ()
        return (*self._record_faults, *(c.name for c in self.selection.causes))

    @property
    def stand_ins(self) -> tuple[str, ...]:
        """Effects whose sizes differ among the records: each stands in for an unknown cause."""
        selection = self.selection
        if self.verdict != UNEXPLAINED or selection is None or not selection.is_explained:
            return ()
        return tuple(dict.fromkeys(constancy.effect for constancy in selection.heterogeneous))

    @property
    def _record_faults(self) -> tuple[str, ...]:
        return tuple(name for name, share in ((OUTLIERS, self.outliers), (QUANTISATION, self.rounding)) if share)

    @property
    def classes(self) -> tuple[tuple[str, ...], ...]:
        """Alternatives of which one is the cause, each a tuple of effects that act together."""
        if self.verdict not in (NAMED, ONE_OF) or self.selection is None:
            return ()
        classes = self.selection.classes
        return tuple((*self._record_faults, *names) for names in classes) if classes else (self._record_faults,)


def diagnose(
    study: CalibrationStudy,
    others: Mapping[str, Reference],
    values: Mapping[str, float],
    effects: Sequence[Effect],
    seed: int = 0,
    pool: Callable[[Bench], AbstractContextManager[Pool]] | None = None,
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
    on_stage : called with the name of each stage as it begins
    on_progress : called with the number of simulations done, and of those expected in all
    budget : after which no further fit begins; None: none
    laboratory : in whose region the next measurement is searched; None: none is searched

    Raises
    ------
    CalibError : a mistake in the arguments
    """
    begin = time.monotonic()
    bench = bench_of(study, others)
    make = pool or (lambda function: workers(function, study.jobs, study.timeout))
    with make(bench) as open_pool:
        effort = Effort(open_pool, budget, on_progress)
        diagnosis = _diagnosed(effort, bench, study, values, effects, seed, on_stage, laboratory)
    return replace(diagnosis, seconds=time.monotonic() - begin)


def _diagnosed(
    pool: Effort,
    bench: Bench,
    study: CalibrationStudy,
    values: Mapping[str, float],
    effects: Sequence[Effect],
    seed: int,
    on_stage: Callable[[str], None],
    laboratory: Laboratory | None,
) -> Diagnosis:
    ready = prepared(pool, bench, study, values, effects, on_stage)
    if isinstance(ready, NotDiagnosable):
        return Diagnosis(NOT_DIAGNOSABLE, failures(ready.gates), ready.gates, simulations=pool.done)
    fitter = ready.fitter
    selection = select(fitter, ready.null, ready.suspects, seed, on_stage)
    ready, selection = _quantisation_or_causes(ready, selection)
    gain, threshold = None, selection.rounds[0].threshold
    if selection.causes:
        on_stage("gain")
        selection, gain = _tested_on_records(pool, bench, fitter, selection, ready.suspects, seed)
    solver = converged(fitter, selection.final, numerical(effects), threshold, selection.margin)
    gates = (*_renewed(ready.gates, fitter, selection), *solver)
    if QUANTISATION in {cause.name for cause in selection.causes}:
        ready = replace(ready, rounding=0.0)
    verdict, summary = verdict_of(selection, gates, ready, gain)
    summary += untried(selection)
    design = None
    if len(selection.rivals) > 1 and verdict == ONE_OF and laboratory is not None:
        if pool.spent:
            summary += " (the budget was spent before a next measurement was searched)"
        else:
            on_stage("next measurement")
            pool.foresee(laboratory.simulations)
            design = next_measurement(pool, bench, fitter, selection.rivals, laboratory)
    on_stage("misfit")
    return Diagnosis(
        verdict=verdict,
        summary=summary,
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


def _tested_on_records(
    pool: Effort,
    bench: Bench,
    fitter: Fitter,
    selection: Selection,
    candidates: Sequence[Candidate],
    seed: int,
) -> tuple[Selection, Gain]:
    """Test the causes on records held out, and compare their sizes from record to record.

    Where the size of a cause differs, its rivals are tried: those are preferred to it that have one size in the same
    records, each of which determines it well enough to detect the same variation. Where a misfit rises, those of all
    causes are tried: none is preferred with which that of the same records rises too. Where no rival is better, the
    cause that differs, or the weakest one, is left out if the others explain enough without it. A single cause may
    stand for two: the best pair is then tried in its place.
    """
    selection, gain = _with_gain(pool, bench, fitter, selection, seed)
    tried = exchanged_by_records = _exchanged_by_records(pool, bench, fitter, selection, gain, seed)
    while len(tried[0].causes) > 1 and tried[0].is_explained and not _stands(*tried) and not pool.spent:
        fewer = left_out(fitter, tried[0], *_least_tenable(tried[0]))
        if fewer is None:
            break
        tried = _with_gain(pool, bench, fitter, fewer, seed)
    if len(tried[0].causes) == 1 and tried[0].is_explained and not _stands_in_each_record(*tried) and not pool.spent:
        pair = paired(fitter, tried[0], candidates, seed)
        outcome = tried if pair is None else _with_gain(pool, bench, fitter, pair, seed)
        tried = outcome if _stands_in_each_record(*outcome) or (_stands(*outcome) and not _stands(*tried)) else tried
    if not _stands(*tried):
        return exchanged_by_records
    return _with_rivals_that_stand(pool, bench, fitter, *tried, seed)


def _stands(selection: Selection, gain: Gain) -> bool:
    """Whether causes explain enough, have one size each, and are not refuted by records held out."""
    return selection.is_sufficient and not gain.refutes


def _stands_in_each_record(selection: Selection, gain: Gain) -> bool:
    """Whether causes stand, and each record alone has the same sizes of them within its errors."""
    return _stands(selection, gain) and not selection.differing_by_record


def _with_rivals_that_stand(
    pool: Effort, bench: Bench, fitter: Fitter, selection: Selection, gain: Gain, seed: int
) -> tuple[Selection, Gain]:
    """Try the rivals of each cause in its place, where more than noise is left.

    Those are dropped that do not stand there, or significantly lower the misfit of the records held out by less, or
    whose sizes differ from record to record where those of the cause do not.
    """
    stands = _stands if selection.differing_by_record else _stands_in_each_record
    several = zip(selection.causes, selection.alternatives, strict=True)
    for cause, rivals in [(c, own) for c, own in several if len(own) > 1 and selection.remainder_is_significant]:
        standing = [rival for rival in rivals if rival.name == cause.name]
        for rival in (rival for rival in rivals if rival.name != cause.name):
            if pool.spent:
                return replace(selection, cut_short=True), gain
            outcome = _in_its_place(pool, bench, fitter, selection, cause, rival, "as a rival", seed)
            if outcome and stands(*outcome) and _predicts_as_well(outcome[1], gain):
                standing.append(rival)
        selection = selection.with_rivals(standing)
    return selection, gain


def _predicts_as_well(own: Gain, gain: Gain) -> bool:
    """Whether causes are tested on all records of others, whose gain is given, and may have as large a gain."""
    return own.covers(gain) and own.interval[1] >= gain.interval[0]


def _least_tenable(selection: Selection) -> tuple[Refitted, str]:
    """Return the weakest of the causes whose sizes differ, or else of all, and why it is rejected."""
    differing = {one.effect: one for one in sorted(selection.heterogeneous, key=lambda one: one.z)}
    names = list(differing) or [cause.name for cause in selection.causes]
    explained = {one.effect: one.chi2 for one in selection.constancy}
    name = min(names, key=lambda name: explained.get(name, 0.0))
    [cause] = [cause for cause in selection.causes if cause.name == name]
    return cause, several_sizes(differing[name]) if differing else "with it the misfit of the records held out rises"


def _exchanged_by_records(
    pool: Effort, bench: Bench, fitter: Fitter, selection: Selection, gain: Gain, seed: int
) -> tuple[Selection, Gain]:
    """Put a rival in the place of a cause that the records refute, or whose size differs from record to record.

    Where records held out refute the only cause and its rivals, those are tried that explained less in its search.
    """
    differing = {one.effect: one.variation for one in selection.differing_by_record}
    refuted = gain.refutes
    several = [(c, own) for c, own in zip(selection.causes, selection.alternatives, strict=True) if len(own) > 1]
    groups = [(c, own) for c, own in several if refuted or c.name in differing]
    if refuted and len(selection.causes) == 1:
        groups.append((selection.causes[0], selection.runners_up[: CRITERIA.max_runners_up]))
    for cause, rivals in groups:
        better = []
        for rival in rivals:
            if rival.name == cause.name:
                continue
            if pool.spent:
                return replace(selection, cut_short=True), gain
            reason = ONE_SIZE if cause.name in differing else NOT_REFUTED
            outcome = _in_its_place(pool, bench, fitter, selection, cause, rival, reason, seed)
            if outcome and _holds(rival, outcome, gain, differing.get(cause.name)):
                better.append((rival, outcome))
        if better:
            chosen = simplest([rival for rival, _ in better])
            [(selection, gain)] = [outcome for rival, outcome in better if rival is chosen]
            return selection.with_rivals([rival for rival, _ in better]), gain
    return selection, gain


def _in_its_place(
    pool: Effort,
    bench: Bench,
    fitter: Fitter,
    selection: Selection,
    cause: Refitted,
    rival: Refitted,
    reason: str,
    seed: int,
) -> tuple[Selection, Gain] | None:
    """Put a rival in the place of a cause, and test that on records held out; None where it is no cause there.

    reason : why, as the end of a sentence
    """
    other = exchanged(fitter, selection, cause, rival, reason)
    return None if other is None else _with_gain(pool, bench, fitter, other, seed)


def _holds(rival: Refitted, outcome: tuple[Selection, Gain], gain: Gain, differing: float | None) -> bool:
    """Whether with a rival all causes explain enough, have one size each, and are not refuted by records held out.

    outcome : the selection with it, and its gain
    gain : of the cause that it replaces
    differing : variation of the size of that cause, which has to be detectable in the rival's; None: it has none
    """
    selection, own = outcome
    if not _stands(selection, own) or not own.covers(gain):
        return False
    return differing is None or _has_one_size(rival, own, gain, differing)


def _has_one_size(rival: Refitted, own: Gain, gain: Gain, variation: float) -> bool:
    """Whether a rival has one size in all records in which that of the cause it replaces differs.

    own, gain : of the rival, and of that cause, whose size has this variation
    """
    compared = [a for a in own.agreements if a.parameter in rival.candidate.free]
    records = max((set(a.records) for a in gain.agreements), key=len)
    return bool(compared) and all(a.agree and set(a.records) >= records and a.detectable <= variation for a in compared)


def _with_gain(pool: Effort, bench: Bench, fitter: Fitter, selection: Selection, seed: int) -> tuple[Selection, Gain]:
    """Return a selection with its sizes compared from record to record, and the gain by its causes."""
    threshold = selection.rounds[0].threshold
    gain = gained(pool, bench, fitter, selection.null, selection.final, selection.causes, seed, threshold)
    return selection.with_records_compared(gain.agreements, gain.fitted_agree), gain


def _renewed(gates: Sequence[Gate], fitter: Fitter, selection: Selection) -> list[Gate]:
    """Return the gates with those of the noise tested again, after it was re-estimated."""
    latest = {gate.name: gate for gate in (noise_known(fitter.evidence), above_noise(fitter.evidence, selection.null))}
    return [latest.get(gate.name, gate) for gate in gates]


def _quantisation_or_causes(ready: Prepared, selection: Selection) -> tuple[Prepared, Selection]:
    """Drop quantisation where it explains little, else the causes, where these do not explain enough to be named."""
    if not ready.rounding or selection.is_sufficient:
        return ready, selection
    if _quantisation_chi2(ready.fitter.evidence) < CRITERIA.min_explained_share * selection.excess_chi2:
        return replace(ready, rounding=0.0), selection
    return ready, selection.without_causes()


def _quantisation_chi2(evidence: Evidence) -> float:
    """Chi-square of the residual that is due to the steps of converters."""
    return sum(
        float(share * (1.0 + noise.ar @ noise.ar) / noise.innovation**2 * (weight**2).sum())
        for part in evidence.parts
        for share, noise, weight in zip(rounding(part), part.noise, part.weight, strict=True)
    )
