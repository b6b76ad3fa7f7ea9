"""A study of the echo, small enough to run in a test: its record, its study file."""

from pathlib import Path

import numpy as np
from tiny_simulators import Echo

from calib import records
from calib.modelling.simulator import Request
from calib.records.excitation import Excitation

TRUTH = {"gain": 1.2, "harmonic": 0.0002}
NOISE = 2e-5  # m, m/s over the angular frequency
FREQUENCY = 10.0  # Hz

TEXT = """\
[study]
name = "echo"
seed = 1
budget = 24
jobs = 1
timeout = "20 s"
screen = 8

[[record]]
name = "bench"
path = "bench.nc"
nuisance = ["trigger"]

[model]
simulator = "tiny_simulators:Echo"

[windows]
gain = { low = 0.5, high = 2.0, scale = "log" }
harmonic = { low = "-1 mm", high = "1 mm" }

[[term]]
feature = "phase_curve"

[optimiser]
name = "multistart"
"""


def bench(amplitude: float = 1e-3, seed: int = 0):
    """Measure the echo: a noisy record of TRUTH."""
    excitation = Excitation("base", "base motion", frequency=FREQUENCY, amplitude=amplitude)
    record = Echo().run(TRUTH, excitation, (), Request(periods=4, samples=100))
    rng = np.random.default_rng(seed)
    record = record.drop_vars(["section_displacement", "section_velocity"])
    for channel, sigma in (("displacement", NOISE), ("velocity", NOISE * 2.0 * np.pi * FREQUENCY)):
        record[channel] = record[channel] + rng.normal(0.0, sigma, record[channel].shape)
        record[channel].attrs["units"] = records.CHANNELS[channel]
        record[f"{channel}_sigma"] = ("body", [sigma], {"units": records.CHANNELS[channel]})
    return record.assign_attrs(place="base", quantity="base motion", amplitude=amplitude, source="tests")


def write_study(folder: Path, *changes: tuple[str, str], text: str = TEXT) -> Path:
    """Write record and study file into `folder`, the text with `changes` (old, new) made; return the study's path."""
    records.write(bench(), folder / "bench.nc")
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    path = folder / "study.toml"
    path.write_text(text)
    return path
