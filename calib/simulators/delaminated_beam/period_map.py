"""The map of a period of the beam's motion, in either fidelity."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calib.modelling.orbit import Orbit, Tangent
from calib.records import OK
from calib.simulators.delaminated_beam.drive import CentreDisplacement
from calib.simulators.delaminated_beam.layout import BODIES, MeshedStructure
from calib.simulators.delaminated_beam.modes import Modes

MISSES = 256  # minima of the clearance in a period
BUDGET = 2_000_000  # steps a period


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

    engine: Callable
    period: float
    names: tuple[str, ...]
    units: tuple[str, ...]
    scale: np.ndarray
    initial: np.ndarray
    bodies: tuple[str, ...] = BODIES
    impacting: bool = True

    @classmethod
    def of_reduced(cls, engine, basis: Modes, drive: CentreDisplacement, length: float) -> "BeamMap":
        """Map of the reduced kernel; the state is modal coordinates and their rates."""
        n = len(basis.omega)
        largest = np.abs(basis.across[:, :n]).max(axis=0)
        return cls._of(
            engine,
            [f"mode {k + 1}" for k in range(n)],
            ("m kg^0.5", "m kg^0.5/s"),
            abs(length) / np.where(largest > 1e-3 * largest.max(), largest, largest.max()),
            drive,
        )

    @classmethod
    def of_full(cls, engine, structure: MeshedStructure, drive: CentreDisplacement, length: float) -> "BeamMap":
        """Map of the full kernel; the state is displacements of the free nodes and their velocities."""
        names = [f"node {k // 2} {'xy'[k % 2]}" for k in structure.free]
        return cls._of(engine, names, ("m", "m/s"), np.full(len(names), abs(length)), drive)

    @classmethod
    def _of(cls, engine, names, units, length, drive: CentreDisplacement) -> "BeamMap":
        n, omega = len(names), 2.0 * np.pi * drive.frequency
        length = np.maximum(length, 1e-12)
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
        engine = self.engine(np.asarray(state, dtype=float), BUDGET * periods)
        states, rows, status, reason = [], [], OK, ""
        for _ in range(periods):
            period = engine.period(1)
            if period.status != OK:
                status, reason = period.status, period.reason
                break
            states.append(engine.whole_state())
            rows.append(engine.middle())
        done = len(states)
        middle = np.array(rows).reshape(done, 4)
        passed = engine.noted(max(1, done)).impacts
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

    def tangent(self, state: np.ndarray, vectors: np.ndarray, periods: int) -> Tangent | None:
        """None: contact that begins and ends within steps has no derivative at hand."""
        return None

    def misses(self, state: np.ndarray) -> np.ndarray:
        """Local minima of the clearance over one period [m]."""
        engine = self.engine(np.asarray(state, dtype=float), BUDGET)
        minima = np.zeros(MISSES)
        count = engine.misses(minima)
        return minima[:count]
