"""A laboratory drawn by chance: its sample clock, the lengths of its records, and its noise."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from hidden.system import Clock, Plan, System

SAMPLES = (20.0, 400.0)  # per period of a free-running clock
MOST = 20_000  # samples of a record
NOISE = (0.003, 0.03)  # over the rms of a channel
PHI = (0.3, 0.9)  # correlation of neighbouring samples, or modulus of the poles of an AR(2), at REFERENCE
ANGLE = (0.05, 0.8)  # of the poles of an AR(2) at REFERENCE  [rad]
REFERENCE = 200.0  # samples per period at which the colour of the noise is drawn
JITTER = 0.01  # standard deviation of an instant of a free-running clock, in sample intervals
DRIFT = 50e-6  # by which a free-running clock is fast or slow


@dataclass(frozen=True)
class Laboratory:
    """How the records of a system are taken.

    Attributes
    ----------
    clocks : of each record, by its name
    noise : standard deviation, over the rms of each channel
    memory : of each record's noise: coefficients of the autoregression
    stated : whether the records state the noise of their channels
    facts : what was drawn, in a form that JSON has
    """

    clocks: Mapping[str, Clock]
    noise: float
    memory: Mapping[str, tuple[float, ...]]
    stated: bool
    facts: Mapping[str, object]

    @classmethod
    def drawn(cls, seed: int, system: System, drift: float = DRIFT) -> "Laboratory":
        """Draw the laboratory of a seed for the records of a system; a free clock is fast or slow by `drift`."""
        rng = np.random.default_rng(seed)
        free, told, stated = (bool(rng.integers(2)) for _ in range(3))
        drift *= float(rng.choice([-1.0, 1.0])) if free else 0.0
        colour = rng.choice(["white", "AR(1)", "AR(2)"], p=[0.5, 0.25, 0.25])
        phi, angle, noise = rng.uniform(*PHI), rng.uniform(*ANGLE), _log_uniform(rng, NOISE)
        clocks, memory, facts = {}, {}, {}
        for plan in system.plans:
            samples, cycles = _log_uniform(rng, SAMPLES), _log_uniform(rng, system.cycles)
            if plan.kind == "harmonic" and not free:
                samples = float(system.samples)
            clocks[plan.name] = _clock(rng, system, plan, samples, cycles, drift, told if free else None)
            memory[plan.name] = _memory(colour, phi, angle, REFERENCE / samples)
            facts[plan.name] = {"samples": round(samples, 2), "cycles": round(float(_cycles(system, plan, clocks)), 2)}
        of_noise = {"level": noise, "colour": str(colour), "phi": phi if colour != "white" else 0.0, "stated": stated}
        of_clock = {"free": free, "jitter_told": told, "drift": drift}
        return cls(clocks, noise, memory, stated, {"clock": of_clock, "noise": of_noise, "records": facts})


def _log_uniform(rng: np.random.Generator, between: tuple[float, float]) -> float:
    return float(np.exp(rng.uniform(*np.log(between))))


def _frequency(system: System, plan: Plan) -> float:
    """Return what the rate of a record is measured by: of its drive, else the natural one [Hz]."""
    return plan.frequency if plan.kind == "harmonic" else system.omega / (2.0 * np.pi)


def _cycles(system: System, plan: Plan, clocks: Mapping[str, Clock]) -> float:
    stamps = clocks[plan.name].stamps
    return (stamps[-1] - stamps[0]) * stamps.size / (stamps.size - 1) * _frequency(system, plan)


def _clock(
    rng: np.random.Generator,
    system: System,
    plan: Plan,
    samples: float,
    cycles: float,
    drift: float,
    told: bool | None,
) -> Clock:
    """Clock of a record that begins at time zero.

    samples, cycles : per period, and length in periods; a record that does not repeat keeps its length in seconds
    told : whether the stamps tell the jitter; None: there is none
    """
    step = 1.0 / (samples * _frequency(system, plan))
    span = cycles / plan.frequency if plan.kind == "harmonic" else system.time[-1]
    nominal = np.arange(min(MOST, round(span / step))) * step
    if told is None:
        return Clock(nominal, nominal)
    jitter = JITTER * step * rng.standard_normal(nominal.size)
    jitter[0] = 0.0  # the first sample begins the record
    true = (1.0 + drift) * nominal + jitter
    return Clock(true, nominal + jitter if told else nominal, 0.0 if told else JITTER * step)


def _memory(colour: str, phi: float, angle: float, ratio: float) -> tuple[float, ...]:
    """Coefficients of the noise drawn at REFERENCE samples per period, `ratio` times as many as the record has."""
    if colour == "white":
        return ()
    phi, angle = phi**ratio, angle * ratio
    return (phi,) if colour == "AR(1)" else (2.0 * phi * np.cos(angle), -(phi**2))
