"""Damaged and hostile study files, records, ledgers, templates, outputs and figures, read as a user would read them.

    cd tests && python -m benchmarks.fuzz --minutes 10 --jobs 2

Each case is made from a seed and read in a process of its own. It is good when it is read, or refused by calib's own
error, within 20 s of processor time and 1 GB, with nothing touched outside of its folder. What is not is kept in
--keep, with what happened in case.json, and is repeated by

    cd tests && python -m benchmarks.fuzz --kinds record --seed 123

The exit status is 1 where a case has failed.
"""

import argparse
import multiprocessing
import os
import shutil
import signal
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from pathlib import Path
from tempfile import mkdtemp

ALL = ("study", "record", "ledger", "template", "reader", "figure")
REPORT_SECONDS = 10.0  # s, between two lines of progress
MAX_KEPT = 3  # cases that are kept of one cause


@dataclass
class Tally:
    """What the cases of one kind came to."""

    cases: int = 0
    read: int = 0
    failures: Counter[str] = field(default_factory=Counter)
    seconds: float = 0.0
    slowest: str = ""
    bytes: int = 0
    largest: str = ""


def work(kinds: Sequence[str], seeds: range, minutes: float, root: Path, keep: Path, said: Connection) -> None:
    """Run cases of each kind in turn until the time is over, and say how each ended."""
    os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    from fuzzing.case import lay_trap, run_case, save, warm_up  # what they import takes seconds
    from fuzzing.kinds import KINDS

    trap = lay_trap(root)
    warm_up([KINDS[kind] for kind in kinds], root)
    said.send("ready")
    until = time.time() + 60.0 * minutes
    kept: Counter[str] = Counter()
    for seed in seeds:
        for kind in kinds:
            if time.time() > until:
                said.send(None)
                return
            outcome = run_case(KINDS[kind], seed, root, trap)
            if not outcome.good:
                kept[outcome.signature] += 1
                if kept[outcome.signature] <= MAX_KEPT:
                    save(outcome, root / "case", keep / f"{kind}-{seed}")
            said.send(outcome)
    said.send(None)


def main() -> int:
    """Run cases, with a line of progress now and then, and a table at the end."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=10.0, help="how long [default: 10]")
    parser.add_argument("--kinds", default=",".join(ALL), help=f"of {', '.join(ALL)} [default: all]")
    parser.add_argument("--jobs", type=int, default=2, help="processes [default: 2]")
    parser.add_argument("--first", type=int, default=None, help="seed of the first cases [default: of the clock]")
    parser.add_argument("--cases", type=int, default=10**9, help="of each kind and process [default: no bound]")
    parser.add_argument("--seed", type=int, help="this case only")
    parser.add_argument(
        "--keep", type=Path, default=None, help="folder of cases that failed [default: a temporary one]"
    )
    asked = parser.parse_args()
    kinds = asked.kinds.split(",")
    if unknown := set(kinds) - set(ALL):
        parser.error(f"there is no kind {', '.join(sorted(unknown))}; there are {', '.join(ALL)}")
    if asked.seed is not None:
        asked.first, asked.cases, asked.jobs = asked.seed, 1, 1
    keep = asked.keep or Path(mkdtemp(prefix="calib-fuzz-failed-"))
    first = int(time.time()) % 10**6 * 1000 if asked.first is None else asked.first
    root = Path(mkdtemp(prefix="calib-fuzz-"))
    try:
        return _run(kinds, asked, first, root, keep)
    finally:
        shutil.rmtree(root, ignore_errors=True)


def _run(kinds: Sequence[str], asked: argparse.Namespace, first: int, root: Path, keep: Path) -> int:
    context = multiprocessing.get_context("spawn")
    begin = last = time.time()
    workers, ends = [], list[Connection]()
    for job in range(asked.jobs):
        ours, theirs = context.Pipe(duplex=False)
        seeds = range(first + job, first + job + asked.jobs * asked.cases, asked.jobs)
        arguments = (kinds, seeds, asked.minutes, root / str(job), keep, theirs)
        workers.append(context.Process(target=work, args=arguments, daemon=True))
        workers[-1].start()
        theirs.close()
        ends.append(ours)
    tallies = {kind: Tally() for kind in kinds}
    print(f"seeds from {first}; cases that fail are kept in {keep}", flush=True)
    while ends:
        for end in wait(ends, timeout=1.0):
            try:
                outcome = end.recv()
            except EOFError:
                print("a process has died", flush=True)
                return 1
            if outcome is None:
                ends.remove(end)
            elif outcome == "ready":
                print(f"{time.time() - begin:5.0f} s: a process has read the samples and begins", flush=True)
            else:
                _count(tallies[outcome.kind], outcome)
        if time.time() - last > REPORT_SECONDS:
            last = time.time()
            count = sum(tally.cases for tally in tallies.values())
            failed = sum(tally.failures.total() for tally in tallies.values())
            print(f"{last - begin:5.0f} s: {count} cases, {failed} failed, of {asked.minutes:g} min", flush=True)
    _table(tallies, time.time() - begin)
    return int(any(tally.failures for tally in tallies.values()))


def _count(tally: Tally, outcome) -> None:
    """Count an outcome; the first failure of its kind is printed."""
    tally.cases += 1
    tally.read += outcome.status == "read"
    if not outcome.good:
        tally.failures[outcome.signature] += 1
        if tally.failures[outcome.signature] == 1:
            what = outcome.detail.strip().splitlines()[-1:] or [""]
            print(f"{outcome.kind} {outcome.seed} ({outcome.sample}): {outcome.status}: {what[0]:.300}", flush=True)
    if outcome.seconds > tally.seconds:
        tally.seconds, tally.slowest = outcome.seconds, f"{outcome.kind} {outcome.seed}"
    if outcome.bytes > tally.bytes:
        tally.bytes, tally.largest = outcome.bytes, f"{outcome.kind} {outcome.seed}"


def _table(tallies: dict[str, Tally], seconds: float) -> None:
    print(f"\n{seconds:.0f} s")
    print(f"{'kind':10} {'cases':>8} {'read':>8} {'failed':>7} {'worst time':>11} {'worst memory':>13}")
    for kind, tally in tallies.items():
        print(
            f"{kind:10} {tally.cases:8} {tally.read:8} {tally.failures.total():7} {tally.seconds:9.2f} s "
            f"{tally.bytes / 1e6:10.0f} MB  (seeds {tally.slowest.split()[-1:]}, {tally.largest.split()[-1:]})"
        )
    for kind, tally in tallies.items():
        for signature, count in tally.failures.most_common():
            print(f"  {kind}: {count} times: {signature}")


if __name__ == "__main__":
    sys.exit(main())
