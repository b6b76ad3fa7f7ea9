"""How much like effects is what a model lacks: `model_error_cosine` and `max_model_error_cosine` of the diagnosis.

    PYTHONPATH=tests python tests/benchmarks/bench_model_error.py oscillator 3
    PYTHONPATH=tests python tests/benchmarks/bench_model_error.py four_dof 2

Each kind of remainder that hide and seek knows makes 2 % of the motion, in laboratories that are drawn by chance. The
cosine between what it changes in the records and what an effect changes, both beyond calibration, is taken over the
effects that do not express it: printed is its root mean square. Of two effects that are alike, the cosine between what
the remainder leaves beside the one and what the other changes further makes the other look better by chance, where it
is positive: printed is the quantile below which 95 % are, either sign being as likely.
"""

import sys
import tempfile
from itertools import permutations
from pathlib import Path

import numpy as np
from hidden.drawn import CLEAR
from hidden.hider import SYSTEMS, bench
from hidden.information import Bench
from hidden.laboratory import Laboratory
from hidden.motion import Refused
from hidden.remainder import EXPRESSED, scaled

SHARE = 0.02  # of the motion
SAME = 0.9999  # |cos| from which two effects are one


def cosines(simulator: str, seed: int, cache: Path) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Of each kind that can be had, |cos| to each effect and to what alike effects differ by; none that express it."""
    at = bench(simulator, cache, laboratory=Laboratory.drawn(seed, SYSTEMS[simulator]()))
    effects, found = tuple(name for name in at.system.effects if name != "outliers"), {}
    alike = np.nan_to_num(at.cosines(effects))
    pairs = [(i, j) for i, j in permutations(range(len(effects)), 2) if CLEAR <= alike[i, j] < SAME]
    for kind in at.system.remainders:
        try:
            values = scaled(at, kind, SHARE, np.random.default_rng(seed))
        except Refused:
            continue
        single = np.nan_to_num(at.imitations(values, [(effect,) for effect in effects]))
        found[kind] = single[(single > 0.0) & (single < EXPRESSED)], _beside(at, values, effects, pairs, single)
    return found


def _beside(at: Bench, values: dict, effects: tuple, pairs: list[tuple[int, int]], single: np.ndarray) -> np.ndarray:
    """|cos| of what a remainder leaves beside the first effect of each pair to what the second changes further."""
    if not pairs:
        return np.zeros(0)
    both = np.nan_to_num(at.imitations(values, [(effects[i], effects[j]) for i, j in pairs]))
    first = single[[i for i, _ in pairs]]
    free = both < EXPRESSED
    return np.sqrt(np.maximum(0.0, both**2 - first**2) / (1.0 - first**2))[free]


def main():
    """Print a line a laboratory, and both figures over all."""
    simulator, count = sys.argv[1], int(sys.argv[2])
    squares, beside = [], []
    with tempfile.TemporaryDirectory() as name:
        for seed in range(count):
            found = cosines(simulator, seed, Path(name))
            rms = {kind: np.sqrt((own**2).mean()) for kind, (own, _) in found.items()}
            squares += [float((own**2).mean()) for own, _ in found.values()]
            beside += [own for _, own in found.values()]
            print(f"laboratory {seed}: " + ", ".join(f"{kind} {value:.2f}" for kind, value in rms.items()), flush=True)
    whole = np.concatenate(beside)
    print(
        f"{simulator}: root mean square over kinds and laboratories {np.sqrt(np.mean(squares)):.2f}; beside alike "
        f"effects 95 % are below {np.quantile(whole, 0.90):.2f} ({whole.size})"
    )


if __name__ == "__main__":
    main()
