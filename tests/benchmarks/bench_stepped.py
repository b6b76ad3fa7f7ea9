"""Forces hidden in stepped sines, and whether a diagnosis of the frequency responses names them.

    PYTHONPATH=tests python tests/benchmarks/bench_stepped.py --cases 4 --nothing 4
    PYTHONPATH=tests python tests/benchmarks/bench_stepped.py --cases 0 --nothing 2 --first 53 --trouble all

Each case is drawn from its seed and integrated by the tests' own code (`hidden/stepped.py`), calibrated and diagnosed
from its files. With `--trouble` it is measured in a laboratory that has it, its size and the directions of the sweeps
drawn (`hidden/stepped_laboratory.py`).

Printed of each case: the verdict, `z`, the norm of what is hidden in the noise of two per cent beyond what stiffness
and damping absorb, which no law of the library has a part in (of a law with a special case, as Dahl's friction is one
of Bouc and Wen's, beyond that), and what the diagnosis says of the hidden effect: its normal deviate, and the square
root of the fall of chi-square by it. At the end of each cause: the cases, those of z >= 8, and of these how many have
it in the reported class, and named alone. `--keep` keeps what each diagnosis says.
"""

import argparse
import json
import shutil
import tempfile
import time
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from click.testing import CliRunner
from hidden.stepped import drawn, signal_beyond_special, signal_to_noise, written
from hidden.stepped_laboratory import TROUBLES, WHITE, SteppedLaboratory
from hidden.stepped_laws import CAUSES

from calib.cli import main as calib

VISIBLE_Z = 8.0  # of what is hidden, from which on it should be found


def sought(cause: str | None, seed: int, trouble: str | None, jobs: int, keep: Path | None) -> dict[str, object]:
    """Hide a cause, calibrate, diagnose, and return what is said with what was hidden."""
    truth = drawn(cause, seed)
    laboratory = WHITE if trouble is None else SteppedLaboratory.drawn(trouble, seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        written(truth, seed, folder, laboratory)
        begin = time.perf_counter()
        for command in ("run", "diagnose"):
            answer = CliRunner().invoke(calib, [command, name, "--quiet", "--jobs", str(jobs)], catch_exceptions=False)
            if answer.exit_code != 0:
                raise SystemExit(answer.output)
        seconds, document = round(time.perf_counter() - begin), folder / "out" / "diagnosis.json"
        said = json.loads(document.read_text())
        if keep is not None:
            shutil.copy(document, keep / f"{cause}_{seed}_{trouble}.json")
    own = next((suspect for suspect in said["suspects"] if suspect["effect"] == cause), None)
    return {
        "cause": cause, "seed": seed, "laboratory": laboratory, "size": truth.size, "form": truth.form,
        "z": None if cause is None else round(min(signal_to_noise(truth), signal_beyond_special(truth)), 1),
        "verdict": said["verdict"], "causes": said["causes"], "classes": said["class"],
        "deviate": own and own["z"], "root_fall": own and round(max(0.0, own["drop"]) ** 0.5, 1),
        "refitted": own and own["refitted"], "simulations": said["simulations"], "seconds": seconds,
    }  # fmt: skip


def outcome(found: Mapping[str, object]) -> Counter[str]:
    """What counts of a case."""
    cause = found["cause"]
    if cause is None:
        return Counter({"cases": 1, "nothing found": int(found["verdict"] == "none")})
    if found["z"] < VISIBLE_Z:
        return Counter({"cases": 1})
    accepted = CAUSES[cause].accepted
    in_class = any(name in accepted for names in found["classes"] for name in names)
    alone = len(found["causes"]) == 1 and found["causes"][0] in accepted
    return Counter({"cases": 1, "z >= 8": 1, "in the class": int(in_class), "named alone": int(alone)})


def main():
    """Print a line for each case, then one for each cause."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", type=int, default=4, help="of each cause")
    parser.add_argument("--causes", nargs="+", choices=CAUSES, default=list(CAUSES), help="all of them unless told")
    parser.add_argument("--nothing", type=int, default=4, help="cases without a cause")
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    parser.add_argument("--trouble", choices=("none", "all", *TROUBLES), default="none", help="of the laboratory")
    parser.add_argument("--keep", type=Path, help="existing folder for what each diagnosis says")
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args()
    troubles = list(TROUBLES) if given.trouble == "all" else [None if given.trouble == "none" else given.trouble]
    wanted = [(None, seed, trouble) for seed in range(given.nothing) for trouble in troubles]
    wanted += [(cause, seed, trouble) for seed in range(given.cases) for cause in given.causes for trouble in troubles]
    counts: dict[str | None, Counter[str]] = {}
    for cause, seed, trouble in wanted:
        found = sought(cause, given.first + seed, trouble, given.jobs, given.keep)
        print(json.dumps(found), flush=True)
        counts.setdefault(cause, Counter()).update(outcome(found))
    for cause, count in counts.items():
        print(f"{cause or 'nothing'}: {dict(count)}")


if __name__ == "__main__":
    main()
