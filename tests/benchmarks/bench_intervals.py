"""How often the stated 95 % intervals of a calibration cover the hidden values.

    PYTHONPATH=tests python tests/benchmarks/bench_intervals.py --seeds 20

Five synthetic calibrations with 2 % noise, each of so many hidden truths; the count with the 95 % bounds of Clopper and
Pearson, and by parameter. Twenty seeds take some three minutes.
"""

import argparse
import tempfile
from pathlib import Path

from recovery import coverage
from scipy.stats import binomtest


def main() -> None:
    """Print the share of intervals that cover the truth."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        rows = coverage(range(asked.seeds), Path(folder))
    inside = sum(row[3] for row in rows)
    low, high = binomtest(inside, len(rows)).proportion_ci(method="exact")
    print(f"covered: {inside} of {len(rows)}, {inside / len(rows):.1%} ({low:.1%} to {high:.1%})")
    for case, parameter in dict.fromkeys(row[:2] for row in rows):
        own = [row[3] for row in rows if row[:2] == (case, parameter)]
        print(f"  {case} {parameter}: {sum(own)} of {len(own)}")


if __name__ == "__main__":
    main()
