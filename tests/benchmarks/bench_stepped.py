"""Forces hidden in stepped sines, and whether a diagnosis of the frequency responses names them.

    PYTHONPATH=tests python tests/benchmarks/bench_stepped.py --cases 4 --nothing 4
    PYTHONPATH=tests python tests/benchmarks/bench_stepped.py --cases 0 --nothing 2 --first 53 --trouble all

Each case is drawn from its seed and integrated by the tests' own code (`hidden/stepped.py`), calibrated and diagnosed
from its files. Printed: the verdict, and whether the hidden effect is in the reported class. With `--trouble` it is
measured in a laboratory that has it, its size and the directions of the sweeps drawn (`hidden/stepped_laboratory.py`).
"""

import argparse
import json
import tempfile
import time
from pathlib import Path

from click.testing import CliRunner
from hidden.stepped import CAUSES, drawn, written
from hidden.stepped_laboratory import TROUBLES, WHITE, SteppedLaboratory

from calib.cli import main as calib


def sought(cause: str | None, seed: int, trouble: str | None, jobs: int) -> dict[str, object]:
    """Hide a cause, calibrate, diagnose, and return what is said with what was hidden."""
    truth = drawn(cause, seed)
    laboratory = WHITE if trouble is None else SteppedLaboratory.drawn(trouble, seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        written(truth, seed, folder, laboratory)
        begin = time.process_time(), time.perf_counter()
        for command in ("run", "diagnose"):
            answer = CliRunner().invoke(calib, [command, name, "--quiet", "--jobs", str(jobs)], catch_exceptions=False)
            if answer.exit_code != 0:
                raise SystemExit(answer.output)
        said = json.loads((folder / "out" / "diagnosis.json").read_text())
    return {
        "cause": cause, "seed": seed, "laboratory": laboratory, "size": truth.size,
        "verdict": said["verdict"], "causes": said["causes"],
        "classes": said["class"], "z": {s["effect"]: s["z"] for s in said["suspects"] if s["effect"] == cause},
        "simulations": said["simulations"], "seconds": round(time.perf_counter() - begin[1]),
    }  # fmt: skip


def main():
    """Print a line for each case."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", type=int, default=4, help="of each cause")
    parser.add_argument("--causes", nargs="+", choices=CAUSES, default=list(CAUSES), help="all of them unless told")
    parser.add_argument("--nothing", type=int, default=4, help="cases without a cause")
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    parser.add_argument("--trouble", choices=("none", "all", *TROUBLES), default="none", help="of the laboratory")
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args()
    troubles = list(TROUBLES) if given.trouble == "all" else [None if given.trouble == "none" else given.trouble]
    wanted = [(None, seed, trouble) for seed in range(given.nothing) for trouble in troubles]
    wanted += [(cause, seed, trouble) for seed in range(given.cases) for cause in given.causes for trouble in troubles]
    right = {"in the class": 0, "named alone": 0, "cases": 0, "nothing found": 0}
    for cause, seed, trouble in wanted:
        found = sought(cause, given.first + seed, trouble, given.jobs)
        print(json.dumps(found), flush=True)
        accepted = CAUSES[cause].accepted if cause else ()
        right["cases"] += cause is not None
        right["in the class"] += any(name in accepted for names in found["classes"] for name in names)
        right["named alone"] += any(name in accepted for name in found["causes"])
        right["nothing found"] += cause is None and found["verdict"] == "none"
    print(right, f"of {given.nothing * len(troubles)} without a cause")


if __name__ == "__main__":
    main()
