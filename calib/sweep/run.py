"""A sweep, run: in pieces that are kept as they end, and joined to one dataset."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import numpy as np
import xarray as xr

from calib.errors import CalibError
from calib.pool import REFUSED, Failure, LocalPool
from calib.store.chunks import Chunks, join, joined
from calib.sweep.compute import Task, failed_row, motions, stacked
from calib.sweep.plan import Sweep, Track

CHUNK = 8  # points run, and lost by a kill, at a time
TIMEOUT = 600.0  # s, wall clock of that many points
UNITS = {"displacement": "m", "velocity": "m/s", "impact_speed": "m/s"} | dict.fromkeys(
    ("impact_phase", "contact", "exponent", "exponent_error", "zero_one", "impacts_per_period", "dropped"), "1"
)
NAMES = {
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
}
INSIDE = {"displacement": ("body", "cycle"), "velocity": ("body", "cycle"), "impact_phase": ("impact",),
          "impact_speed": ("impact",), "state": ("component",)}  # fmt: skip
TAKEN = {*NAMES, "status", "evidence", "branch", "point", "body", "cycle", "impact", "component", "component_unit"}


def run(
    sweep: Sweep,
    path: str | Path,
    jobs: int = 1,
    timeout: float = TIMEOUT,
    fresh: bool = False,
    on_done: Callable[[int, int], None] = lambda done, total: None,
) -> xr.Dataset:
    """Run a sweep, or go on with one that was stopped or killed.

    Parameters
    ----------
    path : netCDF file to write; until then, what is done lies beside it in a hidden folder. Where the file holds this
        very sweep, it is read
    jobs : child processes
    timeout : wall clock of 8 points, beyond which the slow one among them is given up  [s]
    fresh : take the place of what `path` holds, and forget what was done so far
    on_done : told how many points are done, and of how many

    Returns
    -------
    Dataset over the swept parameters P, with a leading dimension branch where there is more than one: section
    displacement [m] and velocity [m/s] (body, cycle, P); kind, period, impacts, impacts_per_period, exponent and
    exponent_error [1/period], zero_one, contact, dropped, status, evidence (P); impact_phase [1] and impact_speed
    [m/s] (impact, P), NaN where there are fewer impacts; state (component, P). Two parameters that are a list of
    points have the dimension point.

    Raises
    ------
    CalibError : `path` holds something else, or another process works for it; a value or an excitation that the
        simulator refuses
    """
    path, definition = Path(path), sweep.definition()
    total = len(sweep.points) * len(sweep.branches)
    found = joined(path, definition, fresh)
    if found is not None:
        on_done(total, total)
        return found

    def make(chunks: Chunks) -> xr.Dataset:
        with LocalPool(partial(motions, sweep), jobs, timeout) as pool:
            return _dataset(sweep, _pieces(sweep, pool, chunks, lambda done: on_done(done, total)))

    return join(path, definition, fresh, make)


# --- pieces ----------------------------------------------------------------------------------------------------------

Pieces = dict[str, dict[str, np.ndarray]]  # name of the piece -> arrays


def _pieces(sweep: Sweep, pool, chunks: Chunks, on_done: Callable[[int], None]) -> Pieces:
    """Run what has not been run; a track whose state is carried has one piece under way at a time."""
    tracks = list(sweep.tracks())
    found = chunks.kept(_name(t, c) for t, track in enumerate(tracks) for c in range(len(_parts(track))))
    on_done(_points(found))
    while tasks := _ready(sweep, tracks, found):
        for name, arrays in chunks.made(pool, tasks, partial(_singly, sweep, pool)):
            found[name] = arrays
            on_done(_points(found))
    return found


def _ready(sweep: Sweep, tracks: list[Track], found: Pieces) -> dict[str, Task]:
    """Pieces that are missing and whose start is known."""
    tasks = {}
    for t, track in enumerate(tracks):
        for c, points in enumerate(_parts(track)):
            if _name(t, c) not in found:
                tasks[_name(t, c)] = Task(points, _before(sweep, track, found, t, c), track.carried)
                if track.carried:
                    break
    return tasks


def _parts(track: Track) -> list[tuple[int, ...]]:
    return [track.points[first : first + CHUNK] for first in range(0, len(track.points), CHUNK)]


def _name(track: int, part: int) -> str:
    return f"{track}-{part}"


def _points(pieces: Pieces) -> int:
    return sum(len(piece["kind"]) for piece in pieces.values())


def _before(sweep: Sweep, track: Track, found: Pieces, t: int, c: int) -> dict[str, float]:
    """State that part c of track t starts from: the last one before it, where states are carried."""
    for earlier in range(c - 1, -1, -1) if track.carried else ():
        state = _last(found[_name(t, earlier)])
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


def _singly(sweep: Sweep, pool, task: Task) -> dict[str, np.ndarray]:
    """Run the points of a piece one by one, so that only the one that fails is lost.

    Raises
    ------
    CalibError : the simulator refuses what it is asked for
    """
    rows, state = [], task.state
    for point in task.points:
        [(_, result)] = pool.map([Task((point,), state, task.carried)])
        if isinstance(result, Failure):
            if result.status == REFUSED:
                raise CalibError(result.reason)
            result = stacked([failed_row(sweep, result.status, result.reason)])
        elif task.carried:
            state = _last(result) or state
        rows.append({name: array[0] for name, array in result.items()})
    return stacked(rows)


# --- joining ---------------------------------------------------------------------------------------------------------


def _dataset(sweep: Sweep, pieces: Pieces) -> xr.Dataset:
    rows: dict[tuple[int, int], dict[str, np.ndarray]] = {}
    for t, track in enumerate(sweep.tracks()):
        for c, points in enumerate(_parts(track)):
            for k, point in enumerate(points):
                rows[track.branch, point] = {name: array[k] for name, array in pieces[_name(t, c)].items()}
    branches, size = sweep.branches, len(sweep.points)
    arrays = stacked([rows[branch, point] for branch in range(len(branches)) for point in range(size)])
    arrays["state"], components, units = _by_component(arrays.pop("names"), arrays.pop("units"), arrays["state"])

    dims = ("point",) if sweep.paired else tuple(_dimension(name) for name in sweep.over)
    sizes = (size,) if sweep.paired else tuple(values.size for values in sweep.over.values())
    outer = ("branch",) if len(branches) > 1 else ()
    variables = {}
    for name, array in arrays.items():
        array = array.reshape(len(branches), *sizes[::-1], *array.shape[1:])  # the first parameter runs fastest
        places = range(1, 1 + len(sizes))
        array = np.moveaxis(array, places, [-k for k in places])
        attrs = {"long_name": NAMES[name]} if name in NAMES else {}
        attrs |= {"units": UNITS[name]} if name in UNITS else {}
        variables[name] = ((*outer, *INSIDE.get(name, ()), *dims), array if outer else array[0], attrs)
    coords = {"body": list(sweep.setting.model.bodies), "component": components, "component_unit": ("component", units)}
    if outer:
        coords["branch"] = branches
    for name, values in sweep.over.items():
        attrs = {"units": sweep.setting.unit(name), "long_name": sweep.setting.meaning(name), "name": name}
        coords[_dimension(name)] = (dims[0] if sweep.paired else _dimension(name), values, attrs)
    attrs = {"model": sweep.setting.model.name, "phase": sweep.setting.phase}
    return xr.Dataset(variables, coords=coords, attrs=attrs)


def _dimension(name: str) -> str:
    """Name of a parameter's dimension: without a dot, and not one that something else here has."""
    return name.replace(".", "_") + "_" * (name in TAKEN)


def _by_component(
    names: np.ndarray, units: np.ndarray, states: np.ndarray
) -> tuple[np.ndarray, list[str], list[str]]:
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
