"""Search of the design regions for the measurements of largest separation, within a number of simulations."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from calib.diagnosis.bench import Bench, Run, SimulatedRows, simulated
from calib.diagnosis.fit import Fit
from calib.diagnosis.laboratory import (
    FREE_DECAY,
    RECORDED_INPUT,
    REPEATED_RECORD,
    STEADY_TONE,
    STEPPED_SINE,
    SWEEP,
    WITHOUT_CONTACT,
    DesignPoint,
    DesignRegion,
    Laboratory,
    additional_channels,
)
from calib.diagnosis.measurement import (
    DECISIVE_Z,
    FAILED,
    GRID,
    IRREGULAR,
    OK,
    REFINEMENT,
    EvaluatedPoint,
    Measurement,
    agrees,
    described,
    rank,
    separates_further,
)
from calib.diagnosis.part import Part
from calib.diagnosis.separation import (
    Experiment,
    LinearisedPrediction,
    Separation,
    experiment,
    prediction,
    refitted_distance,
)
from calib.diagnosis.stepped_design import as_read
from calib.study import Pool

LINE_SHARE = 0.06  # of the affordable points: first ones of a test of one variable  [1]
MIN_LINE_POINTS, MAX_LINE_POINTS = 3, 7  # points of a test of one variable  [count]
GRID_SHARE = 0.55  # of the affordable points: grid over amplitude and frequency  [1]
GRID_ASPECT = 1.6  # frequencies per amplitude of the grid  [1]
MAX_PATTERN_ROUNDS = 4  # of a pattern search  [count]
BATCH_POINTS = 16  # simulated side by side: bounds the memory of their records  [count]
SIMULATIONS_PER_CHECK = 4  # of a pair: each model from its own motion and from the other's  [count]
CHECK_SHARE = 0.05  # of the simulations, reserved for these checks  [1]
CONFIRMED_SHARE = 0.95  # of a predicted separation: where a check confirms as much, no further point is checked  [1]
MAX_CHECKED_POINTS = 4  # of a test, whose separation is simulated at the refitted parameters  [count]


@dataclass(frozen=True, eq=False)
class _Evaluation:
    """An evaluated point with the simulations and the prediction of its separations.

    Attributes
    ----------
    made : the experiment
    centres : simulations of the models
    prediction : None where a simulation failed or is irregular
    score : for comparison, see `_score`
    """

    outcome: EvaluatedPoint
    made: Experiment
    centres: tuple[SimulatedRows, ...] = ()
    prediction: LinearisedPrediction | None = None
    score: tuple[float, ...] = (-1.0, 0.0, 0.0)


def _score(z: np.ndarray) -> tuple[float, ...]:
    """Number of pairs that are distinguished by separations (pair,), then the least of these, then the largest."""
    return float((z >= DECISIVE_Z).sum()), float(z.min()), float(z.max())


class DesignSearch:
    """Evaluates design points within a budget of simulations.

    Parameters
    ----------
    part : record on which the measurement is based
    fits : of the rival models
    left : simulations that may still be made, whatever the laboratory allows
    """

    def __init__(
        self,
        pool: Pool,
        bench: Bench,
        part: Part,
        fits: Sequence[Fit],
        laboratory: Laboratory,
        left: Callable[[], float] = lambda: math.inf,
    ):
        self.pool, self.bench, self.part, self.fits, self.left = pool, bench, part, fits, left
        self.budget, self.simulations = laboratory.simulations, 0
        self.simulated_record = fits[0].point.simulated[part.name]
        self.additional: tuple[tuple[str, str], ...] = ()
        if not part.is_swept:
            self.additional = self._provided(
                additional_channels(laboratory, bench.model, part, self.simulated_record.given)
            )
        self.evaluations: list[_Evaluation] = []

    def _provided(self, pairs: Sequence[tuple[str, str]]) -> tuple[tuple[str, str], ...]:
        """(body, channel) pairs that a simulation of the record has."""
        record = self._experiment(DesignPoint(REPEATED_RECORD))
        channels = list(dict.fromkeys(channel for _, channel in pairs))
        owned = [tuple(pair for pair in pairs if pair[1] == channel) for channel in channels]
        views = self._simulated([replace(record, rows=own).centre(self.fits[0]) for own in owned])
        held = {channel for channel, view in zip(channels, views, strict=True) if view.usable}
        return tuple(pair for pair in pairs if pair[1] in held)

    def run(self, searched: Mapping[str, DesignRegion]) -> None:
        """Evaluate the region of each kind of test: a grid, then a pattern search about its best point."""
        for test, region in searched.items():
            if test in (SWEEP, FREE_DECAY, STEPPED_SINE) or (test == REPEATED_RECORD and self.additional):
                count = LINE_SHARE * self._affordable(region)
                self._explore(region, [round(np.clip(count, MIN_LINE_POINTS, MAX_LINE_POINTS))])
        tests = [test for test in (STEADY_TONE, RECORDED_INPUT, WITHOUT_CONTACT) if test in searched]
        if tests:
            region = _driven(searched[tests[0]])
            counts = _grid_shape(region, GRID_SHARE * self._affordable(region))
            self._explore(region, counts)
            if WITHOUT_CONTACT in tests:
                self._refine(region, counts, WITHOUT_CONTACT)

    def _affordable(self, region: DesignRegion) -> int:
        """Number of points of a kind of test for which the whole budget suffices."""
        middle = self._experiment(region.point([0.5] * len(region.variables)))
        return int((1.0 - CHECK_SHARE) * self.budget) // self._cost(middle)

    def _explore(self, region: DesignRegion, counts: Sequence[int]) -> None:
        """Evaluate a grid of these numbers of values, then refine it."""
        counts = counts[: len(region.variables)]
        self._evaluate(region.grid(counts), GRID)
        self._refine(region, counts, region.test)

    def _refine(self, region: DesignRegion, counts: Sequence[int], test: str) -> None:
        """Pattern search: to the best of the neighbours, with half the step where none is better."""
        steps, best = np.array([0.5 / max(1, count - 1) for count in counts]), None
        for _ in range(MAX_PATTERN_ROUNDS):
            leader = max(self._candidates(test), key=lambda e: e.score, default=None)
            if leader is None:
                return
            steps, best = (0.5 * steps if leader is best else steps), leader
            self._evaluate(region.neighbours(best.outcome.point, steps), REFINEMENT)

    def _candidates(self, test: str) -> list[_Evaluation]:
        """Evaluations of a kind of test that have a prediction."""
        good = [e for e in self.evaluations if e.prediction is not None]
        if test != WITHOUT_CONTACT:
            return [e for e in good if e.outcome.point.test == test]
        if not self.simulated_record.impacts:
            return []
        return [e for e in good if e.outcome.point.test in (STEADY_TONE, RECORDED_INPUT) and e.outcome.impacts is False]

    # --- simulations

    def _experiment(self, point: DesignPoint) -> Experiment:
        """The experiment at a design point."""
        return experiment(point, self.bench, self.part, self.simulated_record, self.additional)

    def _cost(self, made: Experiment) -> int:
        """Simulations of an experiment."""
        reading = int(made.stepped is not None)
        return reading + sum(1 + len(fit.names) + len(made.initial_steps) for fit in self.fits)

    def _evaluate(self, points: Sequence[DesignPoint], stage: str) -> None:
        """Evaluate, in batches side by side, the new points for which the budget suffices."""
        known = {_rounded(e.outcome.point) for e in self.evaluations}
        new = [self._experiment(point) for point in points if _rounded(point) not in known]
        for first in range(0, len(new), BATCH_POINTS):
            batch = new[first : first + BATCH_POINTS]
            simulations = min((1.0 - CHECK_SHARE) * self.budget - self.simulations, self.left())
            left = int(simulations) // max(map(self._cost, batch))
            if left > 0:
                self.evaluations += self._batch(batch[:left], stage)

    def _batch(self, batch: Sequence[Experiment], stage: str) -> list[_Evaluation]:
        """Simulate all models; their derivatives only where the motion of each is regular."""
        batch, unreadable = self._read(batch, stage)
        views = iter(self._simulated([made.centre(fit) for made in batch for fit in self.fits]))
        centres = [tuple(next(views) for _ in self.fits) for _ in batch]
        regular = [all(view.usable and not view.wrong for view in own) for own in centres]
        runs = [
            made.differences(fit, centre)
            for made, own, good in zip(batch, centres, regular, strict=True)
            for fit, centre in zip(self.fits, own, strict=True)
            if good
        ]
        views = iter(self._simulated([run for own in runs for run in own]))
        beside = iter([[next(views) for _ in own] for own in runs])
        return unreadable + [
            self._evaluation(made, stage, own, [next(beside) for _ in self.fits] if good else [])
            for made, own, good in zip(batch, centres, regular, strict=True)
        ]

    def _read(self, batch: Sequence[Experiment], stage: str) -> tuple[list[Experiment], list[_Evaluation]]:
        """Experiments, stepped sines with what the first model would read; and those that it cannot read."""
        stepped = [(made, made.stepped) for made in batch if made.stepped is not None]
        read, unreadable = [made for made in batch if made.stepped is None], list[_Evaluation]()
        measured = self.bench.objective.references[self.part.name].record
        views = self._simulated([made.centre(self.fits[0]) for made, _ in stepped])
        for (made, sweeps), view in zip(stepped, views, strict=True):
            if view.usable and not view.wrong:
                stepped_sine = as_read(sweeps, view.read, measured, self.part)
                read.append(replace(made, stepped=stepped_sine, curves=view.sweeps))
            else:
                status, reason = _status([view])
                unreadable.append(_Evaluation(EvaluatedPoint(made.point, stage, status, reason), made))
        return read, unreadable

    def _simulated(self, runs: Sequence[Run]) -> list[SimulatedRows]:
        """Simulate side by side, and count the simulations."""
        views = simulated(self.pool, runs)
        self.simulations += sum(view.simulations for view in views)
        return views

    def _evaluation(
        self,
        made: Experiment,
        stage: str,
        centres: tuple[SimulatedRows, ...],
        beside: Sequence[Sequence[SimulatedRows]],
    ) -> _Evaluation:
        status, reason = _status([*centres, *(view for views in beside for view in views)])
        if status != OK:
            return _Evaluation(EvaluatedPoint(made.point, stage, status, reason), made)
        impacts = [view.impacts for view in centres]
        predicted = prediction(made, self.fits, centres, beside)
        z = predicted.separation().z
        outcome = EvaluatedPoint(
            point=made.point,
            stage=stage,
            status=OK,
            impacts=None if None in impacts else any(impacts),
            z=float(z.min()),
            z_max=float(z.max()),
        )
        return _Evaluation(outcome, made, centres, predicted, _score(z))

    # --- the best of each kind of test

    def measurements(self, searched: Mapping[str, DesignRegion]) -> list[Measurement]:
        """Best measurement of each kind of test with the record's channels, and with the best additional one."""
        best: list[Measurement] = []
        for test in searched:
            plain = None if test == REPEATED_RECORD else self._best(test, [None])
            extended = self._best(test, range(len(self.additional)))
            if extended is not None and plain is not None and not separates_further(extended, plain):
                extended = None
            best += [m for m in (plain, extended) if m is not None]
        return sorted({(m.point, m.channel): m for m in reversed(best)}.values(), key=rank, reverse=True)

    def _best(self, test: str, additional: Iterable[int | None]) -> Measurement | None:
        """Largest separation by a kind of test, with one of these additional channels, as far as refits confirm it."""
        predicted = [(e, e.prediction) for e in self._candidates(test) if e.prediction is not None]
        choices = [(e, own.separation(k), k) for e, own in predicted for k in additional]
        choices.sort(key=lambda choice: _score(choice[1].z), reverse=True)
        best = None
        for evaluation, separation, number in choices[:MAX_CHECKED_POINTS]:
            if best is not None and best.confirmed and (best.distinguished, best.z) >= _score(separation.z)[:2]:
                break
            measurement = self._checked(test, evaluation, separation, number)
            if best is None or rank(measurement) > rank(best):
                best = measurement
            if measurement.confirmed and measurement.z >= CONFIRMED_SHARE * separation.z.min():
                break
        return best

    @property
    def _has_contact(self) -> bool:
        """Whether a motion of the record or of any evaluated point has impacts, so that a test can be without them."""
        return bool(self.simulated_record.impacts) or any(e.outcome.impacts for e in self.evaluations)

    def _checked(
        self, kind: str, evaluation: _Evaluation, separation: Separation, additional: int | None
    ) -> Measurement:
        """The measurement at an evaluated point, its separations checked by simulations."""
        pairs = list(combinations(range(len(self.fits)), 2))
        least, z = int(np.argmin(separation.z)), separation.z.copy()
        checked = [least, *(k for k in np.argsort(-z, kind="stable") if k != least and z[k] >= DECISIVE_Z)]
        refits = {}
        for k in checked:
            if min(self.budget - self.simulations, self.left()) < SIMULATIONS_PER_CHECK:
                break
            refits[k] = self._refitted(evaluation, pairs[k], separation.moves[k], additional)
        contradicted = {k for k, refit in refits.items() if not agrees(z[k], refit)}
        for k, refit in refits.items():
            z[k] = z[k] if refit is None else min(z[k], refit)
        counted = [k for k in range(len(pairs)) if k == least or k not in contradicted]
        body, name = ("", "") if additional is None else self.additional[additional]
        outcome = evaluation.outcome
        return Measurement(
            kind=kind,
            description=described(
                outcome if self._has_contact else replace(outcome, impacts=None),
                self.part.name,
                self._unit,
                f"{name} of {body}" if body else "",
            ),
            record=self.part.name,
            point=outcome.point,
            channel=f"{body}.{name}" if body else "",
            impacts=outcome.impacts,
            distinguished=sum(bool(z[k] >= DECISIVE_Z) for k in refits if k not in contradicted),
            pairs=len(pairs),
            unchecked=sum(bool(z[k] >= DECISIVE_Z) for k in checked if k not in refits),
            z=float(z.min()),
            z_max=float(z[counted].max()),
            z_refit=refits.get(least),
        )

    def _refitted(
        self, evaluation: _Evaluation, pair: tuple[int, int], moves: tuple[np.ndarray, np.ndarray], number: int | None
    ) -> float | None:
        """Separation of a pair of models simulated at its refitted parameters; None where that cannot be simulated.

        Each is simulated from its own motion and from the other's: where a model has both motions, as near a
        bifurcation, it is unknown which of them the structure will take, and the smaller separation counts.
        """
        made, centres = evaluation.made, evaluation.centres
        fits = self.fits[pair[0]], self.fits[pair[1]]
        near = [[centres[k] for k in pair], [centres[k] for k in reversed(pair)]]
        runs = [
            made.moved(fit, move, centre)
            for centres_near in near
            for fit, move, centre in zip(fits, moves, centres_near, strict=True)
        ]
        one, other, crossed_one, crossed_other = self._simulated(runs)
        if _status([one, other])[0] != OK:
            return None
        combinations_of_motions = [(one, other), (one, crossed_other), (crossed_one, other)]
        return min(
            refitted_distance(made, fits, moves, centres, views, number)
            for views in combinations_of_motions
            if _status(views)[0] == OK
        )

    @property
    def _unit(self) -> str:
        """Unit of the excitation."""
        return self.bench.objective.references[self.part.name].excitation.unit

    def _in_contact(self) -> str:
        """Why there is no measurement without contact."""
        if self.simulated_record.impacts is None:
            return "the simulator does not report impacts"
        if not self.simulated_record.impacts:
            return "the record has no impacts"
        regular = any(e.outcome.status == OK for e in self.evaluations)
        return "no setting within the bounds is without contact" if regular else "no setting could be simulated"

    def unavailable(self, test: str) -> str:
        """Why a kind of test that was searched has no measurement; "" where it has one."""
        if self._candidates(test):
            return ""
        if test == WITHOUT_CONTACT:
            return self._in_contact()
        if test == REPEATED_RECORD and not self.additional:
            return "the record has all channels of the simulator"
        own = [e.outcome for e in self.evaluations if e.outcome.point.test == test]
        if not own:
            return "the allowed number of simulations does not suffice"
        return f"{own[0].status} at every point; at the first: {own[0].reason}"


def _driven(region: DesignRegion) -> DesignRegion:
    """Return the region with the test by its drive, with impacts or without: a steady tone, or the recorded input."""
    test = STEADY_TONE if len(region.variables) == 2 else RECORDED_INPUT
    return replace(region, fixed=replace(region.fixed, test=test))


def _grid_shape(region: DesignRegion, count: float) -> list[int]:
    """Number of values of each variable for a grid of about so many points."""
    free = [not v.is_fixed for v in region.variables]
    if sum(free) < 2:
        return [round(np.clip(count, MIN_LINE_POINTS, 2 * MAX_LINE_POINTS)) for _ in free]
    amplitudes = max(MIN_LINE_POINTS, round(math.sqrt(count / GRID_ASPECT)))
    return [amplitudes, max(MIN_LINE_POINTS, int(count // amplitudes))]


def _rounded(point: DesignPoint) -> tuple[str | None, ...]:
    """Settings of a point to ten digits, for comparison with others."""
    values = (point.amplitude, point.frequency, point.release)
    return point.test, *(None if value is None else f"{value:.9e}" for value in values)


def _status(views: Sequence[SimulatedRows]) -> tuple[str, str]:
    """Status of several simulations together, and its reason."""
    failed = next((view for view in views if not view.usable), None)
    if failed is not None:
        return FAILED, failed.reason or failed.status
    irregular = next((view for view in views if view.wrong), None)
    return (OK, "") if irregular is None else (IRREGULAR, irregular.wrong)
