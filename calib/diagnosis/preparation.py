"""Preparation of a calibrated study for the search for causes: its gates, its evidence, its fit."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from calib.diagnosis.bench import Bench, Run, SimulatedRows, simulated
from calib.diagnosis.candidate import Candidate, candidates
from calib.diagnosis.clock import clock_slopes
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.evidence import Evidence, clocks_differ, pairs_compared
from calib.diagnosis.excess import chi2_std, dominant, excess_chi2
from calib.diagnosis.fit import Fit
from calib.diagnosis.foresight import foresee_scores, foresee_search
from calib.diagnosis.gates import Gate, above_noise, fine_enough, noise_known, same_kind, simulates
from calib.diagnosis.gathering import cycle_of, gathered
from calib.diagnosis.noise import RESIDUAL, Remainder
from calib.diagnosis.record_faults import outliers, rounding
from calib.diagnosis.refit import Fitter
from calib.diagnosis.remainder import remainder
from calib.diagnosis.signature import Point
from calib.diagnosis.stages import Stages
from calib.execution.pool import OpenPool
from calib.execution.workers import workers
from calib.modelling.effect import Effect
from calib.objective import Objective, Reference
from calib.study import CalibrationStudy, Pool

OUTLIERS, QUANTISATION = "outliers", "quantisation"  # faults of the records themselves


@dataclass(frozen=True)
class NotDiagnosable:
    """A calibrated study of which a gate failed.

    Attributes
    ----------
    gates : that were tested, the last of which failed
    """

    gates: tuple[Gate, ...]


@dataclass(frozen=True, eq=False)
class Prepared:
    """A calibrated study, prepared for the search for causes.

    Attributes
    ----------
    gates : that were tested
    fitter : with the evidence
    null : the calibrated model, fitted to the evidence
    suspects, refused : candidates, and effect -> why it is none
    outliers : share of the samples that were removed as such, 0 where that is no cause to be named  [1]
    rounding : share of the noise of a channel that is due to its converter's steps, where that is a cause, else 0  [1]
    """

    gates: tuple[Gate, ...]
    fitter: Fitter
    null: Fit
    suspects: tuple[Candidate, ...] = ()
    refused: Mapping[str, str] = field(default_factory=dict)
    outliers: float = 0.0
    rounding: float = 0.0


def pool_of(study: CalibrationStudy, stages: Stages, bench: Bench) -> OpenPool:
    """Open the pool that a study states, for its bench; the stages are told when it compiles."""
    return workers(bench, study.evaluated_by, study.timeout, modules=study.code, on_compiling=stages.compiling)


def bench_of(study: CalibrationStudy, others: Mapping[str, Reference]) -> Bench:
    """Return what the simulations of a diagnosis need of a study and of its other references."""
    objective = Objective({**study.objective.references, **others}, study.objective.terms, study.objective.elsewhere)
    return Bench(study.model, objective, pairs_compared(objective))


def prepared(
    pool: Pool,
    bench: Bench,
    study: CalibrationStudy,
    values: Mapping[str, float],
    effects: Sequence[Effect],
    on_stage: Callable[[str], None],
) -> Prepared | NotDiagnosable:
    """Test the gates, gather the evidence, and fit the calibrated model to it."""
    references = {name: r for name, r in bench.objective.references.items() if r.use != "holdout"}
    on_stage("gates")
    views = dict(zip(references, simulated(pool, [Run(name, values) for name in references]), strict=True))
    gates = _gates_of_simulations(pool, study, references, values, views, effects)
    if not all(gate.passed for gate in gates):
        return NotDiagnosable(tuple(gates))
    cycle = {name: cycle_of(reference) for name, reference in references.items()}
    records = _Records(references, bench.rows, cycle)
    evidence = records.evidence(views, clock_slopes(pool, bench, views, values))
    gates.append(noise_known(evidence))
    if not gates[-1].passed:
        return NotDiagnosable(tuple(gates))
    suspects, refused = candidates(study.model, effects, references, study.space.names)
    fitter = Fitter(pool, evidence, study.space, study.model)
    on_stage("calibrated model")
    foresee_search(fitter, None, 0, suspects)
    fitter.effort.foresee(fitter.expected_simulations(_expected_scores(evidence, suspects), 1))
    null = _fitted_beside_clocks(fitter, fitter.fit(Point(values, (), views)))
    foresee_search(fitter, null, 0, suspects)
    masks, share = _outliers(fitter, null, effects)
    if masks is not None:
        null, gates[-1] = _regathered(fitter, null, bench, records, None, masks)
    if _is_noise_undetermined(fitter.evidence, null):
        # those that generalise others change the records similarly, and would leave the noise no more
        explaining = [c for c in suspects if c.effect.differentiable and not c.effect.generalises]
        foresee_scores(fitter, [*explaining, *suspects])
        slopes = fitter.candidate_slopes(null, explaining)
        columns = [slope.column for own in slopes for slope in own if slope.column is not None]
        left = remainder(fitter.evidence, null, columns)
        null, gates[-1] = _regathered(fitter, null, bench, records, left, masks)
    gates.append(above_noise(fitter.evidence, null))
    if not gates[-1].passed:
        return NotDiagnosable(tuple(gates))
    steps = _quantisation(fitter.evidence, effects)
    return Prepared(tuple(gates), fitter, null, tuple(suspects), refused, share, steps)


@dataclass(frozen=True, eq=False)
class _Records:
    """The records from which evidence is gathered: arguments of `gathered`."""

    references: Mapping[str, Reference]
    rows: Mapping[str, Sequence[tuple[str, str]]]
    cycle: Mapping[str, int]

    def evidence(
        self,
        views: Mapping[str, SimulatedRows],
        clocks: Mapping[str, np.ndarray],
        left: Mapping[str, Remainder] | None = None,
        masks: Mapping[str, np.ndarray] | None = None,
    ) -> Evidence:
        """Evidence beside these simulations; noise by what is `left` of each, without the masked samples (row, n).

        clocks : as `clock_slopes` gives them
        """
        return gathered(self.references, self.rows, self.cycle, views, left, masks, clocks)


def _gates_of_simulations(
    pool: Pool,
    study: CalibrationStudy,
    references: Mapping[str, Reference],
    values: Mapping[str, float],
    views: Mapping[str, SimulatedRows],
    effects: Sequence[Effect],
) -> list[Gate]:
    """Test whether all records can be simulated with the measured kind of motion, or whether the solver prevents it."""
    gates = [simulates(views)]
    if gates[0].passed:
        periodic = any(r.excitation.periodic and not r.is_swept for r in references.values())
        gates.append(same_kind(views, periodic))
        if not gates[-1].passed:
            gates += fine_enough(pool, study.model, values, views, numerical(effects))
    return gates


def _expected_scores(evidence: Evidence, suspects: Sequence[Candidate]) -> int:
    """Number of parameters to be scored; most of them twice where the noise is estimated from what they all leave."""
    twice = any(noise.source == RESIDUAL for part in evidence.parts for noise in part.compared_noise)
    return sum(len(c.free) * (2 if twice and not c.effect.generalises else 1) for c in suspects)


def _regathered(
    fitter: Fitter,
    null: Fit,
    bench: Bench,
    records: _Records,
    left: Mapping[str, Remainder] | None,
    masks: Mapping[str, np.ndarray] | None,
) -> tuple[Fit, Gate]:
    """Gather the evidence again with the calibrated model, and fit that to it; beside the fit the gate of its noise."""
    clocks = clock_slopes(fitter.effort, bench, null.point.simulated, null.point.values)
    fitter.evidence = records.evidence(null.point.simulated, clocks, left, masks)
    gate = noise_known(fitter.evidence)
    return _fitted_beside_clocks(fitter, fitter.fit(null.point)), gate


def _fitted_beside_clocks(fitter: Fitter, null: Fit) -> Fit:
    """Refit the calibrated model where its residual now masks the uncertainty of a clock, or masks it no longer."""
    evidence = fitter.evidence.with_remainder(null.residual)
    if not clocks_differ(evidence, fitter.evidence):
        return null
    fitter.evidence = evidence
    return fitter.fit(null.point)


def _outliers(fitter: Fitter, null: Fit, effects: Sequence[Effect]) -> tuple[Mapping[str, np.ndarray] | None, float]:
    """Masks (row, n) of outliers by record, None where none are removed, and their share of the samples.

    The share is 0 where they are removed, but are no cause to be named: the misfit is elsewhere.
    """
    masks = {part.name: outliers(part, null.point.simulated[part.name]) for part in fitter.evidence.parts}
    count = sum(mask.sum() for mask in masks.values())
    if not any(effect.noise for effect in effects) or count < CRITERIA.min_outliers:
        return None, 0.0
    residual = fitter.evidence.residual(null.point.simulated)
    masked = np.concatenate([masks[part.name].ravel() for part in fitter.evidence.parts])
    chi2_share = float((residual[masked] ** 2).sum() / max((residual**2).sum(), 1e-300))
    named = chi2_share >= CRITERIA.min_outlier_share
    return masks, float(count / sum(mask.size for mask in masks.values())) if named else 0.0


def _quantisation(evidence: Evidence, effects: Sequence[Effect]) -> float:
    """Largest share of the noise of a channel by its converter's steps; 0 where that is no cause to be named."""
    share = min(1.0, max(float(rounding(part).max(initial=0.0)) for part in evidence.parts))
    suspected = QUANTISATION in {effect.name for effect in effects}
    return share if suspected and share >= CRITERIA.min_quantisation_share else 0.0


def numerical(effects: Sequence[Effect]) -> list[Effect]:
    """Effects of the solver, which are gates."""
    return [effect for effect in effects if effect.site == "numerical"]


def _is_noise_undetermined(evidence: Evidence, null: Fit) -> bool:
    """Whether noise has to be estimated from what no candidate explains: its level, or only its autocorrelation.

    The latter only where the residual of the calibrated model is mostly noise.
    """
    noises = [noise for part in evidence.parts for noise in part.compared_noise]
    unknown = any(noise.source == RESIDUAL for noise in noises)
    if unknown or all(noise.repeated for noise in noises):
        return unknown
    return not dominant(excess_chi2(evidence, null), chi2_std(evidence))
