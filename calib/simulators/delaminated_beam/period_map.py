"""The map of a period of the beam's motion, in either fidelity."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from calib.modelling.orbit import Orbit, Tangent
from calib.records import OK
from calib.records.excitation import Harmonic
from calib.simulators.delaminated_beam.modes import Modes
from calib.simulators.delaminated_beam.stationary import Engine
from calib.simulators.delaminated_beam.structure import BODIES, MeshedStructure

MAX_NEAR_MISSES = 256  # minima of the clearance in a period
MAX_TIME_STEPS_PER_PERIOD = 2_000_000  # a period
MIN_LENGTH = 1e-12  # m or m kg^(1/2), scale of a coordinate that the drive does not move
MIN_OPENING_RATIO = 1e-3  # of a mode's largest opening over that of all modes, below which it sets no scale  [1]


class MappedEngine(Engine, Protocol):
    """A kernel with its state, as a period map needs it."""

    def map_state(self) -> np.ndarray:
        """State (2 n,) as a map has it, at the end of the last period."""
        ...

    def middle(self) -> np.ndarray:
        """Displacements [m] and velocities [m/s] (4,) of beam and layer in the middle, at the end of the period."""
        ...

    def near_misses(self, minima: np.ndarray) -> int:
        """Write the local minima of the clearance over one period [m]; return how many there are."""
        ...


EngineAt = Callable[[np.ndarray, int], MappedEngine]


@dataclass(frozen=True, eq=False)
class BeamMap:
    """Period map of the beam; see `calib.modelling.orbit.PeriodMap`.

    The state is that of the fidelity: modal coordinates and rates, or displacements and velocities of the free nodes,
    in full fidelity 1700 numbers: diagrams and sections work with it, branches and exponents take their time.

    Attributes
    ----------
    engine : (state, budget) -> a kernel at that state
    period : of the excitation  [s]
    names, units, scale, initial : of the state
    """

    engine: EngineAt
    period: float
    names: tuple[str, ...]
    units: tuple[str, ...]
    scale: np.ndarray
    initial: np.ndarray
    bodies: tuple[str, ...] = BODIES
    impacting: bool = True

    @classmethod
    def of_reduced(cls, engine: EngineAt, basis: Modes, drive: Harmonic, length: float) -> "BeamMap":
        """Map of the reduced kernel; the state is modal coordinates and their rates."""
        n = len(basis.omega)
        largest = np.abs(basis.across[:, :n]).max(axis=0)
        return cls._of(
            engine,
            [f"mode {k + 1}" for k in range(n)],
            ("m kg^0.5", "m kg^0.5/s"),
            abs(length) / np.where(largest > MIN_OPENING_RATIO * largest.max(), largest, largest.max()),
            drive,
        )

    @classmethod
    def of_full(cls, engine: EngineAt, structure: MeshedStructure, drive: Harmonic, length: float) -> "BeamMap":
        """Map of the full kernel; the state is displacements of the free nodes and their velocities."""
        names = [f"node {k // 2} {'xy'[k % 2]}" for k in structure.free]
        return cls._of(engine, names, ("m", "m/s"), np.full(len(names), abs(length)), drive)

    @classmethod
    def _of(
        cls,
        engine: EngineAt,
        names: Sequence[str],
        units: tuple[str, str],
        length: np.ndarray,
        drive: Harmonic,
    ) -> "BeamMap":
        n, omega = len(names), 2.0 * np.pi * drive.frequency
        length = np.maximum(length, MIN_LENGTH)
        return cls(
            engine=engine,
            period=drive.period,
            names=(*(f"{name}.displacement" for name in names), *(f"{name}.velocity" for name in names)),
            units=(units[0],) * n + (units[1],) * n,
            scale=np.concatenate([length, omega * length]),
            initial=np.zeros(2 * n),
        )

    def orbit(self, state: np.ndarray, periods: int) -> Orbit:
        """Go on from `state` by whole periods."""
        engine = self.engine(np.asarray(state, dtype=float), MAX_TIME_STEPS_PER_PERIOD * periods)
        states, rows, status, reason = [], [], OK, ""
        for _ in range(periods):
            period = engine.period(1)
            if period.status != OK:
                status, reason = period.status, period.reason
                break
            states.append(engine.map_state())
            rows.append(engine.middle())
        done = len(states)
        middle = np.array(rows).reshape(done, 4)
        passed = engine.contact_recorded(max(1, done)).impacts
        cycles = passed[:, 0] / self.period
        impacts = np.stack([np.floor(cycles), cycles - np.floor(cycles), passed[:, 1]], axis=1)
        return Orbit(
            states=np.array(states).reshape(done, len(self.names)),
            displacement=middle[:, :2].T,
            velocity=middle[:, 2:].T,
            impacts=impacts[impacts[:, 0] < done],
            status=status,
            reason=reason,
        )

    def motion(self, state: np.ndarray, periods: int, samples: int) -> np.ndarray:
        """Sample the motion; see `calib.modelling.orbit.SampledMap`."""
        engine = self.engine(np.asarray(state, dtype=float), MAX_TIME_STEPS_PER_PERIOD * periods)
        rows = [np.zeros((0, 4))]
        for _ in range(periods):
            period = engine.period(samples)
            if period.status != OK:
                break
            rows.append(period.samples)
        return np.concatenate(rows)[:, :2].T

    def tangent(self, state: np.ndarray, vectors: np.ndarray, periods: int) -> Tangent | None:
        """None: contact that begins and ends within steps has no derivative at hand."""
        return None

    def near_misses(self, state: np.ndarray) -> np.ndarray:
        """Local minima of the clearance over one period [m]."""
        engine = self.engine(np.asarray(state, dtype=float), MAX_TIME_STEPS_PER_PERIOD)
        minima = np.zeros(MAX_NEAR_MISSES)
        count = engine.near_misses(minima)
        return minima[:count]
