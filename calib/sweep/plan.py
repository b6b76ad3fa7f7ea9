"""The plan of a sweep: values of one or two parameters, starts, order."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
import scipy

from calib.dynamics.setting import Setting
from calib.dynamics.single_run import MIN_SECTION_CYCLES
from calib.errors import CalibError, nearest
from calib.modelling.orbit import PeriodMap
from calib.modelling.parameter import Window
from calib.store.environment import environment
from calib.store.plain import plain

Carry = Literal["none", "forward", "backward", "both"]
CARRY: tuple[Carry, ...] = get_args(Carry)
NONE, FORWARD, BACKWARD, BOTH = CARRY


class Track(NamedTuple):
    """Points run one after the other, each from the last state of the one before where `carried`."""

    branch: int
    points: tuple[int, ...]
    start: int
    carried: bool


@dataclass(frozen=True, eq=False)
class Sweep:
    """One or two parameters over their values, everything else held.

    Attributes
    ----------
    setting : model, excitation, all other values, phase of the section
    over : one or two names -> values (n,) in SI; see `calib.dynamics.setting.Setting` for what can vary
    paired : whether two parameters are a list of points (n values each) rather than a grid
    carry : "none": every value from the start states; else each value from the last state of the one before it, in
        rising order of the first parameter ("forward"), falling ("backward"), or once each way ("both")
    starts : states to start from, name of the state's component -> value in SI; what is not named is the simulator's
    settle : periods dropped at most before the first verdict; an undecided motion gets 5 times as many more
    cycles : periods of the section that is kept
    runs : from starts that differ imperceptibly, where that of the first is irregular beside a stable cycle
    """

    setting: Setting
    over: Mapping[str, np.ndarray]
    paired: bool = False
    carry: Carry = NONE
    starts: Sequence[Mapping[str, float]] = ({},)
    settle: int = 1000
    cycles: int = 100
    runs: int = 3

    def __post_init__(self) -> None:
        arrays = {name: np.atleast_1d(np.asarray(values, dtype=float)) for name, values in self.over.items()}
        object.__setattr__(self, "over", arrays)
        object.__setattr__(self, "starts", tuple(self.starts))
        _check(self)

    @property
    def points(self) -> np.ndarray:
        """Values (point, parameter) of the swept parameters; on a grid the first parameter runs fastest."""
        if self.paired:
            return np.stack(list(self.over.values()), axis=1)
        grid = np.meshgrid(*self.over.values(), indexing="ij")
        return np.stack([axis.ravel(order="F") for axis in grid], axis=1)

    @property
    def _ways(self) -> list[tuple[int, Carry]]:
        """Start and direction of each branch."""
        ways = [FORWARD, BACKWARD] if self.carry == BOTH else [self.carry]
        return [(start, way) for start in range(len(self.starts)) for way in ways]

    @property
    def branches(self) -> list[str]:
        """Name of each branch."""
        several = len(self.starts) > 1
        return [
            ", ".join(filter(None, ("" if way == NONE else way, f"start {start + 1}" if several else "")))
            for start, way in self._ways
        ]

    def tracks(self) -> Iterator[Track]:
        """Runs of points: all of a branch where nothing is carried, else one for each value of the second parameter."""
        count = len(self.points)
        first = next(iter(self.over.values()))
        rising = np.argsort(first, kind="stable")
        for branch, (start, way) in enumerate(self._ways):
            if way == NONE:
                yield Track(branch, tuple(range(count)), start, False)
                continue
            order = rising if way == FORWARD else rising[::-1]
            for row in range(0, count, first.size):
                yield Track(branch, tuple((row + order).tolist()), start, True)

    def chains(self) -> Iterator[tuple[int, ...]]:
        """Neighbouring points in the order in which regular motions are continued: both ways along each axis.

        None where states are carried, which is a continuation itself, or where the points are a list.
        """
        if self.paired or self.carry != NONE:
            return
        sizes = [values.size for values in self.over.values()]
        grid = np.arange(len(self.points)).reshape(sizes[::-1])  # the first parameter runs fastest
        for axis, values in enumerate(self.over.values()):
            order = np.argsort(values, kind="stable")
            for row in np.moveaxis(grid, grid.ndim - 1 - axis, -1).reshape(-1, values.size):
                if values.size > 1:
                    yield tuple(row[order].tolist())
                    yield tuple(row[order[::-1]].tolist())

    def map_at(self, point: int) -> PeriodMap:
        """Period map of one point.

        Raises
        ------
        ValueError : its values give nothing that could move
        """
        return self.setting.map(dict(zip(self.over, self.points[point].tolist(), strict=True)))

    def components(self, points: Sequence[int] = (0, -1)) -> dict[str, str]:
        """Unit of each component of the state by name; laws that are at their null at all of `points` have none."""
        units: dict[str, str] = {}
        for point in points:
            try:
                map = self.map_at(point)
            except ValueError:
                continue  # the point itself will say so
            units |= dict(zip(map.names, map.units, strict=True))
        return units

    def definition(self) -> dict[str, Any]:
        """All that determines the result, bit for bit, as JSON takes it."""
        own = {name: getattr(self, name) for name in ("over", "paired", "carry", "starts", "settle", "cycles", "runs")}
        return plain({"sweep": own, **self.setting.definition(), "environment": environment()})


def latin_hypercube(windows: Mapping[str, Window], count: int, seed: int) -> dict[str, np.ndarray]:
    """Draw `count` points of which every parameter has one in each of `count` equal stretches of its window (SI)."""
    drawn = scipy.stats.qmc.LatinHypercube(len(windows), rng=np.random.default_rng(seed)).random(count)
    return {
        name: np.array([window.value(u) for u in column.tolist()])
        for (name, window), column in zip(windows.items(), drawn.T, strict=True)
    }


def _check(sweep: Sweep) -> None:
    if not 1 <= len(sweep.over) <= 2:
        raise CalibError(f"a sweep is over one or two parameters, got {len(sweep.over)}: {', '.join(sweep.over)}")
    for name, values in sweep.over.items():
        if values.ndim != 1 or values.size == 0:
            raise CalibError(f"the values of {name!r} must be a list of numbers, got an array of shape {values.shape}")
        sweep.setting.check(name, values.tolist())
        if not sweep.paired and np.unique(values).size < values.size:
            raise CalibError(f"the values of {name!r} on a grid must differ, got {values.tolist()}")
    sizes = {name: values.size for name, values in sweep.over.items()}
    if sweep.paired and len(set(sizes.values())) > 1:
        raise CalibError(f"a list of points needs as many values of each parameter, got {sizes}")
    if sweep.carry not in CARRY:
        raise CalibError(f"carry is one of {', '.join(CARRY)}, got {sweep.carry!r}{nearest(sweep.carry, CARRY)}")
    if sweep.paired and sweep.carry != NONE:
        raise CalibError("a state is carried along a grid; a list of points has no order")
    if sweep.settle < 0:
        raise CalibError(f"expected settle >= 0 periods, got {sweep.settle}")
    if sweep.cycles < MIN_SECTION_CYCLES:
        raise CalibError(f"expected at least {MIN_SECTION_CYCLES} cycles to keep, got {sweep.cycles}")
    if sweep.runs < 1:
        raise CalibError(f"expected at least 1 run per value, got {sweep.runs}")
    if not sweep.starts:
        raise CalibError("a sweep needs a state to start from; {} is the simulator's own")
    named = {name for start in sweep.starts for name in start}
    known = sweep.components() if named else sweep.components([0])  # refused here and now, if at all
    for name in sorted(named):
        if known and name not in known:
            raise CalibError(f"the state has no component {name!r}{nearest(name, known)}; it has {', '.join(known)}")
