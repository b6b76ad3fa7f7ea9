"""The map of a period: the state at one phase of the drive to the state one period on."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.errors import CalibError
from calib.modelling.laws import BoundLaw, at_site
from calib.modelling.modal_system import ModalSystem
from calib.modelling.orbit import Orbit, Tangent
from calib.records import OK
from calib.records.excitation import Excitation
from calib.simulators.impact import kernel
from calib.simulators.impact.impact_record import advance_with_impacts
from calib.simulators.impact.initial_state import memory, remembers_speed, start, with_memory
from calib.simulators.impact.modal_system import modal_system
from calib.simulators.impact.near_misses import nearest_passes
from calib.simulators.impact.problem import AT_PERIOD, FORCE_LAWS, PORT, ImpactState, Problem
from calib.simulators.impact.run import STATUS
from calib.simulators.impact.scratch import scratch
from calib.simulators.impact.tangent import carry

MAX_STEPS_PER_PERIOD = 20_000  # on average over the periods of a run
BATCH_PERIODS = 64  # that the kernel runs in one call
IMPACTS_PER_PERIOD = 256  # for which there is room, on average over a batch; where there are more, it is run again
MAX_MINIMA = 64  # of the clearance in a period

Channels = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True, eq=False)
class ImpactMap:
    """Period map of a structure with a stop; see `calib.modelling.orbit.PeriodMap`.

    The state holds the free coordinates [m], their velocities [m/s], the internal states of the force laws and, where
    the loss of a compliant contact depends on it, the closing speed at which the present contact began [m/s], zero out
    of contact. A state beyond a rigid stop is put back onto it.

    Attributes
    ----------
    problem : Problem of a harmonic drive, its phase zero at the section, its events located
    bodies : of the simulator; `free`, indices of those whose displacement is a coordinate
    names, units : of the state's components
    scale, initial : (dimension,)
    law_states : (law, coordinate or port, index) of each internal state of the force laws
    channels : rows (k, 2 n + 2) of the kernel at times (k,) since phase zero [s] -> displacement, velocity (body, k)
    """

    problem: Problem
    bodies: tuple[str, ...]
    free: tuple[int, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    scale: np.ndarray
    initial: np.ndarray
    law_states: tuple[tuple[int, int, int], ...]
    channels: Channels

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
        by_speed = remembers_speed(self.problem)
        rows, inner = np.zeros((periods, 2 * n + 2)), np.zeros((periods, len(self.law_states) + by_speed))
        batch = 1 if inner.shape[1] else BATCH_PERIODS  # the kernel's rows do not hold what is beside the motion
        capacity = IMPACTS_PER_PERIOD * min(batch, periods)
        impacts = [np.zeros((0, 2 + 2 * n))]
        w, none, code = scratch(self.problem), np.zeros((0, 2 * n + 2)), kernel.DONE
        budget = MAX_STEPS_PER_PERIOD * periods
        for first in range(0, periods, batch):
            part = rows[first : first + batch]
            code, passed = advance_with_impacts(
                self.problem, now, w, len(part), budget, part, np.zeros(0), none, capacity
            )
            impacts.append(passed)
            if inner.shape[1]:
                closing = [memory(self.problem, now)[-1]] if by_speed else []
                inner[first] = [*(now.z[place] for place in self.law_states), *closing]
            if code != kernel.DONE:
                break
        done = int(now.counters[AT_PERIOD])
        displacement, velocity = self.channels(rows[:done], np.zeros(done))
        return Orbit(
            np.hstack([rows[:done, : 2 * n], inner[:done]]),
            displacement,
            velocity,
            self._impacts(np.concatenate(impacts)),
            float(now.clock[1] / (max(1, done) * self.period)),
            STATUS.get(code, OK),
            f"after {done} period(s)" if code in STATUS else "",
        )

    def motion(self, state: np.ndarray, periods: int, samples: int) -> np.ndarray:
        """Sample the motion; see `calib.modelling.orbit.SampledMap`."""
        n = len(self.problem.hit)
        times = np.arange(periods * samples) * (self.period / samples)
        rows, sections = np.zeros((times.size, 2 * n + 2)), np.zeros((periods, 2 * n + 2))
        now, budget = self._started(state), MAX_STEPS_PER_PERIOD * periods
        no_impacts = np.zeros((0, 2 + 2 * n))
        kernel.advance(
            self.problem, now, scratch(self.problem), periods, 0.0, budget, sections, times, rows, no_impacts
        )
        done = samples * int(now.counters[AT_PERIOD])
        return self.channels(rows[:done], times[:done])[0]

    def tangent(self, state: np.ndarray, vectors: np.ndarray, periods: int) -> Tangent | None:
        """Carry small differences along; None where force laws act, whose derivative is not known."""
        if self.problem.counts[FORCE_LAWS] > 0:
            return None
        n, m = len(self.problem.hit), vectors.shape[1]
        rows, growth = np.zeros((periods, 2 * n + 3)), np.zeros((periods, m, m))
        vectors = np.array(vectors, dtype=float, order="C")
        begin, budget = self._started(state), MAX_STEPS_PER_PERIOD * periods
        _, done = carry(self.problem, begin, scratch(self.problem), periods, budget, self.scale, rows, vectors, growth)
        kept = [*range(2 * n), *([2 * n + 2] if remembers_speed(self.problem) else [])]
        return Tangent(rows[:done, kept], vectors, growth[:done])

    def modal_system(self) -> ModalSystem:
        """Return the system whose motion is mapped; see `calib.modelling.modal_system.ModalMap`."""
        return modal_system(self.problem, len(self.bodies), self.free, self.law_states)

    def near_misses(self, state: np.ndarray) -> np.ndarray:
        """Local minima of the clearance over one period [m]."""
        n = len(self.problem.hit)
        minima = np.zeros(MAX_MINIMA)
        if not self.problem.stop:
            return minima[:0]
        no_impacts = np.zeros((0, 2 + 2 * n))
        count = nearest_passes(
            self.problem, self._started(state), scratch(self.problem), MAX_STEPS_PER_PERIOD, no_impacts, minima
        )
        return minima[: max(0, count)]

    def _started(self, state: np.ndarray) -> ImpactState:
        n = len(self.problem.hit)
        state = np.asarray(state, dtype=float)
        now = start(self.problem, state[:n], state[n : 2 * n])
        inner = state[2 * n :]
        if remembers_speed(self.problem):
            with_memory(self.problem, now, inner[-1:])
            inner = inner[:-1]
        for place, value in zip(self.law_states, inner, strict=True):
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
    channels: Channels,
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
    law_states = tuple(
        (i, j, k)
        for i, law in enumerate(at_site(laws, "force"))
        for j in range(n + 1)
        for k in range(law.states if problem.acts[i, j] else 0)
    )
    names = [f"{bodies[i]}.{channel}" for channel in ("displacement", "velocity") for i in free]
    places = [*(bodies[i] for i in free), PORT]
    names += [f"{places[j]}.law {i + 1} state {k + 1}" for i, j, k in law_states]
    units = ("m",) * n + ("m/s",) * n + ("1",) * len(law_states)
    scale = [np.full(n, length), np.full(n, length * problem.omega), np.ones(len(law_states))]
    if remembers_speed(problem):
        names.append(f"{PORT}.closing speed")
        units = (*units, "m/s")
        scale.append(np.full(1, length * problem.omega))
    at_start = np.zeros(2 * n) if initial is None else np.asarray(initial, dtype=float)
    return ImpactMap(
        problem=problem,
        bodies=tuple(bodies),
        free=tuple(free),
        names=tuple(names),
        units=units,
        scale=np.concatenate(scale),
        initial=np.concatenate([at_start, np.zeros(len(names) - 2 * n)]),
        law_states=law_states,
        channels=channels,
    )
