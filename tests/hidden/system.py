"""What a hider drives and looks at: a plant with its true values, and the records that are made of it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from typing import NamedTuple

import numpy as np
from hidden.flight import Laws, Plant
from hidden.motion import Motion, repeating, starting
from hidden.sensors import sensed

TRANSIENT = (
    "modulation",
    "detuning",
    "damping_rise",
)  # laws that are explicit in time: of records that begin, not of what repeats


class Plan(NamedTuple):
    """A record to be made.

    Attributes
    ----------
    use : "calibrate", "name" or "holdout"
    kind : "harmonic" (whole periods of the motion that repeats), "multisine" (from rest) or "decay"
    amplitude : of the excitation [its unit]; the scale of the multisine; the displacement at the start of a decay [m]
    frequency : of the harmonic  [Hz]
    """

    name: str
    use: str
    kind: str
    amplitude: float
    frequency: float = 0.0


class Clock(NamedTuple):
    """When the samples of a record were taken.

    Attributes
    ----------
    true, stamps : (n,) instants, as they were and as the record has them  [s]
    jitter : standard deviation of the true ones about the stamps, beside a drift  [s]
    """

    true: np.ndarray
    stamps: np.ndarray
    jitter: float = 0.0


@dataclass(frozen=True)
class System:
    """A plant that records are made of.

    Attributes
    ----------
    name, options : the simulator that stands for it in a study
    truth : its true values, SI
    windows : calibrated parameter -> (low, high, scale)
    fixed : what the study states beside the nominal values: parameter -> value
    plans : the records
    plant : (values, plan) -> Plant
    measured : bodies that the records hold -> row of the plant
    place, quantity : of the excitation
    feature : what is compared
    structure : hidden parameter -> the parameter that it is a relative change of
    effects : hidden in it, drawn ones among them
    undrawn : effects that can be hidden in it too; a case that is drawn stays the same where the library grows
    length, omega : natural scales  [m], [rad/s]
    periods, samples : of a harmonic record
    time : (n,) of another record  [s]
    clocks : of the records, by name; None: all sample in step with the drive, at `samples` per period, or at `time`
    remainders : kinds of what the plant may have besides, which no effect expresses
    step : of derivatives, relative
    cycles : of a harmonic record in a laboratory that is drawn: least and most
    """

    name: str
    options: Mapping[str, object]
    truth: Mapping[str, float]
    windows: Mapping[str, tuple[float, float, str]]
    fixed: Mapping[str, float]
    plans: tuple[Plan, ...]
    plant: Callable[[Mapping[str, float], Plan], Plant]
    measured: Mapping[str, int]
    place: str
    quantity: str
    feature: str
    structure: Mapping[str, str]
    effects: tuple[str, ...]
    length: float
    omega: float
    periods: int
    samples: int
    time: np.ndarray
    clocks: Mapping[str, Clock] | None = None
    remainders: tuple[str, ...] = ("second_stop", "quintic", "parametric", "magnet", "cogging", "valve")
    step: float = 1e-5
    undrawn: tuple[str, ...] = ()
    cycles: tuple[float, float] = (2.5, 100.0)

    @property
    def hideable(self) -> tuple[str, ...]:
        """Effects that can be hidden in it."""
        return self.effects + self.undrawn

    def clock(self, plan: Plan) -> Clock:
        """Clock of a record."""
        if self.clocks is not None:
            return self.clocks[plan.name]
        times = self._in_step(plan)
        return Clock(times, times)

    @cached_property
    def fingerprint(self) -> str:
        """What tells these clocks from others; empty where all sample in step with the drive."""
        if self.clocks is None:
            return ""
        return sha256(b"".join(clock.true.tobytes() for clock in self.clocks.values())).hexdigest()

    def times(self, plan: Plan) -> np.ndarray:
        """Instants at which a record was sampled (n,)  [s]."""
        return self.clock(plan).true

    def _in_step(self, plan: Plan) -> np.ndarray:
        if plan.kind == "harmonic":
            return np.arange(self.periods * self.samples) / (plan.frequency * self.samples)
        return self.time

    def restructured(self, values: Mapping[str, float], hidden: Mapping[str, float]) -> dict[str, float]:
        """Values of the plant with the relative changes that are hidden."""
        values = dict(values)
        for name, base in self.structure.items():
            values[base] *= 1.0 + hidden.get(name, 0.0)
        return values

    def moved(self, plan: Plan, values: Mapping[str, float], hidden: Mapping[str, float], state=None) -> Motion:
        """Motion at these values of the plant and of the hidden parameters; `state` is where to look for it first."""
        plant = self.plant(self.restructured(values, hidden), plan)
        plant = plant._replace(gap=plant.gap + hidden.get("dg", 0.0))
        absent = TRANSIENT if plan.kind == "harmonic" else ()
        laws = Laws(**{name: float(hidden[name]) for name in Laws._fields if name in hidden and name not in absent})
        if plan.kind == "harmonic":
            return repeating(plant, laws, 1.0 / plan.frequency, state)
        start = np.zeros(2 * plant.load.size)
        start[0] = plan.amplitude if plan.kind == "decay" else 0.0
        return starting(plant, laws, self.times(plan)[-1], start)

    def rows(self, plan: Plan, motion: Motion, hidden: Mapping[str, float], shift: float = 0.0) -> np.ndarray:
        """What the instruments show: displacements, then velocities of the measured bodies (2 b, n).

        shift : how much later the record begins  [s]
        """
        index = list(self.measured.values())

        def look(times):
            displacement, velocity = motion.look(times)
            return displacement[index], velocity[index]

        times = self.times(plan)
        return np.concatenate(sensed(look, hidden, times)(times + shift))
