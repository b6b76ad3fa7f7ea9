"""Basins of attraction: to which motion the states of a plane lead."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from calib.dynamics.contract import PeriodMap
from calib.dynamics.motion import FAILED, kind_of_orbit, settled_orbit
from calib.dynamics.setting import Setting
from calib.errors import CalibError, nearest
from calib.pool import REFUSED, Failure, LocalPool
from calib.store.chunks import Chunks, joined, read_joined, write_joined
from calib.store.environment import environment
from calib.store.plain import plain

CHUNK = 32  # states run, and lost by a kill, at a time
CYCLES = 100  # periods by which a motion is told
TIMEOUT = 600.0  # s, wall clock of a chunk
SAME = 1e-4  # how near a motion comes to another one that it is, as a share of the map's scale
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

    def __post_init__(self):
        known = self.setting.map().names
        for name in (self.x[0], self.y[0], *self.start):
            if name not in known:
                raise CalibError(
                    f"the state has no component {name!r}{nearest(name, known)}; it has {', '.join(known)}"
                )
        if self.x[0] == self.y[0]:
            raise CalibError(f"a plane needs two components, got {self.x[0]!r} twice")

    def states(self, map: PeriodMap) -> np.ndarray:
        """States (y, x, dimension) of the plane."""
        start = [self.start.get(name, own) for name, own in zip(map.names, map.initial.tolist(), strict=True)]
        states = np.tile(start, (len(self.y[1]), len(self.x[1]), 1))
        states[..., map.names.index(self.x[0])] = self.x[1][None, :]
        states[..., map.names.index(self.y[0])] = self.y[1][:, None]
        return states

    def definition(self) -> dict[str, Any]:
        """All that decides what comes out, as JSON takes it."""
        own = {"x": self.x, "y": self.y, "start": self.start, "settle": self.settle}
        return plain({"plane": own, **self.setting.definition(), "environment": environment()})


def basins(
    plane: Plane,
    path: str | Path,
    jobs: int = 1,
    timeout: float = TIMEOUT,
    fresh: bool = False,
    on_done: Callable[[int, int], None] = lambda done, total: None,
) -> xr.Dataset:
    """Find the motion that each state of a plane leads to, or go on where that was stopped or killed.

    Motions that return are told apart by their states; all that do not are one attractor, since a section does not
    tell them apart. A state beyond the stop is put back onto it.

    Parameters
    ----------
    path : netCDF file to write; until then, what is done lies beside it in a hidden folder. Where the file holds this
        very plane, it is read
    jobs : child processes
    timeout : wall clock of 32 states, of which all are lost where it passes  [s]
    fresh : take the place of what `path` holds, and forget what was done so far
    on_done : told how many states are done, and of how many

    Returns
    -------
    Dataset over the two components (y, x): attractor, index into the attractors, -1 where there is no motion; by
    (attractor): attractor_kind, attractor_period, attractor_impacts, attractor_exponent [1/period], attractor_share of
    the plane [1]; section_x, section_y (attractor, cycle) its section in the plane's components

    Raises
    ------
    CalibError : `path` holds something else; an excitation that the simulator refuses
    """
    path, definition = Path(path), plane.definition()
    total = len(plane.x[1]) * len(plane.y[1])
    if fresh:
        path.unlink(missing_ok=True)
    found = joined(path, definition)
    if found is not None:
        on_done(total, total)
        return found
    path.parent.mkdir(parents=True, exist_ok=True)
    tasks = {str(first): range(first, min(first + CHUNK, total)) for first in range(0, total, CHUNK)}
    periods, ends = np.full(total, LOST), np.full((total, len(plane.setting.map().names)), np.nan)
    done = 0
    with Chunks(path, definition) as chunks, LocalPool(partial(_motions, plane), jobs, timeout) as pool:
        if fresh:
            chunks.clear()
        for key, result in chunks.done(pool, tasks):
            if isinstance(result, Failure):
                if result.status == REFUSED:
                    raise CalibError(result.reason)
            else:
                periods[tasks[key]], ends[tasks[key]] = result["period"], result["state"]
            done += len(tasks[key])
            on_done(done, total)
        write_joined(_dataset(plane, periods, ends), definition, path)
        chunks.clear()
    return read_joined(path)


def _motions(plane: Plane, points: Sequence[int]) -> dict[str, np.ndarray]:
    """Period and last state of the motions from some points of the plane, counted row by row."""
    map = plane.setting.map()
    states = plane.states(map).reshape(-1, len(map.names))
    found = [settled_orbit(map, states[point], plane.settle, CYCLES) for point in points]
    return {
        "period": np.array([LOST if f.kind == FAILED else f.period or IRREGULAR for f in found]),
        "state": np.array([f.state for f in found]),
    }


def _dataset(plane: Plane, periods: np.ndarray, ends: np.ndarray) -> xr.Dataset:
    map = plane.setting.map()
    attractor = np.full(periods.size, -1)
    members: list[tuple[int, np.ndarray]] = []  # period, states of one return
    for point, (period, state) in enumerate(zip(periods.tolist(), ends, strict=True)):
        if period == LOST:
            continue
        same = (k for k, (own, states) in enumerate(members) if own == period and _near(map, states, state, period))
        attractor[point] = index = next(same, len(members))
        if index == len(members):
            members.append((period, map.orbit(state, max(1, period)).states))
    rows = list(_described(plane, map, members))
    width = max((row["section_x"].size for row in rows), default=0)
    by_attractor = {}
    for name in rows[0] if rows else ():
        values = [row[name] for row in rows]
        if np.ndim(values[0]):
            padded = [np.pad(v, (0, width - v.size), constant_values=np.nan) for v in values]
            by_attractor[name] = (("attractor", "cycle"), np.array(padded))
        else:
            by_attractor[name] = ("attractor", np.array(values))
    share = np.array([(attractor == k).mean() for k in range(len(members))])
    units = dict(zip(map.names, map.units, strict=True))
    return xr.Dataset(
        {
            "attractor": ((plane.y[0], plane.x[0]), attractor.reshape(len(plane.y[1]), len(plane.x[1]))),
            "attractor_share": ("attractor", share, {"units": "1"}),
            **by_attractor,
        },
        coords={name: (name, values, {"units": units[name]}) for name, values in (plane.y, plane.x)},
        attrs={"model": plane.setting.model.name, "phase": plane.setting.phase},
    )


def _near(map: PeriodMap, states: np.ndarray, state: np.ndarray, period: int) -> bool:
    return period == IRREGULAR or bool((np.abs((states - state) / map.scale).max(axis=1) < SAME).any())


def _described(plane: Plane, map: PeriodMap, members: Sequence[tuple[int, np.ndarray]]) -> Iterator[dict[str, Any]]:
    """Kind and section of each attractor, from one of its states."""
    places = [map.names.index(name) for name, _ in (plane.x, plane.y)]
    for period, states in members:
        found = kind_of_orbit(map, states[-1], plane.settle)
        section = found.orbit.states[: period or None]
        yield {
            "attractor_kind": found.kind,
            "attractor_period": found.period,
            "attractor_impacts": found.impacts,
            "attractor_exponent": found.exponent,
            "section_x": section[:, places[0]],
            "section_y": section[:, places[1]],
        }
