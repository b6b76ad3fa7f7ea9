"""Predicted separation of fitted models by a possible measurement: the T-criterion of optimal design.

The separation of two models is the distance between their predictions in standard deviations of the noise, least over
the parameters of both, which the existing records constrain, and over the nuisances of the new measurement, linearised.
Its square is the non-centrality of a test between them (Atkinson and Fedorov 1975, Biometrika 62, 57-70 and 289-303).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np
import scipy
import xarray as xr
from scipy.linalg import block_diag

from calib.diagnosis.bench import Bench, Run, SimulatedRows
from calib.diagnosis.clock import CLOCK_RATE_STD, uncertain_clock
from calib.diagnosis.fit import Fit
from calib.diagnosis.laboratory import (
    FREE_DECAY,
    RELEASE,
    REPEATED_RECORD,
    STEPPED_SINE,
    SWEEP,
    DesignPoint,
    amplitude_of,
    measured_displacement,
    releasable,
)
from calib.diagnosis.noise import Noise
from calib.diagnosis.part import Part
from calib.diagnosis.stepped_design import unread_sweeps
from calib.dynamics.swept_paths import KnownSweeps
from calib.records import STATE
from calib.records.excitation import Excitation

RELATIVE_STEP = 1e-3  # of the largest displacement and velocity: differences by the initial state  [1]
SWEEP_SAMPLES_PER_PERIOD = 20  # at the highest frequency of a sweep  [count]
SWEEP_TAPER = 0.1  # of a sweep's duration: cosine taper at both ends together  [1]
MIN_NOISE_RATIO = 1e-12  # of the noise to that of the record, for a channel of the new measurement that is at rest  [1]
SEPARATION_RANK_TOLERANCE = 1e-10  # singular value over the largest, columns of unit length  [1]


@dataclass(frozen=True, eq=False)
class Experiment:
    """A possible measurement, as it is simulated.

    Attributes
    ----------
    point : its settings
    part : record on which it is based
    excitation : of it
    rows : (body, channel) pairs: those of the record, then additional ones
    initial : initial state, by parameter: a nuisance that its record has to determine  [SI]
    initial_steps : differences by these  [SI]
    stepped : sweeps of a stepped sine, with what is read once that is known; None of another test
    curves : of the model that says what is read, beside which those of others are sought
    """

    point: DesignPoint
    part: Part
    excitation: Excitation
    rows: tuple[tuple[str, str], ...]
    initial: Mapping[str, float] = field(default_factory=dict)
    initial_steps: tuple[float, ...] = ()
    stepped: xr.Dataset | None = None
    curves: KnownSweeps = field(default_factory=dict)

    def centre(self, fit: Fit) -> Run:
        """Simulation of a fitted model; a steady tone starts from the record's stationary motion."""
        near = None if self.initial or self.stepped is not None else fit.point.simulated[self.part.name]
        return self._run(fit, fit.point.values, self.initial, near)

    def differences(self, fit: Fit, centre: SimulatedRows) -> list[Run]:
        """Simulations one step along each parameter of the fit, then along each component of the initial state."""
        values = fit.point.values
        runs = [
            self._run(fit, {**values, name: values[name] + step}, self.initial, centre)
            for name, step in zip(fit.names, fit.steps, strict=True)
        ]
        for name, step in zip(self.initial, self.initial_steps, strict=True):
            runs.append(self._run(fit, values, {**self.initial, name: self.initial[name] + step}, centre))
        return runs

    def moved(self, fit: Fit, move: np.ndarray, centre: SimulatedRows) -> Run:
        """Simulation of a fitted model with its parameters, then its initial state, moved by `move`."""
        values = dict(fit.point.values)
        values |= {name: values[name] + d for name, d in zip(fit.names, move, strict=False)}
        initial = dict(self.initial)
        initial |= {n: initial[n] + d for n, d in zip(initial, move[len(fit.names) :], strict=True)}
        return self._run(fit, values, initial, centre)

    def _run(
        self, fit: Fit, values: Mapping[str, float], initial: Mapping[str, float], near: SimulatedRows | None
    ) -> Run:
        """Simulation of a fitted model at these values, from this initial state or near this stationary motion."""
        own = {f"{parameter}@{self.part.name}" for parameter in self.initial}
        values = {name: value for name, value in values.items() if name not in own}
        run = Run(self.part.name, {**values, **initial}, fit.point.effects, rows=self.rows)
        if self.stepped is not None:
            return replace(run, stepped=self.stepped, sweeps=self.curves if near is None else near.sweeps)
        state = near.state if near is not None and self.excitation.harmonic else None
        return replace(run, state=state, excitation=self.excitation)


def experiment(
    point: DesignPoint, bench: Bench, part: Part, simulated: SimulatedRows, additional: Sequence[tuple[str, str]] = ()
) -> Experiment:
    """Return the experiment at a design point, based on a record.

    Parameters
    ----------
    simulated : of the record, with the initial state that was solved for where that is a nuisance
    additional : (body, channel) pairs in addition to those of the record
    """
    rows = (*part.rows, *additional)
    if point.test == STEPPED_SINE:
        reference = bench.objective.references[part.name]
        return Experiment(point, part, reference.excitation, rows, stepped=unread_sweeps(point, reference.record))
    initial, steps = _initial_state(point, bench, part, simulated)
    return Experiment(point, part, excitation_at(point, bench, part), rows, initial, steps)


def _initial_state(
    point: DesignPoint, bench: Bench, part: Part, simulated: SimulatedRows
) -> tuple[dict[str, float], tuple[float, ...]]:
    """Initial state that the new record has to determine, by parameter, and differences by it  [SI].

    Of a free decay and of a sweep all of it; of another measurement what the record had to determine on which it is
    based.
    """
    if point.test in (FREE_DECAY, SWEEP):
        initial = dict.fromkeys(bench.model.initial if point.test == SWEEP else RELEASE, 0.0)
        if point.release is not None:
            initial[RELEASE[0]] = point.release
        scales = {"displacement": point.release or largest_displacement(part), "velocity": largest_speed(part)}
        channels = {**dict(zip(RELEASE, STATE, strict=True)), **{n: own[1] for n, own in bench.model.initial.items()}}
        return initial, tuple(RELATIVE_STEP * scales[channels[name]] for name in initial)
    initial = {name: simulated.nuisances[name] for name in bench.model.initial if name in simulated.nuisances}
    size = RELATIVE_STEP * float(np.abs(part.measured).max())
    largest = (max(float(np.abs(change).max()), 1e-300) for change in simulated.initial)
    return initial, tuple(size / change for change in largest) if initial else ()


def largest_displacement(part: Part) -> float:
    """Largest measured displacement of a record; where none is measured, its largest speed times its duration  [m]."""
    return measured_displacement(part) or largest_speed(part) * float(part.time[-1] - part.time[0])


def largest_speed(part: Part) -> float:
    """Largest speed of a record: measured, or where no velocity is, of the measured displacement  [m/s]."""
    rows = list(zip((channel for _, channel in part.rows), part.measured, strict=True))
    speeds = [row for channel, row in rows if channel == "velocity"]
    speeds = speeds or [np.gradient(row, part.time) for channel, row in rows if channel == "displacement"]
    return max((float(np.abs(row).max()) for row in speeds), default=1.0)


def excitation_at(point: DesignPoint, bench: Bench, part: Part) -> Excitation:
    """Excitation at a design point, based on a record.

    Raises
    ------
    ValueError : the simulator cannot be released
    """
    excitation = bench.objective.references[part.name].excitation
    if point.test == FREE_DECAY:
        place = releasable(bench.model)
        if place is None:
            raise ValueError(f"simulator {bench.model.simulator.name!r} cannot be released from a displacement")
        return Excitation(place, FREE_DECAY)
    if point.test == REPEATED_RECORD:
        return excitation
    if point.test == SWEEP:
        return _sweep(point, excitation, part.time.size)
    largest = amplitude_of(excitation)
    if excitation.recorded and largest is not None:
        return excitation.scaled(point.setting("amplitude") / largest)
    return replace(excitation, amplitude=point.amplitude, frequency=point.frequency)


def _sweep(point: DesignPoint, excitation: Excitation, samples: int) -> Excitation:
    """Logarithmic sweep, tapered at its ends, of as many samples as a record has."""
    first, last = point.setting("frequency"), point.setting("end_frequency")
    time = np.arange(samples) / (SWEEP_SAMPLES_PER_PERIOD * last)
    wave = scipy.signal.chirp(time, first, time[-1], last, method="logarithmic", phi=-90.0)
    value = point.setting("amplitude") * wave * scipy.signal.windows.tukey(samples, SWEEP_TAPER)
    return Excitation(excitation.place, excitation.quantity, excitation.unit, time=time, value=value)


@dataclass(frozen=True, eq=False)
class Separation:
    """Separation of every pair of models by one experiment.

    Attributes
    ----------
    z : (pair,) in standard deviations, of pairs in the order of `itertools.combinations`
    moves : of each pair, by how much the parameters of the one and of the other move to come nearest
    """

    z: np.ndarray
    moves: tuple[tuple[np.ndarray, np.ndarray], ...]


@dataclass(frozen=True, eq=False)
class LinearisedPrediction:
    """Predictions of all models for one experiment with their derivatives, in units of the noise, triangularised.

    Attributes
    ----------
    triangles : of the record's rows, and of these with each additional one: upper triangle (c, c) of the QR factors of
        [prediction of each model, derivatives of each model, tangents of the nuisances]
    widths : number of derivatives of each model
    priors : of each model, triangle (k, k) of its derivatives of the existing records, by `widths`
    standardised : number of nuisances, the last ones, that are known to one standard deviation, their unit
    """

    triangles: tuple[np.ndarray, ...]
    widths: tuple[int, ...]
    priors: tuple[np.ndarray, ...]
    standardised: int = 0

    def separation(self, additional: int | None = None) -> Separation:
        """Separation with the record's rows, or with the additional one of this number beside them."""
        triangle = self.triangles[0 if additional is None else 1 + additional]
        pairs = [self._pair(triangle, i, j) for i, j in combinations(range(len(self.widths)), 2)]
        return Separation(np.array([z for z, _ in pairs]), tuple(moves for _, moves in pairs))

    def _pair(self, triangle: np.ndarray, i: int, j: int) -> tuple[float, tuple[np.ndarray, np.ndarray]]:
        """Separation of one pair, and by how much the parameters of both move to come nearest."""
        ends = np.cumsum([len(self.widths), *self.widths])
        one, other = triangle[:, ends[i] : ends[i + 1]], triangle[:, ends[j] : ends[j + 1]]
        nuisances = triangle[:, ends[-1] :]
        count = nuisances.shape[1]
        prior = block_diag(self.priors[i], self.priors[j], np.eye(count)[count - self.standardised :])
        stacked = np.vstack([np.column_stack([one, -other, nuisances]), prior])
        target = np.concatenate([triangle[:, j] - triangle[:, i], np.zeros(len(prior))])
        move, distance = least_squares(stacked, target)
        return distance, (move[: self.widths[i]], move[self.widths[i] :][: self.widths[j]])


def least_squares(columns: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, float]:
    """Solution (k,) of columns (n, k) x = target (n,) by least squares, and the norm of its residual."""
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0.0] = 1.0
    move = np.linalg.lstsq(columns / scale, target, rcond=SEPARATION_RANK_TOLERANCE)[0]
    return move / scale, float(np.linalg.norm(target - (columns / scale) @ move))


def _triangle(columns: np.ndarray) -> np.ndarray:
    """Upper triangle of the QR factors of columns (n, k)."""
    return np.asarray(np.linalg.qr(columns, mode="r"))


def with_free_form(fit: Fit) -> Fit:
    """Return the fit with the form of its effects free: a width that was held may be wrong elsewhere.

    Its derivatives have to be recomputed.
    """
    return replace(fit, candidates=tuple(replace(c, form=tuple(c.bounds)) for c in fit.candidates))


def with_steps(fit: Fit) -> Fit:
    """Return the fit with a step for each parameter, also those that the existing records do not determine."""
    least = [RELATIVE_STEP * (abs(fit.value(name)) or 1.0) for name in fit.names]
    return replace(fit, steps=tuple(step or other for step, other in zip(fit.steps, least, strict=True)))


def prior_of(fit: Fit, made: Experiment) -> np.ndarray:
    """Prior information on the parameters, as rows (m, k + initial) of a least-squares problem.

    The existing records by the triangle of their derivatives; the form of an effect by its bounds, as of a uniform
    distribution between them. There is none on a new initial state, nor on a parameter that is fitted to the base
    record alone: it may differ in the next.
    """
    own = np.array([name.endswith(f"@{made.part.name}") for name in fit.names], dtype=bool)
    derivatives = fit.free(fit.columns)
    triangle = _triangle(np.column_stack([derivatives[:, own], derivatives[:, ~own]]))
    shared = np.zeros((max(0, len(triangle) - own.sum()), own.size))
    shared[:, ~own] = triangle[own.sum() :, own.sum() :]
    known = [shared]
    for candidate in fit.candidates:
        for name in candidate.form:
            low, high = candidate.bounds[name]
            row = np.zeros((1, len(fit.names)))
            row[0, fit.names.index(name)] = np.sqrt(12.0) / (high - low)
            known.append(row)
    return np.pad(np.vstack(known), ((0, 0), (0, len(made.initial_steps))))


def prediction(
    made: Experiment, fits: Sequence[Fit], centres: Sequence[SimulatedRows], beside: Sequence[Sequence[SimulatedRows]]
) -> LinearisedPrediction:
    """Predictions of models for an experiment from its simulations.

    Parameters
    ----------
    centres : of each model
    beside : of each model, those along its parameters and along the initial state
    """
    clocked = new_part(made, centres)
    new = replace(clocked, clock=None)  # its rows, some of them additional, are whitened one by one
    blocks = [np.column_stack([new.white(view.rows) for view in centres])]
    for fit, centre, views in zip(fits, centres, beside, strict=True):
        steps = (*fit.steps, *made.initial_steps)
        columns = [new.white(v.rows - centre.rows) / step for v, step in zip(views, steps, strict=True)]
        blocks.append(np.column_stack(columns) if columns else np.zeros((centre.rows.size, 0)))
    blocks.append(new.tangents(centres[0]))
    if clocked.clock is not None:
        blocks.append(new.white(CLOCK_RATE_STD * clocked.clock)[:, None])
    whole = np.column_stack(blocks).reshape(len(made.rows), centres[0].rows.shape[1], -1)
    own = len(made.part.rows)
    triangle = _triangle(whole[:own].reshape(-1, whole.shape[2]))
    extended = [_triangle(np.vstack([triangle, row])) for row in whole[own:]]
    widths = tuple(block.shape[1] for block in blocks[1 : 1 + len(fits)])
    priors = tuple(prior_of(fit, made) for fit in fits)
    return LinearisedPrediction((triangle, *extended), widths, priors, standardised=int(clocked.clock is not None))


def new_part(made: Experiment, centres: Sequence[SimulatedRows]) -> Part:
    """Record that an experiment would give: its noise in proportion to the motion, as in the base record.

    Of an additional channel noise and motion have the ratio of a row of the same channel, or else of the first row.
    """
    part, rows = made.part, centres[0].rows
    if made.stepped is not None:
        return _stepped_part(part, made.stepped, rows)
    sources = [*range(len(part.rows)), *(_similar_row(part, channel) for _, channel in made.rows[len(part.rows) :])]
    intervals = [float(np.median(np.diff(time))) for time in (part.time, centres[0].time)]
    alike = [replace(part.noise[k], profile=1.0) for k in sources]  # of other instants no profile is known
    noise = tuple(
        _scaled(own, row, part.measured[k]).at_interval(intervals[1] / intervals[0])
        for own, k, row in zip(alike, sources, rows, strict=True)
    )
    used = np.concatenate([part.used.any(axis=1), np.ones(len(made.rows) - len(part.rows), dtype=bool)])
    moving = np.array([channel == "velocity" for _, channel in made.rows])
    trust = np.prod([view.trust for view in centres], axis=0)
    weight = np.where(moving[:, None], trust, 1.0) * used[:, None]
    period = made.excitation.period if made.excitation.harmonic else None
    time = centres[0].time
    clock = uncertain_clock(made.excitation, time, rows)
    return replace(
        part, rows=made.rows, time=time, period=period, noise=noise, weight=weight, measured=rows, clock=clock
    )


def _stepped_part(part: Part, stepped: xr.Dataset, rows: np.ndarray) -> Part:
    """Record that a stepped sine would give, of rows (row, n) in its standard uncertainties.

    How these grow with the amplitude is known to `as_read`.
    """
    noise = tuple(replace(own, profile=1.0) for own in part.noise)
    weight = np.ones(rows.shape) * part.used.any(axis=1, keepdims=True)
    time, sweep = np.arange(float(rows.shape[1])), stepped["sweep"].values
    return replace(
        part, time=time, noise=noise, used=weight > 0.0, weight=weight, measured=rows, clock=None, sweep=sweep
    )


def _similar_row(part: Part, channel: str) -> int:
    """Number of the first row of a channel; of the first of all where there is none."""
    return next((k for k, (_, own) in enumerate(part.rows) if own == channel), 0)


def _scaled(noise: Noise, row: np.ndarray, measured: np.ndarray) -> Noise:
    """Noise in proportion to a motion (n,), as in the measured one (n,)."""
    level = np.sqrt((row**2).mean() / max(float((measured**2).mean()), 1e-300))
    return replace(noise, sigma=noise.sigma * max(float(level), MIN_NOISE_RATIO))


def refitted_distance(
    made: Experiment,
    fits: tuple[Fit, Fit],
    moves: tuple[np.ndarray, np.ndarray],
    centres: Sequence[SimulatedRows],
    moved: tuple[SimulatedRows, SimulatedRows],
    additional: int | None,
) -> float:
    """Separation of two models simulated at the parameters of the linearised refit, without any linearisation.

    Parameters
    ----------
    centres : simulations of all models, which determine the noise
    moved : of the two models
    additional : number of the additional row that is measured; None: of none
    """
    new, own = new_part(made, centres), len(made.part.rows)
    measured = [*range(own), *([] if additional is None else [own + additional])]
    is_measured = np.isin(np.arange(len(made.rows)), measured)
    new = replace(new, weight=new.weight * is_measured[:, None])
    difference = new.white(moved[1].rows - moved[0].rows)
    _, distance = least_squares(new.tangents(centres[0]), difference)
    priors = [prior_of(fit, made) @ move for fit, move in zip(fits, moves, strict=True)]
    return float(np.sqrt(distance**2 + sum(k @ k for k in priors)))
