"""Whitened residuals of pure noise, over sample clocks, noises and lengths: variance 1, no autocorrelation.

    python tests/benchmarks/bench_whitening.py --seeds 20

Records of a steady tone, whose model is right, are sampled by 30 clocks: in step with the drive, free-running, and
free-running with a rate that is off by 50 ppm and instants that jitter by 1 % of a sample. For each noise and length
the mean variance over clocks and seeds stands beside its Monte Carlo error, and the mean of the autocorrelation at lags
1 to 5 in units of its standard error.
"""

import argparse

import numpy as np
from scipy.signal import lfilter

from calib.diagnosis.bench import SimulatedRows
from calib.diagnosis.gathering import gathered
from calib.diagnosis.score import Projection
from calib.objective import Reference
from calib.records import make

FREQUENCY, AMPLITUDE = 26.24, 1e-3  # Hz, m
SIGMA = 0.01  # of the noise, over each channel's amplitude
NOISES = {"white": [], "AR(1) 0.5": [0.5], "AR(1) 0.9": [0.9], "AR(2)": [1.2, -0.5]}
LENGTHS = (2.5, 10.0, 60.0)  # cycles
CLOCKS = 30
LAGS = 5
LEAD = 2000  # samples that noise is drawn ahead of a record
ROWS = (("mass", "displacement"), ("mass", "velocity"))


def motion(time: np.ndarray) -> np.ndarray:
    """Displacement [m] and velocity [m/s] (2, n) of a motion of three harmonics."""
    rate = 2.0 * np.pi * FREQUENCY
    orders, sizes, phases = np.array([1.0, 3.0, 7.0]), np.array([1.0, 0.2, 0.02]), np.array([0.0, 1.0, 2.0])
    angle = orders[:, None] * rate * time + phases[:, None]
    return AMPLITUDE * np.array([sizes @ np.sin(angle), (sizes * orders * rate) @ np.cos(angle)])


def instants(rng: np.random.Generator, clock: int, cycles: float) -> tuple[np.ndarray, np.ndarray]:
    """Instants as recorded and as they were (n,)  [s]."""
    per_period = np.exp(rng.uniform(np.log(20.0), np.log(400.0)))
    if clock % 3 == 0:
        per_period = np.round(per_period)
    recorded = np.arange(int(cycles * per_period)) / (per_period * FREQUENCY)
    if clock % 3 < 2:
        return recorded, recorded
    jitter = 0.01 * rng.uniform(-0.5, 0.5, recorded.size) / (per_period * FREQUENCY)
    return recorded, recorded * (1.0 + 50e-6) + jitter


def whitened(rng: np.random.Generator, clock: int, memory: list[float], cycles: float) -> np.ndarray:
    """Residuals (row, n) of a record of this clock, in units of the noise that was found."""
    recorded, true = instants(rng, clock, cycles)
    clean = motion(true)
    feedback = np.concatenate([[1.0], -np.array(memory)])
    noise = lfilter([1.0], feedback, rng.standard_normal((2, true.size + LEAD)))[:, LEAD:]
    noise /= np.linalg.norm(lfilter([1.0], feedback, np.eye(1, LEAD)[0]))  # to unit variance
    measured = clean + SIGMA * np.abs(clean).max(axis=1, keepdims=True) * noise
    record = make(
        recorded, ["mass"], {"displacement": measured[:1], "velocity": measured[1:]},
        frequency=FREQUENCY, amplitude=1.0, phase=0.0, place="mass", quantity="force", source="measured",
    )  # fmt: skip
    reference = Reference("tone", record)
    seen = {"tone": SimulatedRows(motion(recorded), np.ones(recorded.size))}
    evidence = gathered({"tone": reference}, {"tone": ROWS}, {"tone": 1}, seen)
    return Projection(evidence.tangents(seen))(evidence.residual(seen)).reshape(2, -1)


def main() -> None:
    """Print a line for each noise and length."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20)
    seeds = parser.parse_args().seeds
    for name, memory in NOISES.items():
        for cycles in LENGTHS:
            variances, lags = [], []
            for clock in range(CLOCKS):
                for seed in range(seeds):
                    rng = np.random.default_rng([seed, clock, int(10 * cycles), len(memory)])
                    for row in whitened(rng, clock, memory, cycles):
                        variances.append(np.mean(row**2))
                        sums = [row[lag:] @ row[:-lag] for lag in range(1, LAGS + 1)]
                        lags.append(np.array(sums) / (row @ row) * np.sqrt(row.size))
            error = np.std(variances) / np.sqrt(len(variances))
            z = np.mean(lags, axis=0) * np.sqrt(len(lags))
            mean = "  ".join(f"{x:+.3f} ({y:+.1f})" for x, y in zip(np.mean(lags, axis=0), z, strict=True))
            print(
                f"{name:10} {cycles:5.1f} cycles: variance {np.mean(variances):.3f} +- {error:.3f}; autocorrelation at "
                f"lags 1..{LAGS} in standard errors of one record (of all): {mean}",
                flush=True,
            )


if __name__ == "__main__":
    main()
