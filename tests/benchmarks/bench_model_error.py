"""How much like an effect is what a model lacks: `model_error_cosine` of the diagnosis.

    PYTHONPATH=tests python tests/benchmarks/bench_model_error.py oscillator 3
    PYTHONPATH=tests python tests/benchmarks/bench_model_error.py four_dof 2

Each kind of remainder that hide and seek knows makes 2 % of the motion, in laboratories that are drawn by chance.
Printed is the root mean square of |cos| between what it changes in the records and what an effect changes, both beyond
calibration, over the effects that do not express it.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
from hidden.hider import SYSTEMS, bench
from hidden.laboratory import Laboratory
from hidden.motion import Refused
from hidden.remainder import EXPRESSED, kinds, scaled

SHARE = 0.02  # of the motion


def cosines(simulator: str, seed: int, cache: Path) -> dict[str, np.ndarray]:
    """Of each kind that can be had, |cos| to each effect that does not express it."""
    at = bench(simulator, cache, laboratory=Laboratory.drawn(seed, SYSTEMS[simulator]()))
    effects, found = tuple(name for name in at.system.effects if name != "outliers"), {}
    for kind in kinds(at):
        try:
            values = scaled(at, kind, SHARE, np.random.default_rng(seed))
        except Refused:
            continue
        alike = at.imitations(values, [(effect,) for effect in effects])
        found[kind] = alike[np.isfinite(alike) & (alike < EXPRESSED)]
    return found


def main():
    """Print a line a laboratory, and their mean square over all."""
    simulator, count = sys.argv[1], int(sys.argv[2])
    squares = []
    with tempfile.TemporaryDirectory() as name:
        for seed in range(count):
            found = cosines(simulator, seed, Path(name))
            rms = {kind: np.sqrt((own**2).mean()) for kind, own in found.items()}
            squares += [float((own**2).mean()) for own in found.values()]
            print(f"laboratory {seed}: " + ", ".join(f"{kind} {value:.2f}" for kind, value in rms.items()), flush=True)
    print(f"{simulator}: root mean square over kinds and laboratories {np.sqrt(np.mean(squares)):.2f}")


if __name__ == "__main__":
    main()
