"""Simulations as a diagnosis compares them: one record at a time, aligned with the measured one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr

from calib.dynamics.swept_motions import NOT_PERIODIC
from calib.dynamics.swept_paths import KnownSweeps
from calib.dynamics.swept_response import swept_curves
from calib.dynamics.swept_states import swept_states
from calib.execution.pool import Failure, in_order
from calib.modelling.effect import Effect
from calib.modelling.model import Model
from calib.modelling.parameter import values_for
from calib.modelling.simulator import Request
from calib.objective import FeatureValue, Objective, initial_state, simulations, trusted, with_initial_state
from calib.objective.prepared_response import PreparedResponse
from calib.objective.stable_stretches import harmonics_at
from calib.records import OK, prescribed
from calib.records.cycles import IRREGULAR, kind_of_motion
from calib.records.excitation import Excitation
from calib.study import Pool

MAX_STEPS_NEAR_MOTION = 50_000  # of a run that starts near its stationary motion: one that takes more has left it
NUISANCE_PREFIX = "nuisance_"  # of a nuisance's name among the attributes of an aligned record


@dataclass(frozen=True, eq=False)
class Start:
    """Initial state of a record where that is a nuisance.

    Attributes
    ----------
    state : parameter -> value  [SI]
    slopes : (k, row, n) change of the compared rows with each of these  [per SI unit]
    """

    state: Mapping[str, float]
    slopes: np.ndarray

    def moved(self, moves: Mapping[str, float]) -> "Start":
        """Return it with components changed by these amounts."""
        return replace(self, state={name: value + moves.get(name, 0.0) for name, value in self.state.items()})


@dataclass(frozen=True, eq=False)
class Run:
    """A request for one simulation.

    Attributes
    ----------
    record : whose excitation and request it has
    values : of the model with its effects, in SI
    effects : that the model is extended by
    state : near which the stationary motion lies; None where it is unknown
    excitation : instead of the record's; the simulation is then not aligned, for nothing was measured
    start : initial state, where that is a nuisance; None: it is solved for
    rows : (body, channel) pairs instead of those of `Bench.rows`; empty for these. Where not all of them were measured,
        they are not aligned; of a frequency response those along the motions, displacements and velocities
    times : (n,) instants of the samples instead of the request's [s]; None for these
    sweeps : beside which the curves of a frequency response are sought first
    to_first_order : whether curves beside `sweeps` are wanted to first order in what differs from these
    stepped : sweeps that are made instead of the record's, and with which the simulation is compared
    """

    record: str
    values: Mapping[str, float]
    effects: tuple[Effect, ...] = ()
    state: np.ndarray | None = None
    excitation: Excitation | None = None
    start: Start | None = None
    rows: tuple[tuple[str, str], ...] = ()
    times: np.ndarray | None = None
    sweeps: KnownSweeps = field(default_factory=dict)
    to_first_order: bool = False
    stepped: xr.Dataset | None = None


@dataclass(frozen=True, eq=False)
class SimulatedRows:
    """A simulated record on the time base of the measured one, its nuisances solved for.

    Attributes
    ----------
    rows : (row, n) channels of bodies, in the order of `Bench.rows` of the record
    trust : (n,) in velocities, 0 next to an impact of the simulation; of a frequency response that in its distances,
        which the rows have in them: less than 1 at a point in doubt that is far
    state : of the simulator at the end, from which the next run starts; None without one
    sweeps : curves of a frequency response, beside which those of the next run are sought
    nuisances : by name, in SI
    given : (body, channel) pairs that the simulation prescribes
    impacts : number in the record; None where the simulator does not report impacts
    features : scalar features, measured and simulated; only of a run near no other
    wrong : how its kind of motion differs from the measured one, or where nothing was measured, that it is irregular;
        "" where neither holds, or neither was checked
    time : (n,) instants of the simulation where nothing was measured  [s]
    start : initial state, where that is a nuisance; None where it is none
    read : (order, body, point) complex amplitudes that sweeps would read which are made instead of the record's  [m]
    simulations : that it took
    status, reason : "ok", or why there are no rows
    """

    rows: np.ndarray
    trust: np.ndarray
    state: np.ndarray | None = None
    sweeps: KnownSweeps = field(default_factory=dict)
    nuisances: Mapping[str, float] = field(default_factory=dict)
    given: tuple[tuple[str, str], ...] = ()
    impacts: int | None = None
    features: tuple[FeatureValue, ...] = ()
    wrong: str = ""
    time: np.ndarray = field(default_factory=lambda: np.zeros(0))
    start: Start | None = None
    read: np.ndarray = field(default_factory=lambda: np.zeros((0, 0, 0), dtype=complex))
    simulations: int = 1
    status: str = OK
    reason: str = ""

    @property
    def initial(self) -> np.ndarray:
        """Change (k, row, n) of the rows with each component of the initial state, where that is a nuisance."""
        return np.zeros((0, *self.rows.shape)) if self.start is None else self.start.slopes

    @property
    def usable(self) -> bool:
        """Whether the simulation succeeded."""
        return self.status == OK


@dataclass(frozen=True, eq=False)
class Bench:
    """What a child process needs to simulate any record of a study with any effect.

    Attributes
    ----------
    model : calibrated
    objective : over all records, by which simulations are aligned
    rows : record -> (body, channel) pairs that are compared
    """

    model: Model
    objective: Objective
    rows: Mapping[str, Sequence[tuple[str, str]]]

    def __call__(self, run: Run) -> SimulatedRows:
        """Simulate and align."""
        if run.stepped is not None:
            return self._swept(run, run.stepped)
        if self.objective.references[run.record].is_swept and not set(run.rows) <= set(self.rows[run.record]):
            return self._states(run)
        record, slopes, sweeps = self._simulated(run)
        status = record.attrs["status"]
        if status != OK:
            return replace(_failed(status, str(record.attrs.get("reason", ""))), simulations=simulations(record))
        measured = run.excitation is None
        compared = (
            self.objective.compared(run.record, record) if measured else record.assign(trust=("time", trusted(record)))
        )
        pairs = run.rows or self.rows[run.record]
        if run.rows and not _has(compared, pairs):  # states that were not measured: those of the simulation
            compared, slopes = record.assign(trust=("time", trusted(record))), {}
        missing = [channel for _, channel in pairs if channel not in compared.variables]
        if missing:
            return _failed("no channel", f"the simulation has no {missing[0]}")
        rows = _rows(compared, pairs)
        if not np.isfinite(rows).all():
            return _failed("not finite", "the simulation holds NaN or infinity")
        start = run.start
        if slopes:
            bodies = [str(body) for body in compared.body.values]
            changes = [[own[channel][bodies.index(body)] for body, channel in pairs] for own in slopes.values()]
            start = Start(initial_state(record), np.array(changes))
        first = measured and run.state is None and run.start is None and not run.sweeps
        wrong = self.objective.wrong_kind(run.record, record) if first else ""
        return SimulatedRows(
            rows=rows,
            trust=compared["trust"].values,
            state=record["state"].values if "state" in record.variables else None,
            sweeps=sweeps,
            nuisances=_nuisances(compared),
            given=prescribed(record),
            impacts=record.sizes.get("impact"),
            features=tuple(self.objective.features(run.record, record)) if first else (),
            wrong=wrong if measured else _irregular(record),
            time=np.zeros(0) if measured else record["time"].values,
            start=start,
            simulations=simulations(record),
        )

    def _states(self, run: Run) -> SimulatedRows:
        """Displacements and velocities along the motions of a frequency response."""
        reference, model = self.objective.references[run.record], self.model.extended(*run.effects)
        values = values_for(run.values, run.record)
        record = swept_states(model, values, reference.excitation, reference.record, run.sweeps)
        if record.attrs["status"] != OK:
            return _failed(record.attrs["status"], str(record.attrs.get("reason", "")))
        rows = _rows(record, run.rows)
        return SimulatedRows(rows, np.ones(rows.shape[1]))

    def _swept(self, run: Run, stepped: xr.Dataset) -> SimulatedRows:
        """Simulate sweeps that are not the record's."""
        reference = replace(self.objective.references[run.record], record=stepped)
        model, values = self.model.extended(*run.effects), values_for(run.values, run.record)
        record, curves = swept_curves(model, values, reference.excitation, stepped, run.sweeps)
        prepared = PreparedResponse(reference, self.objective.terms_of(reference.name))
        failure = prepared.failure(record)
        if failure is not None and failure[0] != NOT_PERIODIC:
            return _failed(*failure)
        read = np.full((1, 1, 1), np.nan) if failure else harmonics_at(record.sel(body=stepped.body.values), stepped)
        if not np.isfinite(read).all():
            reason = failure[1] if failure else "a sweep meets frequencies at which the motion is not periodic"
            return SimulatedRows(np.zeros((0, 0)), np.zeros(0), wrong=reason)
        compared = prepared.compared(record)
        rows = _rows(compared, run.rows or self.rows[run.record])
        return SimulatedRows(rows, compared["trust"].values, sweeps=curves, read=read)

    def _simulated(self, run: Run) -> tuple[xr.Dataset, Mapping[str, Mapping[str, np.ndarray]], KnownSweeps]:
        """The simulated record, its derivatives by an initial state that was solved for, else none, and its curves."""
        reference = self.objective.references[run.record]
        excitation = run.excitation or reference.excitation
        request, model = self._request(run, excitation), self.model.extended(*run.effects)
        values, start = values_for(run.values, run.record), run.start
        if start is not None:
            return with_initial_state(model.run({**values, **start.state}, excitation, request), start.state), {}, {}
        if run.excitation is None and reference.frees_initial_state:
            released = self.objective.released(run.record, model, values, request)
            return released.record, released.slopes, {}
        if run.excitation is None and reference.is_swept:
            record, sweeps = swept_curves(model, values, excitation, reference.record, run.sweeps, run.to_first_order)
            return record, {}, {} if run.to_first_order else sweeps
        return model.run(values, excitation, request), {}, {}

    def _request(self, run: Run, excitation: Excitation) -> Request:
        """What the simulator is asked to compute."""
        reference = self.objective.references[run.record]
        request: Request = reference.request
        if run.times is not None:
            request = replace(request, times=run.times)
        if run.state is not None:
            budget = min(request.step_budget, MAX_STEPS_NEAR_MOTION)
            request = replace(request, initial_state=run.state, near=True, step_budget=budget)
        if excitation.quantity == "free decay" and request.times is None:
            time = reference.record.time.values
            request = replace(request, times=time - time[0])
        return request


def _rows(record: xr.Dataset, pairs: Sequence[tuple[str, str]]) -> np.ndarray:
    """Channels of bodies (row, n)."""
    bodies = [str(body) for body in record.body.values]
    return np.array([record[channel].values[bodies.index(body)] for body, channel in pairs])


def _has(record: xr.Dataset, pairs: Sequence[tuple[str, str]]) -> bool:
    """Whether a record has these channels of bodies."""
    bodies = {str(body) for body in record.body.values}
    return all(body in bodies and channel in record.variables for body, channel in pairs)


def _nuisances(aligned: xr.Dataset) -> dict[str, float]:
    """Nuisances that were solved for in aligning a record, by name, in SI."""
    marked = ((str(name), value) for name, value in aligned.attrs.items())
    return {name.removeprefix(NUISANCE_PREFIX): value for name, value in marked if name.startswith(NUISANCE_PREFIX)}


def _irregular(record: xr.Dataset) -> str:
    """Why a motion under a periodic excitation is irregular; "" where it is not, or not known to be."""
    motion = kind_of_motion(record)
    return motion.evidence if motion.kind == IRREGULAR else ""


def _failed(status: str, reason: str) -> SimulatedRows:
    """The result of a run without rows, and why."""
    return SimulatedRows(np.zeros((0, 0)), np.zeros(0), status=status, reason=reason)


def simulated(pool: Pool, runs: Sequence[Run]) -> list[SimulatedRows]:
    """Simulate side by side; a run that fails has a status."""
    answers = in_order(pool, runs)
    return [_failed(a.status, a.reason) if isinstance(a, Failure) else a for a in answers]
