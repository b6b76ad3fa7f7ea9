"""The motions at some points of a sweep, as arrays."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from calib.dynamics.motion import kind_of_orbit
from calib.dynamics.orbit_kind import FAILED, OrbitKind
from calib.modelling.orbit import PeriodMap
from calib.sweep.plan import Sweep

IMPOSSIBLE_VALUE = "impossible value"


class SweepTask(NamedTuple):
    """Points (k,) to run, from a state by component: each from it, or `carried` from one to the next."""

    points: tuple[int, ...]
    state: Mapping[str, float]
    carried: bool


NO_MOTION = {  # name of each scalar of a motion at a value -> what it is where there is no motion
    "kind": FAILED,
    "period": 0,
    "impacts": -1,
    "impacts_per_period": math.nan,
    "exponent": math.nan,
    "exponent_error": math.nan,
    "zero_one": math.nan,
    "contact": math.nan,
    "dropped": 0,
    "share": math.nan,
    "sightings": 0,
    "evidence": "",
}
OTHER = "other_"  # prefix of the arrays of the motions that coexist with the one that gives the kind


def motions(sweep: Sweep, task: SweepTask) -> dict[str, np.ndarray]:
    """Arrays by name, the point leading, of the points of a task; see `calib.sweep.run.run`.

    Beside what a sweep holds: `names` and `units` of the state's components.
    """
    rows, state = [], dict(task.state)
    for point in task.points:
        try:
            map = sweep.map_at(point)
        except ValueError as error:
            rows.append(failed_row(sweep, IMPOSSIBLE_VALUE, str(error)))
            continue
        motion = kind_of_orbit(map, begun(map, state), sweep.settle, sweep.cycles, sweep.runs, explore=False)
        if task.carried:
            motion = as_run(motion)
        rows.append(_row(sweep, map, motion))
        if task.carried and motion.kind != FAILED:
            state = dict(zip(map.names, motion.state.tolist(), strict=True))
    return stacked(rows)


def begun(map: PeriodMap, state: Mapping[str, float]) -> np.ndarray:
    """State of the map with the components that are given; the others are its own."""
    return np.array([state.get(name, own) for name, own in zip(map.names, map.initial.tolist(), strict=True)])


def as_run(motion: OrbitKind) -> OrbitKind:
    """Return the motion that the run itself stays on, with a stable one that coexists with it among the others."""
    if motion.run_state is None:
        return motion
    [run] = [one for one in motion.coexisting if one.state is motion.run_state]
    others = tuple(one for one in motion.coexisting if one is not run)
    stable = replace(motion, coexisting=(), run_state=None)
    text = f"{run.evidence}; a motion that is {motion.kind} lies beside it"
    text += f"; {motion.escape}" if motion.escape else ""
    return replace(
        run, evidence=text, coexisting=(stable, *others), escape=motion.escape, certain=False, run_state=None
    )


def motion_arrays(sweep: Sweep, motion: OrbitKind) -> dict[str, np.ndarray]:
    """Arrays of one motion by name."""
    impacts = motion.orbit.impacts
    scalars = {
        "impacts_per_period": motion.impacts_per_period,
        "exponent": motion.exponent,
        "exponent_error": motion.error,
        **{name: getattr(motion, name) for name in ("kind", "period", "impacts", "zero_one", "contact", "dropped")},
        **{name: getattr(motion, name) for name in ("share", "sightings", "evidence")},
    }
    return {
        **{name: np.array(value) for name, value in scalars.items()},
        "displacement": motion.orbit.displacement,
        "velocity": motion.orbit.velocity,
        "impact_phase": (impacts[:, 1] + sweep.setting.phase) % 1.0,
        "impact_speed": impacts[:, 2],
        "state": motion.state,
    }


def _row(sweep: Sweep, map: PeriodMap, motion: OrbitKind) -> dict[str, np.ndarray]:
    if motion.kind == FAILED:
        return failed_row(sweep, motion.status, motion.reason)
    low, high = motion.escape.interval if motion.escape else (math.nan, math.nan)
    others = stacked([no_motion(sweep), *(motion_arrays(sweep, one) for one in motion.coexisting)])
    return {
        **motion_arrays(sweep, motion),
        **{f"{OTHER}{name}": array[1:] for name, array in others.items()},
        "status": np.array(motion.status),
        "certain": np.array(motion.certain),
        "runs": np.array(motion.runs),
        "escape_mean": np.array(motion.escape.mean if motion.escape else math.nan),
        "escape_low": np.array(low),
        "escape_high": np.array(high),
        "names": np.array(map.names),
        "units": np.array(map.units),
    }


def no_motion(sweep: Sweep) -> dict[str, np.ndarray]:
    """Arrays that stand for no motion, by the names of those of a motion."""
    nothing = np.full((len(sweep.setting.model.bodies), sweep.cycles), np.nan)
    empty = dict.fromkeys(("impact_phase", "impact_speed", "state"), np.zeros(0))
    scalars = {name: np.array(value) for name, value in NO_MOTION.items()}
    return {**scalars, "displacement": nothing, "velocity": nothing, **empty}


def failed_row(sweep: Sweep, status: str, reason: str) -> dict[str, np.ndarray]:
    """Arrays of a point without a motion."""
    none = no_motion(sweep)
    return {
        **none,
        "evidence": np.array(reason),
        **{f"{OTHER}{name}": np.zeros((0, *array.shape), array.dtype) for name, array in none.items()},
        "status": np.array(status),
        "certain": np.array(True),
        "runs": np.array(0),
        **dict.fromkeys(("escape_mean", "escape_low", "escape_high"), np.array(math.nan)),
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
            filled: tuple[int | slice, ...] = (k, *(slice(size) for size in part.shape))
            padded[filled] = part
        arrays[name] = padded
    return arrays
