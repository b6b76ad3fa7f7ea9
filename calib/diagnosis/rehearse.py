"""Rehearsal of a diagnosis: each candidate hidden in data of the study's own model, and diagnosed.

The data have the records' excitations, lengths and noise, and the calibrated values; they are made with the same solver
as the search, so that the shares of correct verdicts are upper bounds.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr

from calib.diagnosis.bench import Run, SimulatedRows, simulated
from calib.diagnosis.candidate import Candidate
from calib.diagnosis.diagnose import diagnose
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.part import Part
from calib.diagnosis.preparation import NotDiagnosable, bench_of, prepared
from calib.diagnosis.screening import screened
from calib.diagnosis.suspect import Screened, Untestable, leading_variants
from calib.diagnosis.verdict import NAMED, NONE, ONE_OF, UNEXPLAINED, failures
from calib.errors import CalibError
from calib.execution.pool import Failure, InProcess
from calib.execution.workers import workers
from calib.modelling.effect import Effect
from calib.objective import Objective, Reference
from calib.records.response import harmonic_tolerances, has_phase, modulus, parts_of, tolerances, with_harmonics
from calib.study import CalibrationStudy, Pool

HIDDEN_Z = (5.0, 10.0, 20.0, 40.0)  # sizes of a hidden effect, as the z that its information predicts  [1]
SEEDS_PER_SIZE = 3  # of the noise, for each effect and size  [count]
MAX_CASE_RATIO = 10  # simulations of a case, over those that score all candidates once; bounds its time  [1]
MIN_NAMED_SHARE = 0.75  # of the seeds, from which an effect is reliably named  [1]; convention
NOTHING, FAILED = "nothing", "failed"  # hidden; the verdict where there is none


@dataclass(frozen=True)
class RehearsalCase:
    """One rehearsal.

    Attributes
    ----------
    effect : that is hidden, NOTHING for none
    strength : predicted z of its size; NaN where it has no derivative, and 0 where nothing is hidden
    values : of its parameters, in SI
    seed : of the noise
    units : of its parameters
    """

    effect: str
    strength: float
    values: Mapping[str, float]
    seed: int
    units: Mapping[str, str] = field(default_factory=dict)

    @property
    def key(self) -> str:
        """Unique name of the case."""
        sizes = ",".join(f"{name}={value:.6g}" for name, value in self.values.items())
        return f"{self.effect}({sizes})#{self.seed}"


@dataclass(frozen=True)
class Rehearsed:
    """The result of a case.

    Attributes
    ----------
    case : see there
    verdict, causes, classes : of the diagnosis; the verdict is FAILED where there was none
    reason : why it failed
    """

    case: RehearsalCase
    verdict: str
    causes: tuple[str, ...] = ()
    classes: tuple[tuple[str, ...], ...] = ()
    reason: str = ""

    @property
    def detected(self) -> bool:
        """Whether a misfit was detected."""
        return self.verdict in (NAMED, ONE_OF, UNEXPLAINED)

    @property
    def named(self) -> bool:
        """Whether exactly the hidden effect was named."""
        return self.causes == (self.case.effect,)

    @property
    def covered(self) -> bool:
        """Whether the hidden effect is among the alternatives."""
        return any(set(names) == {self.case.effect} for names in self.classes)

    @property
    def answer(self) -> str:
        """The answer in one word: the effect, "class", "unexplained", or nothing."""
        if self.verdict == NAMED:
            return " + ".join(self.causes)
        return {ONE_OF: "class", NONE: NOTHING}.get(self.verdict, self.verdict)


@dataclass(frozen=True)
class RehearsalRates:
    """Shares of the cases of one hidden size that were diagnosed well.

    Attributes
    ----------
    hidden : effect and size, as the first of the cases has them
    cases : how many there are
    detected, named, covered : share of them of which `Rehearsed` says so; named ones are covered  [1]
    """

    hidden: RehearsalCase
    cases: int
    detected: float
    named: float
    covered: float


@dataclass(frozen=True, eq=False)
class Stage:
    """What a child process needs to rehearse a case: the study, and the noise of its records.

    Attributes
    ----------
    study, others, values, effects : as in `diagnose`
    evidence : of the real records, whose noise is drawn
    hidden : effect -> candidate that is hidden
    """

    study: CalibrationStudy
    others: Mapping[str, Reference]
    values: Mapping[str, float]
    effects: Sequence[Effect]
    evidence: Evidence
    hidden: Mapping[str, Candidate] = field(default_factory=dict)

    def __call__(self, case: RehearsalCase) -> Rehearsed:
        """Hide the effect of the case in simulated data, and diagnose them."""
        effects = () if case.effect == NOTHING else (self.hidden[case.effect].effect,)
        values = {**self.values, **case.values}
        known = {**self.study.objective.references, **self.others}
        rng, parts = np.random.default_rng([case.seed, 7]), self.evidence.parts
        driven = [_driven(known[part.name].record, part, rng) if part.is_swept else None for part in parts]
        runs = [Run(p.name, values, effects, stepped=own) for p, own in zip(parts, driven, strict=True)]
        views = simulated(InProcess(bench_of(self.study, self.others)), runs)
        made: dict[str, Reference] = {}
        for part, view in zip(parts, views, strict=True):
            if not view.usable or (part.is_swept and view.wrong):
                return Rehearsed(case, FAILED, reason=f"{part.name}: {view.wrong if view.usable else view.status}")
            reference = known[part.name]
            made[part.name] = replace(reference, record=_noisy(_simulated(view, reference.record, part), part, rng))
        scored = {name: reference for name, reference in made.items() if reference.use == "calibrate"}
        study = replace(self.study, objective=Objective(scored, self.study.objective.terms))
        others = {name: reference for name, reference in made.items() if reference.use != "calibrate"}
        diagnosis = diagnose(study, others, self.values, self.effects, seed=case.seed, pool=InProcess, laboratory=None)
        return Rehearsed(case, diagnosis.verdict, diagnosis.causes, diagnosis.classes)


def _driven(measured: xr.Dataset, part: Part, rng: np.random.Generator) -> xr.Dataset:
    """Return a frequency response whose frequencies are those that were driven, not those that were noted.

    They differ by as much noise, in standard uncertainties, as the parts have: of a point it is known across the curve.
    """
    level = np.sqrt(np.mean([noise.sigma**2 for noise in part.noise]))
    off = level * tolerances(measured)[0] * rng.standard_normal(measured.sizes["point"])
    return measured.assign(frequency=measured["frequency"] + xr.DataArray(off, dims="point"))


def _simulated(view: SimulatedRows, measured: xr.Dataset, part: Part) -> xr.Dataset:
    """Return a record with what was simulated in the place of what was measured."""
    if part.is_swept:
        read = with_harmonics(measured, view.read)
        return read if has_phase(measured) else modulus(read)
    record = measured.copy(deep=True)
    bodies = [str(body) for body in record.body.values]
    for (body, channel), row in zip(part.rows, view.rows, strict=True):
        record[channel].values[bodies.index(body)] = row
    return record


def _noisy(record: xr.Dataset, part: Part, rng: np.random.Generator) -> xr.Dataset:
    """Return a record with noise like that of a part, which of a frequency response is in standard uncertainties."""
    noisy = record.copy(deep=True)
    bodies = [str(body) for body in record.body.values]
    parts, units = (parts_of(record), harmonic_tolerances(record)) if part.is_swept else ((), np.ones(0))
    for (body, channel), noise in zip(part.rows, part.noise, strict=True):
        own = noisy[channel].values[bodies.index(body)]
        unit = units[parts.index(channel) // 2, bodies.index(body)] if part.is_swept else 1.0
        own += unit * noise.drawn(rng, own.size)
        if part.is_swept and not has_phase(record):
            np.abs(own, out=own)
    return noisy


def rehearse(
    study: CalibrationStudy,
    others: Mapping[str, Reference],
    values: Mapping[str, float],
    effects: Sequence[Effect],
    *,
    strengths: Sequence[float] = HIDDEN_Z,
    seeds: int = SEEDS_PER_SIZE,
    done: Mapping[str, Rehearsed] | None = None,
    pool: Callable[[Stage], AbstractContextManager[Pool]] | None = None,
    on_case: Callable[[Rehearsed, int, int], None] = lambda rehearsed, number, of: None,
) -> list[Rehearsed]:
    """Hide each candidate at several sizes, several times, and diagnose the data.

    Parameters
    ----------
    study, others, values, effects : as in `calib.diagnosis.diagnose.diagnose`; records held out take no part
    strengths : sizes, by their predicted z
    seeds : cases of each effect and size
    done : cases that were rehearsed before, by their key; those that failed are played again
    on_case : called as a case ends, with its number and how many there are

    Raises
    ------
    CalibError : the study cannot be diagnosed at all
    """
    others = {name: reference for name, reference in others.items() if reference.use != "holdout"}
    bench = bench_of(study, others)
    with workers(bench, study.evaluated_by, study.timeout, modules=study.code) as open_pool:
        ready = prepared(open_pool, bench, study, values, effects, lambda text: None)
        if isinstance(ready, NotDiagnosable):
            raise CalibError(f"the study cannot be rehearsed, for it cannot be diagnosed: {failures(ready.gates)}")
        suspects, _ = screened(ready.fitter, ready.null, ready.suspects, study.seed, staged=False)
        simulations = MAX_CASE_RATIO * max(ready.fitter.effort.done, ready.fitter.effort.foreseen)
    fitted = ready.null.point.values
    variants = leading_variants(suspects)
    cases = [RehearsalCase(NOTHING, 0.0, {}, seed) for seed in range(seeds * len(strengths))]
    for suspect in reversed(variants):
        units = {p.name: p.unit for p in suspect.candidate.effect.parameters}
        for strength, sizes in _sizes(suspect, strengths):
            values = suspect.candidate.values(sizes)
            cases += [RehearsalCase(suspect.name, strength, values, seed, units) for seed in range(seeds)]
    known = {key: one for key, one in (done or {}).items() if one.verdict != FAILED}
    answered = {case.key: replace(known[case.key], case=case) for case in cases if case.key in known}
    todo = [case for case in cases if case.key not in answered]
    hidden = {suspect.name: suspect.candidate for suspect in variants}
    stage = Stage(study.without_search(), others, fitted, list(effects), ready.fitter.evidence, hidden)
    # a case is a diagnosis of its own: each of its simulations may take as long as the study allows to one
    limit = None if study.timeout is None else study.timeout * simulations
    make = pool or (lambda function: workers(function, study.evaluated_by, limit, modules=study.code))
    with make(stage) as stages:
        for index, answer in stages.map(todo):
            case = todo[index]
            rehearsed = Rehearsed(case, FAILED, reason=answer.reason) if isinstance(answer, Failure) else answer
            answered[case.key] = rehearsed
            on_case(rehearsed, len(answered), len(cases))
    return [answered[case.key] for case in cases]


def _sizes(suspect: Screened, strengths: Sequence[float]) -> list[tuple[float, np.ndarray]]:
    """Sizes (p,) to hide: of the first parameter that the records determine, with their predicted z."""
    candidate = suspect.candidate
    if isinstance(suspect, Untestable):
        return [(np.nan, row) for row in candidate.sizes]
    error = suspect.error
    determined = [k for k in range(error.size) if np.isfinite(error[k])]
    if not determined:
        return []
    first = determined[0]
    hidden: dict[float, np.ndarray] = {}
    for strength in strengths:
        sizes = candidate.null.copy()
        sizes[first] += strength * error[first] * (1.0 if sizes[first] < candidate.high[first] else -1.0)
        sizes = np.clip(sizes, candidate.low, candidate.high)
        reached = abs(sizes[first] - candidate.null[first]) / error[first]
        hidden.setdefault(strength if math.isclose(reached, strength) else float(reached), sizes)
    return list(hidden.items())


def rates(rehearsed: Sequence[Rehearsed]) -> list[RehearsalRates]:
    """Share of the cases of each effect and size that were detected, named, and covered by the alternatives."""
    groups: dict[tuple[str, tuple[float, ...]], list[Rehearsed]] = {}
    for one in rehearsed:
        groups.setdefault((one.case.effect, tuple(one.case.values.values())), []).append(one)
    return [
        RehearsalRates(
            members[0].case,
            cases=len(members),
            detected=sum(one.detected for one in members) / len(members),
            named=sum(one.named for one in members) / len(members),
            covered=sum(one.covered or one.named for one in members) / len(members),
        )
        for members in groups.values()
    ]


def smallest(rehearsed: Sequence[Rehearsed]) -> dict[str, RehearsalRates | None]:
    """Smallest rehearsed size from which on each effect is reliably named; None where there is none."""
    smallest_sizes: dict[str, RehearsalRates | None] = {}
    unreliable: set[str] = set()
    for row in reversed(rates(rehearsed)):  # sizes rise
        effect = row.hidden.effect
        if effect == NOTHING or effect in unreliable:
            continue
        if row.named >= MIN_NAMED_SHARE:
            smallest_sizes[effect] = row
        else:
            unreliable.add(effect)
            smallest_sizes.setdefault(effect, None)
    return smallest_sizes


def confusion(rehearsed: Sequence[Rehearsed]) -> tuple[list[str], list[str], np.ndarray]:
    """Hidden effects, answers, and the share (hidden, answer) of the cases of each with that answer."""
    hidden = list(dict.fromkeys(one.case.effect for one in rehearsed))
    answers = [*hidden, "class", UNEXPLAINED]
    answers += [a for a in dict.fromkeys(one.answer for one in rehearsed) if a not in answers]
    table = np.zeros((len(hidden), len(answers)))
    for one in rehearsed:
        table[hidden.index(one.case.effect), answers.index(one.answer)] += 1.0
    return hidden, answers, table / table.sum(axis=1, keepdims=True)
