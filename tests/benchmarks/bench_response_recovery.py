"""How often the intervals of a calibration on stepped sines cover the hidden values, and lie within 2 standard errors.

    PYTHONPATH=tests python tests/benchmarks/bench_response_recovery.py recovered.jsonl --seeds 100

Three levels of a Duffing oscillator with 2 % noise, swept up; with `--control both` down as well, with `--control held`
at three held amplitudes. Each case appends its line to the file, and the same command goes on where it was stopped.
"""

import argparse
import json
import tempfile
import time
from functools import partial
from pathlib import Path

import numpy as np
from response_recovery import WINDOWS, held, recovered, stepped
from scipy.stats import binomtest

RECORDS = {"up": stepped, "both": partial(stepped, directions=(1.0, -1.0)), "held": held}


def errors(seed: int, control: str) -> dict[str, float | None]:
    """Error of each value in its standard errors, None without an interval."""
    with tempfile.TemporaryDirectory() as folder:
        truth, confidence = recovered(seed, RECORDS[control], Path(folder) / "out")
    found = {}
    for name in WINDOWS:
        low, high = confidence.interval.get(name, (np.nan, np.nan))
        error = (truth[name] - 0.5 * (low + high)) / (0.25 * (high - low))
        found[name] = float(error) if np.isfinite(error) else None
    return found


def main() -> None:
    """Play the cases that the file lacks, and print what all of them say."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", type=Path, help="JSON lines, one a case")
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--control", choices=RECORDS, default="up")
    asked = parser.parse_args()
    known = [json.loads(line) for line in asked.file.read_text().splitlines()] if asked.file.exists() else []
    rows = {row["seed"]: row for row in known if row["control"] == asked.control}
    with asked.file.open("a", encoding="utf-8") as file:
        for seed in (seed for seed in range(asked.seeds) if seed not in rows):
            begin = time.process_time()
            found = errors(seed, asked.control)
            row = {"seed": seed, "control": asked.control, "errors": found, "cpu": time.process_time() - begin}
            rows[seed] = row
            file.write(json.dumps(row) + "\n")
            file.flush()
            print(f"\r{len(rows)} of {asked.seeds}", end="", flush=True)
    print(f"\r{len(rows)} cases, {sum(row['cpu'] for row in rows.values()) / 60.0:.0f} min of processor time")
    for name in WINDOWS:
        own = [row["errors"][name] for row in rows.values()]
        known_errors = np.array([error for error in own if error is not None])
        inside = int((np.abs(known_errors) <= 2.0).sum())
        low, high = binomtest(inside, len(own)).proportion_ci(method="exact")
        print(
            f"{name}: {inside} of {len(own)}, {inside / len(own):.0%} ({low:.0%} to {high:.0%}); rms of the error "
            f"{np.sqrt(np.mean(known_errors**2)):.2f}, mean {known_errors.mean():.2f} standard errors; "
            f"{len(own) - known_errors.size} without an interval"
        )


if __name__ == "__main__":
    main()
