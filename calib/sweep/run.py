"""A sweep run in pieces, and joined to one dataset."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import numpy as np
import xarray as xr

from calib.errors import CalibError
from calib.execution.pool import REFUSED, Failure, Pool
from calib.execution.pools.settings import PoolSettings
from calib.execution.workers import workers
from calib.store.chunks import Chunks, join, joined
from calib.sweep.compute import OTHER, SweepTask, failed_row, motions, stacked
from calib.sweep.continuation import ContinuationChain, Known, continued, nothing_continued
from calib.sweep.plan import Sweep, Track
from calib.sweep.verdict import Rows, arrivals, judged, known, regular_at_end

POINTS_PER_CHUNK = 8  # points run, and lost by a kill, at a time
SWEEP_CHUNK_SECONDS = 600.0  # s, wall clock of that many points
UNITS = {"displacement": "m", "velocity": "m/s", "impact_speed": "m/s"} | dict.fromkeys(
    (
        "impact_phase",
        "contact",
        "exponent",
        "exponent_error",
        "zero_one",
        "impacts_per_period",
        "dropped",
        "share",
        "escape_mean",
        "escape_low",
        "escape_high",
    ),
    "1",
)
LONG_NAMES = {
    "displacement": "section displacement",
    "velocity": "section velocity",
    "kind": "kind of motion",
    "period": "periods of the excitation after which the motion returns, 0 where it does not",
    "impacts": "impacts per return of a periodic motion, -1 where it does not return",
    "impacts_per_period": "impacts per period of the excitation",
    "exponent": "largest Lyapunov exponent per period of the excitation",
    "exponent_error": "standard error of the exponent",
    "zero_one": "K of the 0-1 test for chaos, NaN where it was not needed",
    "contact": "share of the time in permanent contact",
    "dropped": "periods dropped",
    "impact_phase": "phase of each impact, in periods from phase zero of the excitation",
    "impact_speed": "closing speed of each impact",
    "state": "last state, each component in component_unit",
    "share": "share of the runs from starts that differ imperceptibly which led to the motion",
    "sightings": "how often a regular motion was met independently at the value itself; from 3 on it is no chance",
    "runs": "runs from starts that differ imperceptibly, by 1e-6 of the scale of the state",
    "certain": "whether another rounding would have led to the same kind",
    "escape_mean": "mean time in which runs leave the irregular motion for a regular one, inf where none did",
    "escape_low": "lower bound of the mean escape time, 95 % confidence",
    "escape_high": "upper bound of the mean escape time, 95 % confidence",
}
INNER_DIMENSIONS = {"displacement": ("body", "cycle"), "velocity": ("body", "cycle"), "impact_phase": ("impact",),
          "impact_speed": ("impact",), "state": ("component",)}  # fmt: skip
IMPACT_ARRAYS = [f"{prefix}{name}" for prefix in ("", OTHER) for name in ("impact_phase", "impact_speed")]
DIMENSIONS = {"branch", "point", "body", "cycle", "impact", "component", "component_unit", "other"}
RESERVED_NAMES = {*LONG_NAMES, "status", "evidence", *DIMENSIONS}


def run(
    sweep: Sweep,
    path: str | Path,
    jobs: int = 1,
    timeout: float = SWEEP_CHUNK_SECONDS,
    fresh: bool = False,
    on_done: Callable[[int, int], None] = lambda done, total: None,
    pool: PoolSettings | None = None,
) -> xr.Dataset:
    """Run a sweep, or resume one that was stopped or killed.

    Parameters
    ----------
    path : netCDF file to write; until then, finished pieces lie beside it in a hidden folder. Where the file holds
        this very sweep, it is read
    jobs : child processes
    timeout : wall clock of 8 points, beyond which the slow one among them is given up  [s]
    fresh : replace the file at `path`, and delete the pieces finished so far
    on_done : called with the number of finished points and the total
    pool : where points are computed; None: in `jobs` child processes here

    Returns
    -------
    Dataset over the swept parameters P, with a leading dimension branch where there is more than one: section
    displacement [m] and velocity [m/s] (body, cycle, P); kind, period, impacts, impacts_per_period, exponent and
    exponent_error [1/period], zero_one, contact, dropped, status, evidence (P); impact_phase [1] and impact_speed
    [m/s] (impact, P), NaN where there are fewer impacts; state (component, P). Two parameters that are a list of
    points have the dimension point.

    The kind is that of the motion which the start leads to; where rounding decides what it leads to, that of the most
    regular motion that was met three times (see `calib.dynamics.motion.kind_of_orbit`), neighbouring values included.
    All others that were met have the same variables with the prefix other_ and the dimension other in front. share of
    the `runs` from starts that differ imperceptibly [1], certain (P), and escape_mean, escape_low, escape_high (P)
    [periods], the time in which runs leave an irregular motion. Where states are carried, the kind is that of the
    carried motion.

    Raises
    ------
    CalibError : `path` holds something else, or another process works on it; a value or an excitation that the
        simulator refuses
    """
    path, definition = Path(path), sweep.definition()
    total = len(sweep.points) * len(sweep.branches)
    stored = joined(path, definition, fresh)
    if stored is not None:
        on_done(total, total)
        return stored

    def make(chunks: Chunks) -> xr.Dataset:
        with workers(partial(_made, sweep), pool or PoolSettings(jobs=jobs), timeout) as opened:
            pieces = _pieces(sweep, opened, chunks, lambda done: on_done(done, total))
            rows = _rows(sweep, pieces)
            chains = list(sweep.chains())
            brought = _chained(sweep, opened, chunks, chains, known(sweep, rows))
        return _dataset(sweep, judged(sweep, rows, arrivals(chains, brought, POINTS_PER_CHUNK)))

    return join(path, definition, fresh, make)


# --- pieces ----------------------------------------------------------------------------------------------------------

Pieces = dict[str, dict[str, np.ndarray]]  # name of the piece -> arrays


def _made(sweep: Sweep, task: SweepTask | ContinuationChain) -> dict[str, np.ndarray]:
    return continued(sweep, task) if isinstance(task, ContinuationChain) else motions(sweep, task)


def _pieces(sweep: Sweep, pool: Pool, chunks: Chunks, on_done: Callable[[int], None]) -> Pieces:
    """Run the missing pieces; a track whose state is carried has one piece under way at a time."""
    tracks = list(sweep.tracks())
    pieces = chunks.finished(_name(t, c) for t, track in enumerate(tracks) for c in range(len(_parts(track.points))))
    on_done(_points(pieces))
    while tasks := _ready(sweep, tracks, pieces):
        for name, arrays in chunks.computed(pool, tasks, partial(_singly, sweep, pool)):
            pieces[name] = arrays
            on_done(_points(pieces))
    return pieces


def _ready(sweep: Sweep, tracks: list[Track], pieces: Pieces) -> dict[str, SweepTask]:
    """Pieces that are missing and whose start is known."""
    tasks = {}
    for t, track in enumerate(tracks):
        for c, points in enumerate(_parts(track.points)):
            if _name(t, c) not in pieces:
                tasks[_name(t, c)] = SweepTask(points, _before(sweep, track, pieces, t, c), track.carried)
                if track.carried:
                    break
    return tasks


def _chained(
    sweep: Sweep, pool: Pool, chunks: Chunks, chains: list[tuple[int, ...]], at: Mapping[int, Known]
) -> list[list[dict[str, np.ndarray]]]:
    """Pieces of each chain, in which regular motions are continued; one piece of a chain at a time."""
    parts = [_parts(chain) for chain in chains]
    done: list[list[dict[str, np.ndarray]]] = [[] for _ in chains]
    while any(len(ended) < len(part) for ended, part in zip(done, parts, strict=True)):
        tasks = {}
        for k, (part, ended) in enumerate(zip(parts, done, strict=True)):
            if len(ended) < len(part):
                brought = regular_at_end(at, parts[k][len(ended) - 1], ended[-1]) if ended else ()
                points = part[len(ended)]
                tasks[f"chain-{k}-{len(ended)}"] = ContinuationChain(
                    points, tuple(at[point] for point in points), brought
                )
        pieces = chunks.finished(tasks)
        missing = {key: task for key, task in tasks.items() if key not in pieces}
        pieces |= dict(chunks.computed(pool, missing, partial(nothing_continued, sweep)))
        for key, arrays in pieces.items():
            done[int(key.split("-")[1])].append(arrays)
    return done


def _parts(points: tuple[int, ...]) -> list[tuple[int, ...]]:
    return [points[first : first + POINTS_PER_CHUNK] for first in range(0, len(points), POINTS_PER_CHUNK)]


def _name(track: int, part: int) -> str:
    return f"{track}-{part}"


def _points(pieces: Pieces) -> int:
    return sum(len(piece["kind"]) for piece in pieces.values())


def _before(sweep: Sweep, track: Track, pieces: Pieces, t: int, c: int) -> dict[str, float]:
    """State that part c of track t starts from: the last one before it, where states are carried."""
    for earlier in range(c - 1, -1, -1) if track.carried else ():
        state = _last(pieces[_name(t, earlier)])
        if state:
            return state
    return dict(sweep.starts[track.start])


def _last(arrays: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Last state of a piece by component, empty where all its points failed."""
    for names, state in zip(arrays["names"][::-1], arrays["state"][::-1], strict=True):
        named = {str(name): float(value) for name, value in zip(names, state, strict=True) if name}
        if named:
            return named
    return {}


def _singly(sweep: Sweep, pool: Pool, task: SweepTask) -> dict[str, np.ndarray]:
    """Run the points of a piece one by one, so that only the one that fails is lost.

    Raises
    ------
    CalibError : the simulator refuses what it is asked for
    """
    rows, state = [], task.state
    for point in task.points:
        [(_, result)] = pool.map([SweepTask((point,), state, task.carried)])
        if isinstance(result, Failure):
            if result.status == REFUSED:
                raise CalibError(result.reason)
            result = stacked([failed_row(sweep, result.status, result.reason)])
        elif task.carried:
            state = _last(result) or state
        rows.append({name: array[0] for name, array in result.items()})
    return stacked(rows)


# --- joining ---------------------------------------------------------------------------------------------------------


def _rows(sweep: Sweep, pieces: Pieces) -> Rows:
    """Arrays of each point of each branch."""
    rows: Rows = {}
    for t, track in enumerate(sweep.tracks()):
        for c, points in enumerate(_parts(track.points)):
            for k, point in enumerate(points):
                rows[track.branch, point] = {name: array[k] for name, array in pieces[_name(t, c)].items()}
    return rows


def _dataset(sweep: Sweep, rows: Rows) -> xr.Dataset:
    branches, size = sweep.branches, len(sweep.points)
    arrays = stacked([rows[branch, point] for branch in range(len(branches)) for point in range(size)])
    names, units = arrays.pop("names"), arrays.pop("units")
    others = np.moveaxis(arrays[f"{OTHER}state"], 1, 0)
    arrays["state"], components, component_units = _by_component(names, units, arrays["state"])
    sorted_others = [_by_component(names, units, states)[0] for states in others]
    none = np.zeros((len(names), 0, len(components)))
    arrays[f"{OTHER}state"] = np.stack(sorted_others, 1) if sorted_others else none
    longest = max(arrays[name].shape[-1] for name in IMPACT_ARRAYS)
    for name in IMPACT_ARRAYS:
        array = arrays[name]
        missing = [(0, 0)] * (array.ndim - 1) + [(0, longest - array.shape[-1])]
        arrays[name] = np.pad(array, missing, constant_values=np.nan)

    dims = ("point",) if sweep.paired else tuple(_dimension(name) for name in sweep.over)
    sizes = (size,) if sweep.paired else tuple(values.size for values in sweep.over.values())
    outer = ("branch",) if len(branches) > 1 else ()
    variables: dict[str, xr.Variable] = {}
    for name, array in arrays.items():
        array = array.reshape(len(branches), *sizes[::-1], *array.shape[1:])  # the first parameter runs fastest
        axes = range(1, 1 + len(sizes))
        array = np.moveaxis(array, axes, [-k for k in axes])
        own = name.removeprefix(OTHER)
        beside = ", of a motion beside" if own != name else ""
        attrs = {"long_name": f"{LONG_NAMES[own]}{beside}"} if own in LONG_NAMES else {}
        attrs |= {"units": UNITS[own]} if own in UNITS else {}
        inside = (*(("other",) if own != name else ()), *INNER_DIMENSIONS.get(own, ()))
        variables[name] = xr.Variable((*outer, *inside, *dims), array if outer else array[0], attrs)
    coords: dict[str, xr.Variable] = {
        "body": xr.Variable("body", list(sweep.setting.model.bodies)),
        "component": xr.Variable("component", components),
        "component_unit": xr.Variable("component", component_units),
    }
    if outer:
        coords["branch"] = xr.Variable("branch", branches)
    for name, values in sweep.over.items():
        attrs = {"units": sweep.setting.unit(name), "long_name": sweep.setting.meaning(name), "name": name}
        coords[_dimension(name)] = xr.Variable(dims[0] if sweep.paired else _dimension(name), values, attrs)
    return xr.Dataset(variables, coords=coords, attrs={"model": sweep.setting.model.name, "phase": sweep.setting.phase})


def _dimension(name: str) -> str:
    """Name of a parameter's dimension: without a dot, and none of the reserved names."""
    return name.replace(".", "_") + "_" * (name in RESERVED_NAMES)


def _by_component(names: np.ndarray, units: np.ndarray, states: np.ndarray) -> tuple[np.ndarray, list[str], list[str]]:
    """Sort states (point, k) by the names of their components (point, k); laws at their null have none of theirs."""
    known: dict[str, str] = {}
    for own, unit in zip(names, units, strict=True):
        known |= {str(name): str(u) for name, u in zip(own, unit, strict=True) if name}
    sorted_states = np.full((len(states), len(known)), np.nan)
    for row, own, state in zip(sorted_states, names, states, strict=True):
        for name, value in zip(own, state, strict=True):
            if name:
                row[list(known).index(str(name))] = value
    return sorted_states, list(known), list(known.values())
