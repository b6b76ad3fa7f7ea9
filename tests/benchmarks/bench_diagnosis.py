"""What a diagnosis costs: by the number of candidates, on one process and on two; of a long decay; of the Silverbox.

    PYTHONPATH=tests python tests/benchmarks/bench_diagnosis.py

A cubic spring is hidden in the four-degree-of-freedom model (five records, one of them held out) and sought among the
first 7, 14, ... effects that the study may be missing, that one included. Wall-clock seconds of `calib diagnose` from
its files, report included, after a first one that compiles; beside them, in the same run, the calibration it judges.
A mass on a softening spring in resisting air swings down for 30 s, sampled at 100 Hz: with all effects as candidates.
The Silverbox is diagnosed where `CALIB_DATA` says that it is at hand.
"""

import json
import os
import tempfile
import time
from pathlib import Path

from click.testing import CliRunner
from hidden.hider import hide
from softening_decay import written

from calib.cli import main as calib

HIDDEN, STRENGTH = "cubic_stiffness", 40.0
STEP = 7  # candidates more from row to row
SILVERBOX = Path(__file__).parents[2] / "studies" / "silverbox"


def timed(*arguments) -> float:
    """Wall-clock seconds of a command."""
    begin = time.perf_counter()
    answer = CliRunner().invoke(calib, [*map(str, arguments), "--quiet"], catch_exceptions=False)
    if answer.exit_code != 0:
        raise SystemExit(answer.output)
    return time.perf_counter() - begin


def diagnosed(study: Path, out: Path, jobs: int) -> tuple[float, dict]:
    """Seconds of a diagnosis, and what it says."""
    seconds = timed("diagnose", study, "--out", out, "--jobs", jobs)
    return seconds, json.loads((out / "diagnosis.json").read_text())


def main():
    """Print seconds and ratios."""
    with tempfile.TemporaryDirectory() as name:
        folder, out = Path(name), Path(name) / "out"
        hide("four_dof", HIDDEN, STRENGTH, 0, folder=folder, cache=folder / "cache")
        calibration = timed("run", folder, "--out", out, "--jobs", 2)
        _, said = diagnosed(folder, out, 2)  # compiles
        effects = sorted((suspect["effect"] for suspect in said["suspects"]), key=lambda effect: effect != HIDDEN)
        text = (folder / "study.toml").read_text()
        print(f"four_dof, five records; its calibration {calibration:.1f} s on two processes")
        print("candidates  simulations  one process  two processes  two / one  two / calibration")
        for count in [*range(STEP, len(effects), STEP), len(effects)]:
            (folder / "study.toml").write_text(f"{text}\n[diagnosis]\ncandidates = {json.dumps(effects[:count])}\n")
            alone, said = diagnosed(folder, out, 1)
            both, said = diagnosed(folder, out, 2)
            print(
                f"{count:10d}  {said['simulations']:11d}  {alone:9.1f} s  {both:11.1f} s  {both / alone:9.2f}  "
                f"{both / calibration:17.1f}   {', '.join(said['causes']) or said['verdict']}",
                flush=True,
            )
        study = written(folder / "decay", 30.0)
        calibration = timed("run", study, "--out", folder / "swung", "--jobs", 2)
        alone, said = diagnosed(study, folder / "swung", 1)
        both, said = diagnosed(study, folder / "swung", 2)
        print(
            f"free decay of 30 s at 100 Hz, {len(said['suspects'])} candidates, {said['simulations']} simulations: "
            f"{alone:.1f} s on one process, {both:.1f} s on two, {both / calibration:.1f} times its calibration: "
            f"{', '.join(said['causes']) or said['verdict']}",
            flush=True,
        )
        if "CALIB_DATA" in os.environ:
            calibration = timed("run", SILVERBOX, "--out", folder / "silverbox", "--jobs", 2)
            alone, said = diagnosed(SILVERBOX, folder / "silverbox", 1)
            both, said = diagnosed(SILVERBOX, folder / "silverbox", 2)
            print(
                f"Silverbox, {len(said['suspects'])} candidates, {said['simulations']} simulations: "
                f"{alone:.1f} s on one process, {both:.1f} s on two, a factor of {alone / both:.2f}, "
                f"{both / calibration:.1f} times its calibration: {', '.join(said['causes'])}"
            )


if __name__ == "__main__":
    main()
