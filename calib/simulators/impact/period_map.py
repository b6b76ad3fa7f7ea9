"""The map of a period: the state at one phase of the drive to the state one period on."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.errors import CalibError
from calib.modelling.laws import BoundLaw, at_site
from calib.modelling.orbit import Orbit, Tangent
from calib.records import OK
from calib.records.excitation import Excitation
from calib.simulators.impact import kernel
from calib.simulators.impact.initial_state import start
from calib.simulators.impact.near_misses import nearest_passes
from calib.simulators.impact.problem import AT_PERIOD, IMPACTS, PORT, ImpactState, Problem
from calib.simulators.impact.run import STATUS
from calib.simulators.impact.scratch import scratch
from calib.simulators.impact.tangent import carry

BUDGET = 20_000  # steps a period
PIECE = 64  # periods at a time
CAPACITY = 256  # impacts a period that are kept, on average over a piece
MISSES = 64  # minima of the clearance in a period


@dataclass(frozen=True, eq=False)
class ImpactMap:
    """Period map of a structure with a stop; see `calib.modelling.orbit.PeriodMap`.

    The state holds the free coordinates [m], their velocities [m/s], and the internal states of the force laws. A state
    beyond the stop is put back onto it. Of the impacts in 64 periods, the first 16384 are told: 256 a period, and where
    laws have internal states 256 of each period.

    Attributes
    ----------
    problem : Problem of a harmonic drive, its phase zero at the section, its events located
    bodies : of the simulator
    names, units : of the state's components
    scale, initial : (dimension,)
    inner : (slot, coordinate or port, index) of each internal state of the force laws
    channels : rows (k, 2 n + 2) of the kernel at phase zero -> displacement, velocity (body, k)
    """

    problem: Problem
    bodies: tuple[str, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    scale: np.ndarray
    initial: np.ndarray
    inner: tuple[tuple[int, int, int], ...]
    channels: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]

    @property
    def period(self) -> float:
        """Period of the drive [s]."""
        return self.problem.period

    @property
    def impacting(self) -> bool:
        """Whether there is a stop."""
        return self.problem.stop

    def orbit(self, state: np.ndarray, periods: int) -> Orbit:
        """Go on from `state` by whole periods."""
        n = len(self.problem.hit)
        now = self._started(state)
        rows, inner = np.zeros((periods, 2 * n + 2)), np.zeros((periods, len(self.inner)))
        at_once = 1 if self.inner else PIECE  # the kernel's rows do not hold internal states
        noted = np.empty((CAPACITY * min(at_once, periods), 2 + 2 * n))
        impacts = [np.zeros((0, 2 + 2 * n))]
        w, none, code = scratch(n), np.zeros((0, 2 * n + 2)), kernel.DONE
        for first in range(0, periods, at_once):
            part = rows[first : first + at_once]
            code = kernel.advance(
                self.problem, now, w, len(part), 0.0, BUDGET * periods, part, np.zeros(0), none, noted
            )
            inner[first] = [now.z[place] for place in self.inner]
            impacts.append(noted[: int(now.counters[IMPACTS])].copy())
            now.counters[IMPACTS] = 0
            if code != kernel.DONE:
                break
        done = int(now.counters[AT_PERIOD])
        displacement, velocity = self.channels(rows[:done])
        return Orbit(
            np.hstack([rows[:done, : 2 * n], inner[:done]]),
            displacement,
            velocity,
            self._impacts(np.concatenate(impacts)),
            float(now.clock[1] / (max(1, done) * self.period)),
            STATUS.get(code, OK),
            f"after {done} period(s)" if code in STATUS else "",
        )

    def tangent(self, state: np.ndarray, vectors: np.ndarray, periods: int) -> Tangent | None:
        """Carry small differences along; None where force laws act, whose derivative is not known."""
        if self.problem.counts[0] > 0:
            return None
        n, m = len(self.problem.hit), vectors.shape[1]
        rows, growth = np.zeros((periods, 2 * n + 2)), np.zeros((periods, m, m))
        vectors = np.array(vectors, dtype=float, order="C")
        _, done = carry(
            self.problem, self._started(state), scratch(n), periods, BUDGET * periods, self.scale, rows, vectors, growth
        )
        return Tangent(rows[:done, : 2 * n], vectors, growth[:done])

    def misses(self, state: np.ndarray) -> np.ndarray:
        """Local minima of the clearance over one period [m]."""
        n = len(self.problem.hit)
        minima = np.zeros(MISSES)
        if not self.problem.stop:
            return minima[:0]
        count = nearest_passes(self.problem, self._started(state), scratch(n), BUDGET, np.zeros((0, 2 + 2 * n)), minima)
        return minima[: max(0, count)]

    def _started(self, state: np.ndarray) -> ImpactState:
        n = len(self.problem.hit)
        state = np.asarray(state, dtype=float)
        now = start(self.problem, state[:n], state[n : 2 * n])
        for place, value in zip(self.inner, state[2 * n :], strict=True):
            now.z[place] = value
        return now

    def _impacts(self, rows: np.ndarray) -> np.ndarray:
        """Period, phase and closing speed (k, 3) of the kernel's rows of impacts."""
        passed = rows[:, 0] / self.period
        return np.stack([np.floor(passed), passed - np.floor(passed), rows[:, 1]], axis=1)


def shifted(excitation: Excitation, phase: float) -> Excitation:
    """Return a harmonic excitation whose phase zero is at `phase` [1, in periods] of the given one.

    Raises
    ------
    CalibError : it is no harmonic
    """
    if not excitation.harmonic:
        raise CalibError(
            f"a period map needs a harmonic excitation, got {excitation.quantity}"
            f"{' by samples' if excitation.recorded else ''}; choose a record that was driven by one"
        )
    return replace(excitation, phase=excitation.phase + 2.0 * math.pi * phase)


def impact_map(
    problem: Problem,
    bodies: Sequence[str],
    free: Sequence[int],
    laws: Sequence[BoundLaw],
    length: float,
    channels: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    initial: np.ndarray | None = None,
) -> ImpactMap:
    """Make the period map of a problem.

    Parameters
    ----------
    bodies : of the simulator; `free`, indices of those whose displacement is a coordinate
    laws : that the problem was put together with
    length : scale of the motion  [m]
    channels : see `ImpactMap`
    initial : (2 n,) state to start from [m], [m/s]; None is rest
    """
    n = len(free)
    inner = tuple(
        (slot, j, k)
        for slot, law in enumerate(at_site(laws, "force"))
        for j in range(n + 1)
        for k in range(law.states if problem.acts[slot, j] else 0)
    )
    names = [f"{bodies[i]}.{channel}" for channel in ("displacement", "velocity") for i in free]
    places = [*(bodies[i] for i in free), PORT]
    names += [f"{places[j]}.law {slot + 1} state {k + 1}" for slot, j, k in inner]
    still = np.zeros(2 * n) if initial is None else np.asarray(initial, dtype=float)
    return ImpactMap(
        problem=problem,
        bodies=tuple(bodies),
        names=tuple(names),
        units=("m",) * n + ("m/s",) * n + ("1",) * len(inner),
        scale=np.concatenate([np.full(n, length), np.full(n, length * problem.omega), np.ones(len(inner))]),
        initial=np.concatenate([still, np.zeros(len(inner))]),
        inner=inner,
        channels=channels,
    )
