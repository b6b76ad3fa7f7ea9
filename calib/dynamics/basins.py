"""Basins of attraction: to which motion the states of a plane lead."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from calib.dynamics.exponents import largest_exponent
from calib.dynamics.irregular import EXPONENT_SIGMAS
from calib.dynamics.orbit_kind import FAILED, OrbitKind
from calib.dynamics.pseudo_orbit import pseudo_tangent
from calib.dynamics.recurrence import SAME_MOTION_DISTANCE
from calib.dynamics.setting import Setting
from calib.dynamics.settling import settled_orbit
from calib.dynamics.single_run import RETRY_FACTOR, kind_of_run
from calib.errors import CalibError, nearest
from calib.execution.pool import REFUSED, Failure, Pool
from calib.execution.pools.settings import PoolSettings
from calib.execution.workers import workers
from calib.modelling.orbit import PeriodMap
from calib.records.cycles.motion import UNDECIDED
from calib.store.chunks import Chunks, join, joined
from calib.store.environment import environment
from calib.store.plain import plain

STATES_PER_CHUNK = 32  # run, and lost by a kill, at a time
SECTION_CYCLES = 100  # by which the kind of a motion is decided
BASIN_CHUNK_SECONDS = 600.0  # s, wall clock of a chunk
EXPONENT_PERIODS = 200  # over which the exponent of a motion that has not returned is taken
IRREGULAR, LOST = 0, -1  # instead of a period: no return; no motion


@dataclass(frozen=True, eq=False)
class Plane:
    """States to start from: two components over a grid, the others held.

    Attributes
    ----------
    setting : model, excitation, values, phase of the section
    x, y : name of the state's component, its values in SI
    start : values of other components, SI; the simulator's own stand in
    settle : periods that a motion gets to settle
    """

    setting: Setting
    x: tuple[str, np.ndarray]
    y: tuple[str, np.ndarray]
    start: Mapping[str, float] = field(default_factory=dict)
    settle: int = 1000

    def __post_init__(self) -> None:
        known = self.map().names
        for name in (self.x[0], self.y[0], *self.start):
            if name not in known:
                raise CalibError(
                    f"the state has no component {name!r}{nearest(name, known)}; it has {', '.join(known)}"
                )
        if self.x[0] == self.y[0]:
            raise CalibError(f"a plane needs two components, got {self.x[0]!r} twice")
        for name, values in (self.x, self.y):
            if np.ndim(values) != 1 or not np.size(values) or not np.isfinite(values).all():
                raise CalibError(f"the values of {name!r} must be a list of finite numbers, got {values}")

    def map(self) -> PeriodMap:
        """Period map, the same for all states.

        Raises
        ------
        CalibError : the setting has none
        """
        try:
            return self.setting.map()
        except ValueError as error:
            raise CalibError(str(error)) from error

    def states(self, map: PeriodMap) -> np.ndarray:
        """States (y, x, dimension) of the plane."""
        start = [self.start.get(name, own) for name, own in zip(map.names, map.initial.tolist(), strict=True)]
        states = np.tile(start, (len(self.y[1]), len(self.x[1]), 1))
        states[..., map.names.index(self.x[0])] = self.x[1][None, :]
        states[..., map.names.index(self.y[0])] = self.y[1][:, None]
        return states

    def definition(self) -> dict[str, Any]:
        """All that determines the result, as JSON takes it."""
        own = {"x": self.x, "y": self.y, "start": self.start, "settle": self.settle}
        return plain({"plane": own, **self.setting.definition(), "environment": environment()})


def basins(
    plane: Plane,
    path: str | Path,
    jobs: int = 1,
    timeout: float = BASIN_CHUNK_SECONDS,
    fresh: bool = False,
    on_done: Callable[[int, int], None] = lambda done, total: None,
    pool: PoolSettings | None = None,
) -> xr.Dataset:
    """Find the motion that each state of a plane leads to, or resume a run that was stopped or killed.

    Motions that return are distinguished by their states; all that do not are one attractor, since their sections
    cannot be distinguished.

    Parameters
    ----------
    path : netCDF file to write; until then, finished pieces lie beside it in a hidden folder. Where the file holds
        this very plane, it is read
    jobs : child processes
    timeout : wall clock of 32 states, beyond which the slow one among them is given up  [s]
    fresh : replace the file at `path`, and delete the pieces finished so far
    on_done : called with the number of finished states and the total
    pool : where states are followed; None: in `jobs` child processes here

    Returns
    -------
    Dataset over the two components (y, x): attractor, index into the attractors, -1 where there is no motion; status,
    and the reason where it is not "ok"; by (attractor): attractor_kind, attractor_period, attractor_impacts,
    attractor_exponent [1/period], attractor_share of the plane [1]; section_x, section_y (attractor, cycle) its section
    in the plane's components

    Raises
    ------
    CalibError : `path` holds something else, or another process works on it; an excitation that the simulator refuses
    """
    path, definition = Path(path), plane.definition()
    total = len(plane.x[1]) * len(plane.y[1])
    stored = joined(path, definition, fresh)
    if stored is not None:
        on_done(total, total)
        return stored
    tasks = {
        str(first): range(first, min(first + STATES_PER_CHUNK, total)) for first in range(0, total, STATES_PER_CHUNK)
    }

    def make(chunks: Chunks) -> xr.Dataset:
        with workers(partial(_motions, plane), pool or PoolSettings(jobs=jobs), timeout) as opened:
            pieces = _pieces(plane, opened, chunks, tasks, lambda done: on_done(done, total))
        return _dataset(plane, _together([pieces[key] for key in tasks]))

    return join(path, definition, fresh, make)


def _pieces(
    plane: Plane, pool: Pool, chunks: Chunks, tasks: Mapping[str, range], on_done: Callable[[int], None]
) -> dict[str, dict[str, np.ndarray]]:
    """Arrays of each task by its key: read where they are finished, computed where not."""
    pieces = chunks.finished(tasks)
    on_done(_points(pieces))
    missing = {key: task for key, task in tasks.items() if key not in pieces}
    for key, arrays in chunks.computed(pool, missing, partial(_singly, plane, pool)):
        pieces[key] = arrays
        on_done(_points(pieces))
    return pieces


def _points(pieces: Mapping[str, Mapping[str, np.ndarray]]) -> int:
    return sum(piece["period"].size for piece in pieces.values())


def _singly(plane: Plane, pool: Pool, points: Sequence[int]) -> dict[str, np.ndarray]:
    """Run the states of a piece one by one, so that only the one that fails is lost.

    Raises
    ------
    CalibError : the simulator refuses what it is asked for
    """
    rows, nowhere = [], np.full((1, len(plane.map().names)), np.nan)
    for point in points:
        [(_, result)] = pool.map([[point]])
        if isinstance(result, Failure):
            if result.status == REFUSED:
                raise CalibError(result.reason)
            status, reason = np.array([result.status]), np.array([result.reason])
            result = {"period": np.array([LOST]), "state": nowhere, "status": status, "reason": reason}
        rows.append(result)
    return _together(rows)


def _together(pieces: Sequence[Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
    return {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}


def _motions(plane: Plane, points: Sequence[int]) -> dict[str, np.ndarray]:
    """Period, last state, status and reason of the motions from some points of the plane, counted row by row."""
    map = plane.map()
    states = plane.states(map).reshape(-1, len(map.names))
    motions = [_motion(map, states[point], plane.settle) for point in points]
    return {
        "period": np.array([LOST if one.kind == FAILED else one.period or IRREGULAR for one in motions]),
        "state": np.array([one.state for one in motions]),
        "status": np.array([one.status for one in motions]),
        "reason": np.array([one.reason for one in motions]),
    }


def _motion(map: PeriodMap, state: np.ndarray, settle: int) -> OrbitKind:
    """Motion that a state leads to; one that does not return has a growing difference or got all the time to settle."""
    motion = settled_orbit(map, state, settle, SECTION_CYCLES)
    if motion.kind != UNDECIDED:
        return motion
    exponent = largest_exponent(map, motion.state, EXPONENT_PERIODS, pseudo_tangent)
    if exponent.value > EXPONENT_SIGMAS * exponent.error:
        return motion
    return settled_orbit(map, motion.state, RETRY_FACTOR * settle, SECTION_CYCLES, motion.dropped + SECTION_CYCLES)


def _dataset(plane: Plane, motions: Mapping[str, np.ndarray]) -> xr.Dataset:
    map = plane.map()
    attractor = np.full(motions["period"].size, -1)
    members: list[tuple[int, np.ndarray]] = []  # period, states of one return
    for point, (period, state) in enumerate(zip(motions["period"].tolist(), motions["state"], strict=True)):
        if period == LOST:
            continue
        same = (k for k, (own, states) in enumerate(members) if own == period and _near(map, states, state, period))
        attractor[point] = index = next(same, len(members))
        if index == len(members):
            members.append((period, map.orbit(state, max(1, period)).states))
    kinds = [kind_of_run(map, states[-1], plane.settle) for _, states in members]
    sections = [kind.orbit.states[: period or None] for kind, (period, _) in zip(kinds, members, strict=True)]
    # one of those that did not return has done so after all: what the others are is not known
    names = [
        UNDECIDED if own == IRREGULAR and kind.period else kind.kind
        for kind, (own, _) in zip(kinds, members, strict=True)
    ]
    share = np.array([(attractor == k).mean() for k in range(len(members))])
    (y, rows), (x, columns) = plane.y, plane.x
    units = dict(zip(map.names, map.units, strict=True))
    of_start = {"attractor": attractor, "status": motions["status"], "reason": motions["reason"]}
    return xr.Dataset(
        {
            **{name: ((y, x), values.reshape(len(rows), len(columns))) for name, values in of_start.items()},
            "attractor_share": ("attractor", share, {"units": "1"}),
            "attractor_kind": ("attractor", np.array(names, dtype=str)),
            "attractor_period": ("attractor", np.array([kind.period for kind in kinds], dtype=int)),
            "attractor_impacts": ("attractor", np.array([kind.impacts for kind in kinds], dtype=int)),
            "attractor_exponent": ("attractor", np.array([kind.exponent for kind in kinds]), {"units": "1"}),
            **{
                f"section_{axis}": (("attractor", "cycle"), _padded([s[:, map.names.index(name)] for s in sections]))
                for axis, name in (("x", x), ("y", y))
            },
        },
        coords={y: (y, rows, {"units": units[y]}), x: (x, columns, {"units": units[x]})},
        attrs={"model": plane.setting.model.name, "phase": plane.setting.phase},
    )


def _padded(rows: Sequence[np.ndarray]) -> np.ndarray:
    """Rows of different lengths as one array, padded with NaN."""
    table = np.full((len(rows), max((row.size for row in rows), default=0)), np.nan)
    for k, row in enumerate(rows):
        table[k, : row.size] = row
    return table


def _near(map: PeriodMap, states: np.ndarray, state: np.ndarray, period: int) -> bool:
    return period == IRREGULAR or bool((np.abs((states - state) / map.scale).max(axis=1) < SAME_MOTION_DISTANCE).any())
