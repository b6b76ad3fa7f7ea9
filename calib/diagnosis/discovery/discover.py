"""Where a missing force acts, and of what it is a function: free forces fitted inside the simulator, and compared."""

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, closing
from dataclasses import replace
from functools import partial

import numpy as np

from calib.diagnosis.bench import Bench
from calib.diagnosis.candidate import Candidate, candidates
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.discovery.document import OF_HISTORY
from calib.diagnosis.discovery.formulas import expected_of_formulas, formulas_of
from calib.diagnosis.discovery.free_force import SURFACE_COEFFICIENTS, FreeForce, free_force
from calib.diagnosis.discovery.history import history_trials
from calib.diagnosis.discovery.left_out import left_out_misfit
from calib.diagnosis.discovery.outcome import FOUND, NOT_DIAGNOSABLE, NOTHING, UNDETERMINED, Discovery
from calib.diagnosis.discovery.penalised import FreeModel, PenalisedFit, nested, penalised_fit, visited_states
from calib.diagnosis.discovery.place import ForcePlace, VisitedRegion, force_places, visited_regions
from calib.diagnosis.discovery.summary import (
    CUT_SHORT,
    NO_STEP,
    UNTESTED,
    UNTOLD,
    summary_of,
    summary_of_history,
)
from calib.diagnosis.discovery.trial import (
    OF_DISPLACEMENT,
    OF_STATE,
    OF_VELOCITY,
    Arguments,
    ForceTrial,
    described,
)
from calib.diagnosis.discovery.visited_curve import curve_in_words, is_open_curve
from calib.diagnosis.effort import Budget, Effort
from calib.diagnosis.excess import chi2_std, excess_chi2, significant
from calib.diagnosis.fit import Fit
from calib.diagnosis.preparation import NotDiagnosable, Prepared, bench_of, numerical, pool_of, prepared
from calib.diagnosis.screening import KnownDerivatives, screened
from calib.diagnosis.speculation import SpeculativePool
from calib.diagnosis.stages import Stages
from calib.diagnosis.suspect import Scored, Screened, is_testable
from calib.diagnosis.verdict import failures
from calib.execution.pool import OpenPool
from calib.modelling.effect import Effect
from calib.modelling.simulator import Simulator
from calib.objective import Reference
from calib.store.kept_results import KeptResults
from calib.study import CalibrationStudy

FITS_PER_PLACE, STEPS_PER_FREE_FIT = 3, 8  # as measured  [count]
SIMULATIONS_PER_COEFFICIENT = 2.5  # of each record for its derivative, as measured  [count]
DERIVATIVES_PER_SURFACE_FIT = 1.5  # by all coefficients, as measured  [count]
EXPECTED_FORMULAS = 8  # that are refitted, as measured  [count]


def discover(
    study: CalibrationStudy,
    others: Mapping[str, Reference],
    values: Mapping[str, float],
    effects: Sequence[Effect],
    seed: int = 0,
    pool: Callable[[Bench], AbstractContextManager[OpenPool]] | None = None,
    on_stage: Callable[[str], None] = lambda text: None,
    on_progress: Callable[[int, int], None] = lambda done, foreseen: None,
    budget: Budget | None = None,
    kept: KeptResults | None = None,
) -> Discovery:
    """Search for the force that a calibrated study misses, as a free function of the state of a body or interface.

    Parameters
    ----------
    study : its model, objective and windows; effects that the model has are free at the same time
    others : references that it is not calibrated on, by name; those of use "holdout" are not looked at
    values : calibrated, in SI
    effects : of which those of the noise and of the solver count
    seed : of the noise that is drawn for the threshold
    pool : makes a pool of the function it maps; None: that of the study
    on_stage, on_progress : called with the stage that begins; with simulations done, and those expected in all
    budget : after which no further fit begins, but for the first; None: none
    kept : file in which simulations outlive the process; None: none

    Raises
    ------
    CalibError : a mistake in the arguments
    """
    begin, stages = time.monotonic(), Stages(on_stage)
    bench = bench_of(study, others)
    make = pool or partial(pool_of, study, stages)
    with make(bench) as open_pool, closing(SpeculativePool(open_pool, kept=kept)) as ahead:
        effort = Effort(ahead, budget, on_progress)
        discovery = _discovered(effort, bench, study, values, effects, seed, stages)
    return replace(discovery, seconds=time.monotonic() - begin, simulations=effort.done, cut_short=effort.spent)


def _discovered(
    pool: Effort,
    bench: Bench,
    study: CalibrationStudy,
    values: Mapping[str, float],
    effects: Sequence[Effect],
    seed: int,
    on_stage: Callable[[str], None],
) -> Discovery:
    reason = _refusal(study.model.simulator)
    if reason:
        return Discovery(NOT_DIAGNOSABLE, reason, ())
    places = {place.name: place for place in force_places(bench.model.simulator)}
    references = {name: r for name, r in bench.objective.references.items() if r.use != "holdout"}
    on_stage("visited states")
    regions = visited_regions(pool, bench, references, values, places.values())
    if not regions:
        return Discovery(
            NOT_DIAGNOSABLE, "no body moves in the records or their simulations: there is no state to visit", ()
        )
    forces: dict[tuple[str, tuple[str, ...]], FreeForce] = {}
    for body, region in regions.items():
        forces |= {(body, a): _free_force(places[body], a, region) for a in (OF_DISPLACEMENT, OF_VELOCITY)}
    instrumental = [effect for effect in effects if effect.noise]
    suspected = [*(force.effect for force in forces.values()), *instrumental, *numerical(effects)]
    ready = prepared(pool, bench, study, values, suspected, on_stage)
    if isinstance(ready, NotDiagnosable):
        return Discovery(NOT_DIAGNOSABLE, failures(ready.gates), ready.gates)
    pool.later.clear()  # no search for causes follows
    search = _ForceSearch(ready, forces, places, regions, references, study, effects, seed)
    return search.result(on_stage)


def _refusal(simulator: Simulator) -> str:
    """Why no free force can act in a simulator; "" where it can."""
    if "force" in simulator.sites:
        return ""
    return f"simulator {simulator.name!r} takes no force laws: a force cannot be searched inside it"


def _free_force(place: ForcePlace, arguments: tuple[str, ...], region: VisitedRegion) -> FreeForce:
    """Return a free force at a place: an odd function where all records are responses that even ones do not change."""
    return free_force(place.name, arguments, region.ends, place.compliant, region.half_wave_symmetric)


class _ForceSearch:
    """Free forces at all places: scored, fitted from the simplest on, compared by what they predict."""

    def __init__(
        self,
        ready: Prepared,
        forces: Mapping[tuple[str, tuple[str, ...]], FreeForce],
        places: Mapping[str, ForcePlace],
        regions: Mapping[str, VisitedRegion],
        references: Mapping[str, Reference],
        study: CalibrationStudy,
        effects: Sequence[Effect],
        seed: int,
    ):
        self.ready, self.fitter, self.null = ready, ready.fitter, ready.null
        self.forces, self.places, self.regions, self.references = dict(forces), places, regions, references
        self.study, self.effects, self.seed = study, effects, seed
        self.candidates = {candidate.name: candidate for candidate in ready.suspects}
        self.trials: list[ForceTrial] = []
        self.scored: dict[str, Scored] = {}

    def result(self, on_stage: Callable[[str], None]) -> Discovery:
        """Result of the search; of a place where all records visit one curve of states no arguments are told."""
        discovery = self._searched(on_stage)
        curves = {}
        for name in self.regions:
            place, own = self.places[name], discovery.chosen is not None and discovery.chosen.body == name
            states = discovery.states if own else visited_states(self.fitter, self.null.point, place)
            curves[name] = "" if states is None else curve_in_words(states, place)
        discovery = replace(
            discovery,
            curves={name: text for name, text in curves.items() if text},
            frequencies=_response_frequencies(self.references.values()),
        )
        if self.fitter.effort.spent and self.trials:
            return replace(discovery, verdict=UNDETERMINED, summary=f"{CUT_SHORT}: {discovery.summary}")
        if discovery.chosen is None or discovery.states is None or not is_open_curve(discovery.states):
            return discovery
        return replace(discovery, verdict=UNDETERMINED, summary=f"{discovery.summary}. {UNTOLD}")

    def _searched(self, on_stage: Callable[[str], None]) -> Discovery:
        """Result of the search, but for curves of states."""
        on_stage("places")
        coefficients = sum(len(force.coefficients) for force in self.forces.values())
        self._foresee(scored=coefficients, fits=FITS_PER_PLACE, surfaces_scored=1)
        suspects, threshold = self._screened([self.candidates[f.name] for f in self.forces.values()])
        leading = _leading(suspects, threshold)
        if not leading and self._leaves_misfit(self.null):
            on_stage("places, functions of two arguments")
            suspects, threshold = self._screened([self._surface(body) for body in self.regions])
            leading = _leading(suspects, threshold)
        places = list(dict.fromkeys(_place_of(s.candidate) for s in leading))
        if not places and self._leaves_misfit(self.null):  # far from the measured motion no score test may be reliable
            places = list(dict.fromkeys(_place_of(s.candidate) for s in suspects if not is_testable(s)))
        if not places:
            largest = max((abs(s.z) for s in suspects), default=0.0)
            return self._nothing(f"no free force is significant: the largest |z| is {largest:.1f} of {threshold:.1f}")
        self._foresee(fits=len(places) * FITS_PER_PLACE, surfaces_scored=len(places))
        for body in self._within_budget(places):
            self._fit_place(body, on_stage)
        if all(self._leaves_misfit(trial.fitted) for trial in self.trials):
            surfaces = places
        else:
            surfaces = self._surfaces_beside(places, on_stage)
        for count, body in enumerate(self._within_budget(surfaces)):
            self._foresee(surfaces_fitted=len(surfaces) - count)
            self._surface(body)
            self.trials.append(self._fitted(body, (OF_STATE,), on_stage))
        return self._judged(on_stage)

    def _surfaces_beside(self, places: Sequence[str], on_stage: Callable[[str], None]) -> list[str]:
        """Places of which a surface is significant on the residual of the simpler forces that predict best there."""
        on_stage("places, functions of two arguments")
        significant_there = []
        for body in self._within_budget(places):
            simpler = [trial for trial in self.trials if trial.body == body]
            best = min(simpler, key=lambda trial: trial.predictive_deviance)
            [suspect], threshold = self._screened([self._surface(body)], best.fitted.fit)
            if is_testable(suspect) and abs(suspect.z) > threshold:
                significant_there.append(body)
        return significant_there

    def _within_budget(self, bodies: Sequence[str]) -> Iterator[str]:
        """Places for whose fits the budget suffices; the first fit of all counts with it anyway."""
        return (body for body in bodies if not self.trials or self.fitter.effort.suffices())

    def _leaves_misfit(self, model: Fit | PenalisedFit) -> bool:
        """Whether a model leaves more than noise."""
        return significant(self._excess(model), chi2_std(self.fitter.evidence))

    # --- scores and fits ----------------------------------------------------------------------------------------------

    def _screened(self, some: Sequence[Candidate], beside: Fit | None = None) -> tuple[list[Screened], float]:
        """Score forces beside the calibrated model, or another; fits take over the steps of reliable derivatives."""
        known: KnownDerivatives = {}
        suspects, threshold = screened(self.fitter, beside or self.null, some, self.seed, known)
        for derivatives in known.values():
            self.fitter.steps |= derivatives.steps
        if beside is None:
            self.scored |= {s.name: s for s in suspects if isinstance(s, Scored)}
        return suspects, threshold

    def _surface(self, body: str) -> Candidate:
        """Free function of both arguments on a body, as a candidate."""
        if (body, OF_STATE) in self.forces:
            return self.candidates[self.forces[body, OF_STATE].name]
        force = _free_force(self.places[body], OF_STATE, self.regions[body])
        self.forces[body, OF_STATE] = force
        [candidate], _ = candidates(self.study.model, [force.effect], self.references, self.study.space.names)
        self.candidates[force.name] = candidate
        return candidate

    def _fit_place(self, body: str, on_stage: Callable[[str], None]) -> None:
        """Fit forces at a place: of each argument alone, and of both.

        Where one of an argument alone leaves no misfit, the sum is fitted from there, and a fit of the other argument
        alone that is predicted to leave more is abandoned after a few steps. From a large misfit a fit may end
        early: a sum that ends above one of its terms is fitted again from where that ended, and where a sum predicts
        better than its terms, the one that is closest to it is fitted from there.
        """
        arguments = sorted(((OF_DISPLACEMENT,), (OF_VELOCITY,)), key=lambda own: -self._predicted(body, own))
        first = self._fitted(body, arguments[0], on_stage)
        noise = CRITERIA.significance_std * chi2_std(self.fitter.evidence)
        rival = np.inf if self._leaves_misfit(first.fitted) else first.chi2 + noise
        if not self.fitter.effort.suffices():
            self.trials.append(first)
            return
        single = [first, self._fitted(body, arguments[1], on_stage, rival=rival)]
        better = min(single, key=lambda trial: trial.chi2)
        begin = None if self._leaves_misfit(better.fitted) else better.values
        both = self._fitted(body, (OF_DISPLACEMENT, OF_VELOCITY), on_stage, begin)
        if both.chi2 > better.chi2:
            both = min(both, self._fitted(body, both.arguments, on_stage, better.values), key=lambda trial: trial.chi2)
        elif both.predicts_better(better):
            closest = [nested(both.fitted, trial.fitted.model) for trial in single]
            k = min(range(2), key=lambda k: closest[k][0])
            again = self._fitted(body, single[k].arguments, on_stage, closest[k][1])
            single[k] = min(single[k], again, key=lambda trial: trial.chi2)
        self.trials += [*single, both]

    def _predicted(self, body: str, arguments: Arguments) -> float:
        """Reduction of chi-square that the score test of a force predicts; none where it has no score test."""
        [own] = arguments
        scored = self.scored.get(self.forces[body, own].name)
        return 0.0 if scored is None else scored.predicted_reduction

    def _fitted(
        self,
        body: str,
        arguments: Arguments,
        on_stage: Callable[[str], None],
        begin: Mapping[str, float] | None = None,
        rival: float = np.inf,
    ) -> ForceTrial:
        """Fit forces, from where they are absent or from values by name; beside a rival see `penalised_fit`."""
        on_stage(f"{body}: {described(arguments, self.places[body])}")
        forces = tuple(self.forces[body, a] for a in arguments)
        own = tuple(self.candidates[force.name] for force in forces)
        model = FreeModel(forces, own, visited_states(self.fitter, self.null.point, self.places[body]))
        known = [self.scored[c.name].derivatives for c in own if c.name in self.scored]
        columns = np.column_stack(known) if len(known) == len(own) else None
        fitted = penalised_fit(self.fitter, self.null, model, columns, begin, rival)
        return ForceTrial(
            self.places[body], arguments, fitted, left_out_misfit(self.fitter.evidence, fitted.fit, fitted)
        )

    def _excess(self, model: Fit | PenalisedFit) -> float:
        evidence = self.fitter.evidence
        if isinstance(model, PenalisedFit):
            return model.fit.chi2 - model.degrees_of_freedom(evidence)
        return excess_chi2(evidence, model)

    @property
    def _surface_coefficients(self) -> int:
        """Coefficients of a surface at the most."""
        odd = all(force.odd for force in self.forces.values())
        return SURFACE_COEFFICIENTS // 2 if odd else SURFACE_COEFFICIENTS

    def _foresee(self, scored: int = 0, fits: int = 0, surfaces_scored: int = 0, surfaces_fitted: int = 0) -> None:
        """Foresee scores of so many coefficients, fits of functions of one argument, surfaces, and the formulas."""
        of_all = SIMULATIONS_PER_COEFFICIENT * len(self.fitter.evidence.parts)
        derivatives = surfaces_scored + DERIVATIVES_PER_SURFACE_FIT * surfaces_fitted
        self.fitter.effort.foresee(
            of_all * (scored + derivatives * self._surface_coefficients)
            + fits * self.fitter.expected_simulations(4, STEPS_PER_FREE_FIT)
            + expected_of_formulas(self.fitter, EXPECTED_FORMULAS)
        )

    # --- judgement ----------------------------------------------------------------------------------------------------

    def _nothing(self, summary: str) -> Discovery:
        return Discovery(NOTHING, summary, self.ready.gates, tuple(self.trials), null=self.null,
                         excess_chi2=(self._excess(self.null), 0.0))  # fmt: skip

    def _judged(self, on_stage: Callable[[str], None]) -> Discovery:
        """Take the simplest model that predicts as well as the best, on a body before at an interface, or none."""
        on_stage("prediction")
        null_left_out = left_out_misfit(self.fitter.evidence, self.null)
        improved = [trial for trial in self.trials if trial.chi2 < self.null.chi2]
        if not improved and self._leaves_misfit(self.null):
            return replace(self._nothing(NO_STEP), verdict=UNDETERMINED)
        predictions = [(trial, trial.left_out) for trial in improved if trial.left_out is not None]
        if null_left_out is None or not predictions:
            return replace(self._nothing(UNTESTED), verdict=UNDETERMINED)
        leading, best = min(predictions, key=lambda pair: pair[1].deviance)
        if not best.is_better(null_left_out):
            text = (
                "no free force predicts left-out records better: their predictive deviance is "
                f"{best.deviance:.5g} with the best, {null_left_out.deviance:.5g} without"
            )
            return replace(self._nothing(text), null_left_out=null_left_out)
        tied = [
            trial
            for trial, left_out in predictions
            if not best.is_better(left_out) or (left_out.is_better(null_left_out) and trial.stands_for(leading))
        ]
        chosen = min(tied, key=lambda trial: (trial.complexity, bool(trial.place.gap), trial.predictive_deviance))
        states = visited_states(self.fitter, chosen.fitted.fit.point, chosen.place)
        rivals = tuple({t.body: t.place for t in tied if t.body != chosen.body}.values())
        excess = self._excess(self.null), self._excess(chosen.fitted)
        formulas = formulas_of(self.fitter, self.null, chosen.fitted, chosen.left_out, on_stage)
        degrees = chosen.fitted.degrees_of_freedom(self.fitter.evidence)
        rms = math.sqrt(chosen.chi2 / degrees) if self._leaves_misfit(chosen.fitted) else None
        told = excess if self._leaves_misfit(self.null) else None
        summary = summary_of(chosen, tied, rivals, told, null_left_out, rms)
        found = Discovery(
            FOUND, summary, self.ready.gates, tuple(self.trials), chosen,
            tuple(place.name for place in rivals), states, self.null, null_left_out, excess, formulas,
        )  # fmt: skip
        return self._beside_histories(found, chosen, on_stage)

    def _beside_histories(self, found: Discovery, chosen: ForceTrial, on_stage: Callable[[str], None]) -> Discovery:
        """Compare laws with internal states with the force that was found."""
        if not self.fitter.effort.suffices():
            return found
        trials = history_trials(self.fitter, self.null, chosen, self.effects, self.references, self.seed, on_stage)
        better = [trial for trial in trials if trial.surpasses(chosen, found.formula_trial)]
        if not better:
            return replace(found, histories=trials)
        return replace(found, verdict=OF_HISTORY, summary=summary_of_history(chosen, better), histories=trials)


def _response_frequencies(references: Iterable[Reference]) -> tuple[float, float] | None:
    """Lowest and highest frequency at which responses among records were measured; None without one  [Hz]."""
    own = [reference.record["frequency"].values for reference in references if reference.is_swept]
    return (float(min(f.min() for f in own)), float(max(f.max() for f in own))) if own else None


def _leading(suspects: Sequence[Screened], threshold: float) -> list[Scored]:
    """Suspects above the threshold that predict about as much as the best."""
    above = [s for s in suspects if is_testable(s) and abs(s.z) > threshold]
    largest = max((s.predicted_reduction for s in above), default=0.0)
    return [s for s in above if s.predicted_reduction >= CRITERIA.min_leader_share * largest]


def _place_of(candidate: Candidate) -> str:
    [body] = candidate.effect.bodies or ()
    return body
