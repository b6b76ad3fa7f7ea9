"""Simulations as a diagnosis needs them: one record at a time, seen as the instrument would have seen it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr

from calib.execution.pool import Failure, in_order
from calib.modelling.effect import Effect
from calib.modelling.model import Model, Request
from calib.modelling.parameter import values_for
from calib.objective import FeatureValue, Objective, initial_state, simulations, trusted, with_initial_state
from calib.records import OK, prescribed
from calib.records.cycles import IRREGULAR, kind_of_motion
from calib.records.excitation import Excitation
from calib.study import Pool

STEPS = 50_000  # of a run that starts near its motion: one that takes more has left it
MARK = "nuisance_"  # before the name of a nuisance among the attributes of an aligned record


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
        """Return it with some components changed by so much."""
        return replace(self, state={name: value + moves.get(name, 0.0) for name, value in self.state.items()})


@dataclass(frozen=True, eq=False)
class Run:
    """One simulation that is asked for.

    Attributes
    ----------
    record : whose excitation and request it has
    values : of the model with its effects, in SI
    effects : that the model is extended by
    state : near which the stationary motion lies; None where that is not known
    excitation : in the place of the record's; what is simulated is then not aligned, for nothing was measured
    start : initial state, where that is a nuisance; None: it is solved for
    rows : (body, channel) pairs in the place of those of `Bench.rows`; empty for these
    times : (n,) when to sample, in the place of the request's [s]; None for these
    """

    record: str
    values: Mapping[str, float]
    effects: tuple[Effect, ...] = ()
    state: np.ndarray | None = None
    excitation: Excitation | None = None
    start: Start | None = None
    rows: tuple[tuple[str, str], ...] = ()
    times: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class SimulatedRows:
    """A simulated record on the time base of the measured one, its nuisances solved for.

    Attributes
    ----------
    rows : (row, n) channels of bodies, in the order of `Bench.rows` of the record
    trust : (n,) in velocities, 0 next to an impact of the simulation
    state : of the simulator at the end, from which the next run starts; None without one
    nuisances : by name, in SI
    given : (body, channel) pairs that the simulation prescribes
    impacts : how many there are in the record; None where the simulator does not tell
    features : scalar features, measured and simulated; only of a run without `state`
    wrong : how its kind of motion differs from the measured one, or where nothing was measured, that it is irregular;
        "" where that is not so, or was not asked for
    time : (n,) instants of the simulation where nothing was measured  [s]
    start : initial state, where that is a nuisance; None where it is none
    simulations : that it took
    status, reason : "ok", or why there is nothing
    """

    rows: np.ndarray
    trust: np.ndarray
    state: np.ndarray | None = None
    nuisances: Mapping[str, float] = field(default_factory=dict)
    given: tuple[tuple[str, str], ...] = ()
    impacts: int | None = None
    features: tuple[FeatureValue, ...] = ()
    wrong: str = ""
    time: np.ndarray = field(default_factory=lambda: np.zeros(0))
    start: Start | None = None
    simulations: int = 1
    status: str = OK
    reason: str = ""

    @property
    def initial(self) -> np.ndarray:
        """Change (k, row, n) of the rows with each component of the initial state, where that is a nuisance."""
        return np.zeros((0, *self.rows.shape)) if self.start is None else self.start.slopes

    @property
    def usable(self) -> bool:
        """Whether there is a motion."""
        return self.status == OK


@dataclass(frozen=True, eq=False)
class Bench:
    """What a child process needs to simulate any record of a study with any effect.

    Attributes
    ----------
    model : calibrated
    objective : over all records, by which simulations are aligned
    rows : record -> (body, channel) pairs that are looked at
    """

    model: Model
    objective: Objective
    rows: Mapping[str, Sequence[tuple[str, str]]]

    def __call__(self, run: Run) -> SimulatedRows:
        """Simulate and align."""
        reference = self.objective.references[run.record]
        request: Request = reference.request
        if run.times is not None:
            request = replace(request, times=run.times)
        if run.state is not None:
            budget = min(request.step_budget, STEPS)
            request = replace(request, initial_state=run.state, near=True, step_budget=budget)
        model = self.model.extended(*run.effects)
        excitation = run.excitation or reference.excitation
        if excitation.quantity == "free decay" and request.times is None:
            time = reference.record.time.values
            request = replace(request, times=time - time[0])
        asked = run.excitation is None
        values, start, slopes = values_for(run.values, run.record), run.start, {}
        if start is not None:
            record = with_initial_state(model.run({**values, **start.state}, excitation, request), start.state)
        elif asked and reference.frees_initial_state:
            released = self.objective.released(run.record, model, values, request)
            record, slopes = released.record, released.slopes
        else:
            record = model.run(values, excitation, request)
        status = record.attrs["status"]
        if status != OK:
            return replace(_nothing(status, str(record.attrs.get("reason", ""))), simulations=simulations(record))
        seen = self.objective.aligned(run.record, record) if asked else record.assign(trust=("time", trusted(record)))
        pairs = run.rows or self.rows[run.record]
        missing = [channel for _, channel in pairs if channel not in seen.variables]
        if missing:
            return _nothing("no channel", f"the simulation has no {missing[0]}")
        bodies = [str(body) for body in seen.body.values]
        rows = np.array([seen[channel].values[bodies.index(body)] for body, channel in pairs])
        if not np.isfinite(rows).all():
            return _nothing("not finite", "the simulation holds NaN or infinity")
        if slopes:
            changes = [[own[channel][bodies.index(body)] for body, channel in pairs] for own in slopes.values()]
            start = Start(initial_state(record), np.array(changes))
        first = asked and run.state is None and run.start is None
        return SimulatedRows(
            rows=rows,
            trust=seen["trust"].values,
            state=record["state"].values if "state" in record.variables else None,
            nuisances={k.removeprefix(MARK): v for k, v in seen.attrs.items() if k.startswith(MARK)},
            given=prescribed(record),
            impacts=record.sizes.get("impact"),
            features=tuple(self.objective.features(run.record, record)) if first else (),
            wrong=_irregular(record) if not asked else self.objective.wrong_kind(run.record, record) if first else "",
            time=np.zeros(0) if asked else record["time"].values,
            start=start,
            simulations=simulations(record),
        )


def _irregular(record: xr.Dataset) -> str:
    """Why a motion under a periodic excitation is irregular; "" where it is not, or not known to be."""
    motion = kind_of_motion(record)
    return motion.evidence if motion.kind == IRREGULAR else ""


def _nothing(status: str, reason: str) -> SimulatedRows:
    return SimulatedRows(np.zeros((0, 0)), np.zeros(0), status=status, reason=reason)


def simulated(pool: Pool, runs: Sequence[Run]) -> list[SimulatedRows]:
    """Simulate side by side; what fails has a status."""
    answers = in_order(pool, runs)
    return [_nothing(a.status, a.reason) if isinstance(a, Failure) else a for a in answers]
