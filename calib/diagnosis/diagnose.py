"""Diagnosis of a calibrated study: its misfit, the missing effect, and the gain by it."""

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, closing
from dataclasses import dataclass, field, replace
from functools import partial

from calib.diagnosis.bench import Bench
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.effort import SETTINGS, Budget, BudgetSpent, Effort
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.foresight import NEXT_MEASUREMENT, foresee_rivals
from calib.diagnosis.gain import Gain
from calib.diagnosis.gates import Gate, above_noise, budget_too_small, converged, noise_known
from calib.diagnosis.laboratory import UNRESTRICTED, Laboratory
from calib.diagnosis.levels.comparison import compared_levels
from calib.diagnosis.levels.document import LevelsResult
from calib.diagnosis.misfit import Misfit, misfit
from calib.diagnosis.model_selection import select
from calib.diagnosis.next_measurement import MAX_MODELS, Design, next_measurement
from calib.diagnosis.preparation import (
    OUTLIERS,
    QUANTISATION,
    NotDiagnosable,
    Prepared,
    bench_of,
    numerical,
    pool_of,
    prepared,
)
from calib.diagnosis.record_faults import rounding
from calib.diagnosis.refit import Fitter
from calib.diagnosis.refutation import revised_by_records
from calib.diagnosis.selection import Selection
from calib.diagnosis.speculation import SpeculativePool
from calib.diagnosis.stages import Stages
from calib.diagnosis.verdict import NAMED, NOT_DIAGNOSABLE, ONE_OF, UNEXPLAINED, failures, joined, omitted, verdict_of
from calib.execution.pool import OpenPool
from calib.modelling.effect import Effect
from calib.objective import Reference
from calib.store.kept_results import KeptResults
from calib.study import CalibrationStudy

SIMULATIONS_PER_HELD_RECORD = 4  # by two models, and for the rate of its clock with two  [count]


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The result of a diagnosis.

    Attributes
    ----------
    verdict : "none", "named", "one_of", "unexplained" or "not_diagnosable"
    summary : the verdict in a sentence
    omitted : what was left out for the budget, each as a clause
    gates : that were tested
    selection : the search for causes; None where a gate failed before it
    evidence : the records of calibration and naming; None where nothing could be simulated
    refused : effect -> why it was no candidate
    misfit : of the calibrated model; None where a gate failed before the search
    outliers : share of the samples that were removed as such  [1]
    rounding : share of the noise of a channel that is due to its converter's steps, where that is a cause, else 0  [1]
    gain : on records held out; None without causes
    design : of the next measurement, where the records leave several causes indistinguishable
    levels : frequency responses of several levels, compared with the models level by level
    seconds : wall-clock time  [s]
    simulations : number of runs, those included whose result was known
    cut_short : whether something was left out or broken off for the budget
    """

    verdict: str
    summary: str
    gates: tuple[Gate, ...]
    omitted: tuple[str, ...] = ()
    selection: Selection | None = None
    evidence: Evidence | None = None
    refused: Mapping[str, str] = field(default_factory=dict)
    misfit: Misfit | None = None
    outliers: float = 0.0
    rounding: float = 0.0
    gain: Gain | None = None
    design: Design | None = None
    levels: tuple[LevelsResult, ...] = ()
    seconds: float = 0.0
    simulations: int = 0
    cut_short: bool = False

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
    pool: Callable[[Bench], AbstractContextManager[OpenPool]] | None = None,
    on_stage: Callable[[str], None] = lambda text: None,
    on_progress: Callable[[int, int], None] = lambda done, foreseen: None,
    budget: Budget | None = None,
    laboratory: Laboratory | None = UNRESTRICTED,
    kept: KeptResults | None = None,
) -> Diagnosis:
    """Diagnose a calibrated study.

    Parameters
    ----------
    study : its model, objective and windows
    others : references that it is not calibrated on, by name: of use "name" and "holdout"
    values : calibrated, in SI
    effects : that may be suspected; those of site "numerical" are gates
    seed : of the noise that is drawn for the threshold
    pool : makes a pool of the function it maps; None: that of the study
    on_stage : called with the name of each stage as it begins; see `Stages`
    on_progress : called with the number of simulations done, and of those expected in all
    budget : within which the search ends, be it in the middle of a fit; None: none
    laboratory : in whose region the next measurement is searched; None: none is searched
    kept : file in which simulations outlive the process; None: none

    Raises
    ------
    CalibError : a mistake in the arguments
    """
    begin, stages = time.monotonic(), Stages(on_stage)
    bench = bench_of(study, others)
    with (
        (pool or partial(pool_of, study, stages))(bench) as open_pool,
        closing(SpeculativePool(open_pool, (open_pool.width or 1) - 1, kept)) as ahead,
    ):
        effort = Effort(ahead, budget, on_progress)
        diagnosis = _diagnosed(effort, bench, study, values, effects, seed, stages, laboratory)
    return replace(diagnosis, seconds=time.monotonic() - begin, cut_short=effort.spent)


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
    ready = pool.attempt(partial(prepared, pool, bench, study, values, effects, on_stage))
    if ready is None:
        ready = NotDiagnosable((budget_too_small(pool, "the fit of the calibrated model"),))
    if isinstance(ready, NotDiagnosable):
        return Diagnosis(NOT_DIAGNOSABLE, failures(ready.gates), ready.gates, simulations=pool.done)
    fitter = ready.fitter
    pool.reserve = _conclusion(fitter, bench, effects)
    if laboratory is not None:
        pool.priors[SETTINGS] = laboratory.simulations
    try:
        selection = select(fitter, ready.null, ready.suspects, seed, on_stage)
    except BudgetSpent:
        return _untested(pool, ready)
    ready, selection = _quantisation_or_causes(ready, selection)
    foresee_rivals(fitter, float(len(selection.rivals) > 1))
    gain, threshold = None, selection.rounds[0].threshold
    if selection.causes:
        on_stage("gain, without fits: the budget is spent" if pool.spent or pool.left < 1.0 else "gain")
        pool.reserve = len(fitter.evidence.parts) * (len(numerical(effects)) + 1)  # the gain itself is made in any case
        selection, gain = revised_by_records(fitter, bench, selection, ready.suspects, seed)
    solver = converged(fitter, selection.final, numerical(effects), threshold, selection.margin)
    gates = (*_renewed(ready.gates, fitter, selection), *solver)
    unfitted = () if selection.causes else selection.rounds[0].untried
    if unfitted:
        gates = (*gates, budget_too_small(pool, f"a fit of {joined(unfitted)}"))
    if QUANTISATION in {cause.name for cause in selection.causes}:
        ready = replace(ready, rounding=0.0)
    verdict, summary = verdict_of(selection, gates, ready, gain)
    left_out = () if unfitted else omitted(selection, gain)
    design = None
    if len(selection.rivals) > 1 and verdict == ONE_OF and laboratory is not None:
        design, remarks = _designed(pool, bench, fitter, selection, laboratory, on_stage)
        left_out += remarks
    on_stage("misfit")
    return Diagnosis(
        verdict=verdict,
        summary=summary,
        gates=gates,
        omitted=left_out,
        selection=selection,
        evidence=fitter.evidence,
        refused=ready.refused,
        outliers=ready.outliers,
        rounding=ready.rounding,
        misfit=misfit(pool, bench, fitter.evidence, selection.null, seed),
        gain=gain,
        design=design,
        levels=compared_levels(pool, bench, fitter.evidence.parts, selection),
        simulations=pool.done,
    )


def _untested(pool: Effort, ready: Prepared) -> Diagnosis:
    """Diagnosis whose budget was spent before all candidates were tested."""
    gates = (*ready.gates, budget_too_small(pool, "the score test of every candidate"))
    return Diagnosis(
        NOT_DIAGNOSABLE, failures(gates), gates, evidence=ready.fitter.evidence, refused=ready.refused,
        outliers=ready.outliers, rounding=ready.rounding, simulations=pool.done,
    )  # fmt: skip


def _conclusion(fitter: Fitter, bench: Bench, effects: Sequence[Effect]) -> int:
    """Simulations that follow the search in any case: of derivatives, of the gain, of the solver, and of the misfit."""
    held = sum(reference.use == "holdout" for reference in bench.objective.references.values())
    derivatives = len(fitter.space.windows) + CRITERIA.max_causes
    of_each = derivatives + len(numerical(effects)) + 1
    return len(fitter.evidence.parts) * of_each + held * (derivatives + SIMULATIONS_PER_HELD_RECORD)


def _designed(
    pool: Effort,
    bench: Bench,
    fitter: Fitter,
    selection: Selection,
    laboratory: Laboratory,
    on_stage: Callable[[str], None],
) -> tuple[Design | None, tuple[str, ...]]:
    """Next measurement as far as the budget suffices, and what of its search was left out, as clauses."""
    pool.reserve = len(fitter.evidence.parts)  # for the misfit
    if pool.left < MAX_MODELS * len(fitter.evidence.parts) * len(selection.final.names):
        pool.spent = True
        return None, ("no next measurement was searched",)
    on_stage("next measurement")
    pool.later.pop(NEXT_MEASUREMENT, None)
    pool.foresee(min(laboratory.simulations, pool.left))
    design = next_measurement(pool, bench, fitter, selection.rivals, laboratory)
    if design is None or design.max_simulations == laboratory.simulations:
        return design, ()
    few = f"{design.max_simulations} of {laboratory.simulations} simulations"
    return design, (f"the next measurement was searched with {few}",)


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
