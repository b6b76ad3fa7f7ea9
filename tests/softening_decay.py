"""A mass on a spring that softens, in a resisting air, let go: a joint that slides is nearly like both together."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

DRAG, SOFTENING = 0.8, -37.0  # c2 of quadratic_drag [1/m], kx of softening [1/(m s^2)]
RATE = 100.0  # samples a second  [Hz]
NOISE = 1e-4  # [m]
STUDY = """
[study]
name = "decay"
seed = 1
budget = 60

[[record]]
name = "decay"
path = "decay.csv"
use = "calibrate"
nuisance = ["initial_state", "offset"]

[record.table]
time = { column = "time", unit = "s" }
channels = [{ column = "position", body = "mass", channel = "displacement", unit = "m", sigma = "0.1 mm" }]

[record.excitation]
place = "mass"
quantity = "free decay"

[model]
simulator = "oscillator"

[model.fixed]
mass = "1 kg"

[windows]
stiffness = { low = "50 N/m", high = "100 N/m" }
damping = { low = 0.001, high = 1.0, scale = "log" }

[[term]]
feature = "time_history"

[optimiser]
name = "multistart"
"""


def written(folder: Path, seconds: float, candidates: Sequence[str] = ()) -> Path:
    """Write the record and its study, with these candidates or with all; return the study."""
    instants = np.arange(int(RATE * seconds)) / RATE

    def motion(_, state):
        x, v = state
        return [v, -74.0 * x - SOFTENING * x * abs(x) - 0.05 * v - DRAG * v * abs(v)]

    exact = solve_ivp(motion, (0.0, seconds), [0.07, 0.0], t_eval=instants, rtol=1e-10, atol=1e-12).y[0]
    position = exact + NOISE * np.random.default_rng(0).standard_normal(exact.size)
    folder.mkdir(exist_ok=True)
    table = np.column_stack([instants, position])
    np.savetxt(folder / "decay.csv", table, delimiter=",", header="time,position", comments="")
    sought = f"\n[diagnosis]\ncandidates = {json.dumps(list(candidates))}\n" if candidates else ""
    (folder / "study.toml").write_text(STUDY + sought)
    return folder / "study.toml"
