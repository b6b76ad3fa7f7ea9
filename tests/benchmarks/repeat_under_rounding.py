"""Kinds of motion over restitution, repeated from starts and with parameters that differ by rounding.

    python tests/benchmarks/repeat_under_rounding.py --values 500 --repeats 20

Each repeat sweeps the paper's minimal model over restitution 0..0.8 with its start and its physical parameters changed
by shares of 1e-15 to 1e-9, as another processor, compiler or library of linear algebra might change them, and more.
Prints the values at which a repeat has another kind or other impacts, or is undecided, and whether the tool itself says
there that rounding decides. The exit status is 1 where more than 1 % of the values do not get the same answer in all
repeats, or one of them is said to be certain in all. Of 500 values and 20 repeats, 2 get different kinds, in 2 more
some repeats are undecided, and all 4 are said to be uncertain; a sweep takes 13 s on two cores.
"""

import argparse
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.records.cycles.motion import UNDECIDED
from calib.study_file import load
from calib.sweep import Sweep, run

STUDY = Path(__file__).parents[2] / "studies" / "paper_minimal"
CHANGED = ("gap", "damping", "young_modulus", "layer_stiffness", "layer_mass", "length", "beam_thickness")
SMALLEST, LARGEST = 1e-15, 1e-9  # relative change of a parameter, and change of the start as a share of the map's scale
MAX_DIFFERING = 0.01  # share of the values that may differ


def perturbed(sweep: Sweep, share: float, seed: int) -> Sweep:
    """Return the sweep with its start and its parameters changed by so much, up or down."""
    rng, setting = np.random.default_rng(seed), sweep.setting
    nominal = {**setting.model.nominal, **setting.values}
    values = {name: nominal[name] * (1.0 + share * rng.choice([-1.0, 1.0])) for name in CHANGED}
    map = setting.map({"restitution": 0.5})
    start = map.initial + share * rng.choice([-1.0, 1.0], map.scale.size) * map.scale
    starts = [dict(zip(map.names, start.tolist(), strict=True))]
    return replace(sweep, setting=replace(setting, values={**setting.values, **values}), starts=starts)


def main() -> int:
    """Print what differs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--values", type=int, default=500)
    parser.add_argument("--repeats", type=int, default=20)
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    values = np.linspace(0.0, 0.8, asked.values)
    sweep, kinds, certain = Sweep(load(STUDY).setting(), {"restitution": values}), [], []
    shares = np.geomspace(SMALLEST, LARGEST, asked.repeats)
    with tempfile.TemporaryDirectory() as folder:
        for k, share in enumerate([0.0, *shares]):
            begin = time.perf_counter()
            found = run(perturbed(sweep, share, k), Path(folder) / f"{k}.nc", jobs=asked.jobs)
            kinds.append(list(zip(found.kind.values, found.impacts.values.tolist(), strict=True)))
            certain.append(found.certain.values)
            other, unsure = sum(a != b for a, b in zip(kinds[0], kinds[-1], strict=True)), (~certain[-1]).sum()
            seconds = time.perf_counter() - begin
            print(f"changed by {share:.1e}: {other} differ, {unsure} uncertain ({seconds:.0f} s)", flush=True)
    differing = [k for k in range(values.size) if len({row[k] for row in kinds}) > 1]
    silent = [k for k in differing if all(row[k] for row in certain)]
    for k in differing:
        seen = sorted({f"{kind}, {impacts} impacts" for kind, impacts in (row[k] for row in kinds)})
        said = " (none is said to be uncertain)" if k in silent else ""
        print(f"restitution {values[k]:.5f}: {'; '.join(seen)}{said}")
    other = sum(len({row[k] for row in kinds if row[k][0] != UNDECIDED}) > 1 for k in differing)
    print(
        f"of {values.size} values {other} have different kinds, {len(differing) - other} more are undecided in some "
        f"repeats, and {len(silent)} of both are not said to be uncertain"
    )
    return int(len(differing) > MAX_DIFFERING * values.size or bool(silent))


if __name__ == "__main__":
    sys.exit(main())
