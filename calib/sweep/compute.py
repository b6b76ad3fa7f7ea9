"""The motions of some points of a sweep, as arrays: what a child process is asked for."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from calib.dynamics.contract import PeriodMap
from calib.dynamics.motion import FAILED, OrbitKind, kind_of_orbit
from calib.sweep.plan import Sweep

IMPOSSIBLE = "impossible value"


class Task(NamedTuple):
    """Points (k,) to run, from a state by component: each from it, or `carried` from one to the next."""

    points: tuple[int, ...]
    state: Mapping[str, float]
    carried: bool


def motions(sweep: Sweep, task: Task) -> dict[str, np.ndarray]:
    """Arrays by name, the point leading, of the points of a task; see `calib.sweep.run.run`.

    Beside what a sweep holds: `names` and `units` of the state's components.
    """
    rows, state = [], dict(task.state)
    for point in task.points:
        try:
            map = sweep.map_at(point)
        except ValueError as error:
            rows.append(failed_row(sweep, IMPOSSIBLE, str(error)))
            continue
        found = kind_of_orbit(map, _begun(map, state), sweep.settle, sweep.cycles)
        rows.append(_row(sweep, map, found))
        if task.carried and found.kind != FAILED:
            state = dict(zip(map.names, found.state.tolist(), strict=True))
    return stacked(rows)


def _begun(map: PeriodMap, state: Mapping[str, float]) -> np.ndarray:
    """State of the map with the components that are given; the others are its own."""
    return np.array([state.get(name, own) for name, own in zip(map.names, map.initial.tolist(), strict=True)])


def _row(sweep: Sweep, map: PeriodMap, found: OrbitKind) -> dict[str, np.ndarray]:
    if found.kind == FAILED:
        return failed_row(sweep, found.status, found.reason)
    impacts = found.orbit.impacts
    return {
        "displacement": found.orbit.displacement,
        "velocity": found.orbit.velocity,
        "kind": np.array(found.kind),
        "period": np.array(found.period),
        "impacts": np.array(found.impacts),
        "impacts_per_period": np.array(found.impacts_per_period),
        "exponent": np.array(found.exponent),
        "exponent_error": np.array(found.error),
        "zero_one": np.array(found.zero_one),
        "contact": np.array(found.contact),
        "dropped": np.array(found.dropped),
        "status": np.array(found.status),
        "evidence": np.array(found.evidence),
        "impact_phase": (impacts[:, 1] + sweep.setting.phase) % 1.0,
        "impact_speed": impacts[:, 2],
        "state": found.state,
        "names": np.array(map.names),
        "units": np.array(map.units),
    }


def failed_row(sweep: Sweep, status: str, reason: str) -> dict[str, np.ndarray]:
    """Arrays of a point without a motion."""
    none, nothing = np.array(np.nan), np.full((len(sweep.setting.model.bodies), sweep.cycles), np.nan)
    return {
        "displacement": nothing,
        "velocity": nothing,
        "kind": np.array(FAILED),
        "period": np.array(0),
        "impacts": np.array(-1),
        "impacts_per_period": none,
        "exponent": none,
        "exponent_error": none,
        "zero_one": none,
        "contact": none,
        "dropped": np.array(0),
        "status": np.array(status),
        "evidence": np.array(reason),
        "impact_phase": np.zeros(0),
        "impact_speed": np.zeros(0),
        "state": np.zeros(0),
        "names": np.array([], dtype=str),
        "units": np.array([], dtype=str),
    }


def stacked(rows: Sequence[Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Stack points (or pieces of one point each); where their lengths differ, they are padded: NaN, or empty texts."""
    arrays = {}
    for name in rows[0]:
        parts = [row[name] for row in rows]
        kind = np.result_type(*parts)
        shape = np.max([part.shape for part in parts], axis=0).astype(int) if parts[0].ndim else ()
        padded = np.full((len(parts), *shape), np.nan if kind.kind == "f" else np.zeros((), kind), dtype=kind)
        for k, part in enumerate(parts):
            padded[(k, *(slice(size) for size in part.shape))] = part
        arrays[name] = padded
    return arrays
