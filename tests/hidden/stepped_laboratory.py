"""What a laboratory does to stepped sines: one trouble each, drawn by chance, and the directions of the sweeps."""

from typing import NamedTuple

import numpy as np

WAYS = ((1.0,), (-1.0,), (1.0, -1.0))  # directions of the sweeps of each level, one after the other
NOISE = 0.02  # of the rms amplitude of a level, in each part
QUIET_NOISE = 0.005  # the same where another trouble is the larger error
PROPORTIONAL_NOISE = 0.02  # of the amplitude of a point, in each part
GAIN = 0.005, 0.02  # standard deviation of the gain and of the phase [rad] of a sensor that wanders
LEVEL = 0.005, 0.02  # standard deviation of the level of a controller that wanders, where only the set one is told
TOLD_LEVEL = 0.02, 0.06  # the same where the level of each point is told
MEMORY = 0.5, 0.95  # correlation of what wanders from point to point
RESONANCE = 0.001, 0.003  # relative change of the natural frequency over a record
OUTLIER = 0.2, 0.4  # error of the point after the largest jump, over its amplitude
MISSING = 2  # points about the largest jump
WAIT = 25, 60  # periods at each frequency, after which it is measured whether the motion repeats or not


class SteppedLaboratory(NamedTuple):
    """How stepped sines are measured.

    Attributes
    ----------
    trouble : one of TROUBLES
    directions : of the sweeps of each level
    size : of the trouble, as the constants of this file say
    memory : correlation of what wanders from one point to the next
    """

    trouble: str = "white"
    directions: tuple[float, ...] = (1.0,)
    size: float = NOISE
    memory: float = 0.0

    @classmethod
    def drawn(cls, trouble: str, seed: int) -> "SteppedLaboratory":
        """Draw the laboratory of a seed that has this trouble."""
        rng = np.random.default_rng([seed, 24])
        size = float(np.exp(rng.uniform(*np.log(TROUBLES[trouble]))))
        return cls(trouble, WAYS[rng.integers(len(WAYS))], size, float(rng.uniform(*MEMORY)))

    @property
    def wait(self) -> int:
        """Periods that a motion is given at each frequency; 0: as many as it needs."""
        return int(self.size) if self.trouble == "short wait" else 0

    def levels(self, level: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Levels (n,) that act at the points of a record, of which these (n,) are set."""
        wanders = self.trouble in ("level", "told level")
        return level * (1.0 + self.size * wandering(level.size, self.memory, rng)) if wanders else level

    def stiffness(self, size: int, rng: np.random.Generator) -> np.ndarray:
        """Factor (n,) on the stiffness at the points of a record, whose resonance drifts."""
        if self.trouble != "resonance":
            return np.ones(size)
        change = np.sign(rng.standard_normal()) * self.size * (np.arange(size) / (size - 1.0) - 0.5)
        return (1.0 + change) ** 2

    def measured(self, own: np.ndarray, rms: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Complex amplitudes (n,) as they are measured, where they are `own` and of this rms (n,) in their sweeps."""
        white = rng.standard_normal((own.size, 2)) @ [1.0, 1j]
        if self.trouble == "proportional":
            return own + PROPORTIONAL_NOISE * np.abs(own) * white
        if self.trouble == "gain":
            gain = wandering(own.size, self.memory, rng) + 1j * wandering(own.size, self.memory, rng)
            return own * (1.0 + self.size * gain) + QUIET_NOISE * rms * white
        quiet = self.trouble in ("level", "told level", "short wait")
        return own + (QUIET_NOISE if quiet else NOISE) * rms * white

    def kept(self, own: np.ndarray, sweep: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Amplitudes (m,) and indices (m,) of the points of a record that are kept, where one lies or some are lost."""
        if self.trouble not in ("outlier", "missing"):
            return own, np.arange(own.size)
        step = np.where(np.diff(sweep) == 0.0, np.abs(np.diff(own)), 0.0)
        jump = int(np.argmax(step)) + 1
        if self.trouble == "missing":
            kept = np.delete(np.arange(own.size), np.arange(jump, jump + MISSING))
            return own[kept], kept
        wrong = own.copy()
        wrong[jump] *= 1.0 + self.size * np.exp(2j * np.pi * rng.uniform())
        return wrong, np.arange(own.size)


TROUBLES = {  # and the least and the greatest of its size
    "white": (NOISE, NOISE),
    "proportional": (PROPORTIONAL_NOISE, PROPORTIONAL_NOISE),
    "gain": GAIN,
    "level": LEVEL,
    "told level": TOLD_LEVEL,
    "resonance": RESONANCE,
    "outlier": OUTLIER,
    "missing": (MISSING, MISSING),
    "short wait": WAIT,
}


WHITE = SteppedLaboratory()  # of sweeps up, of white noise


def wandering(size: int, memory: float, rng: np.random.Generator) -> np.ndarray:
    """Noise (n,) of unit variance, of this correlation of neighbours."""
    values = rng.standard_normal(size)
    for i in range(1, size):
        values[i] = memory * values[i - 1] + np.sqrt(1.0 - memory**2) * values[i]
    return values
