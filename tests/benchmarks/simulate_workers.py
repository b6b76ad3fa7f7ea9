"""What limits a search on many workers: a simulation of each hand-out, and its picture.

`python THIS --out FILE.png` prints, for runs of 10 ms, 1 s and 10 min on 10, 100 and 1000 workers, the share of the
workers' time that goes into runs, and what limits it. It takes figures that tests/benchmarks/bench_pools.py measures:
scheduler and asking process pass on one evaluation after the other, each at an overhead of 5.4 ms; an evaluation alone
takes 12.3 ms from the question to the answer. The optimiser is told a batch as soon as its last run has ended, and
takes 5 ms.
Durations of runs are lognormal: 68 % of them lie within the factor 1.3 of their median.
"""

import argparse
import heapq
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

OVERHEAD, LATENCY, TELL = 0.0054, 0.0123, 0.005  # s: for each evaluation, one at a time; of each; for each batch
SPREAD = 0.26  # log 1.3: standard deviation of the logarithm of a duration
RUNS = (0.01, 1.0, 600.0)  # s
WORKERS = (10, 100, 1000)
BATCHES_PER_WORKER = (1, 4)  # size of a batch, in numbers of workers
MIN_EVALUATIONS = 4000  # of a simulation
NAMES = {0.01: "10 ms", 1.0: "1 s", 600.0: "10 min"}


def busy_share(duration: float, workers: int, batch: int, overhead: float = OVERHEAD, spread: float = SPREAD) -> float:
    """Share of the workers' time that goes into runs.

    Parameters
    ----------
    duration : median of a run  [s]
    batch : evaluations that are asked for at a time, and told together
    overhead : time for which the scheduler is busy with one evaluation  [s]
    spread : standard deviation of the logarithm of a duration
    """
    rng, now, worked = np.random.default_rng(1), 0.0, 0.0
    for _ in range(max(3, MIN_EVALUATIONS // batch)):
        free = [now] * workers
        heapq.heapify(free)
        handed_out, last = now, now
        for run in duration * np.exp(spread * rng.standard_normal(batch)):
            handed_out += overhead
            begin = max(handed_out, heapq.heappop(free)) + LATENCY
            heapq.heappush(free, begin + run)
            last, worked = max(last, begin + run), worked + run
        now = last + TELL
    return worked / (workers * now)


def limit(duration: float, workers: int, batch: int) -> str:
    """What takes most of the time that is not spent in runs: the share that is won without it is the largest."""
    without = {
        "one hand-out after the other": busy_share(duration, workers, batch, overhead=0.0),
        "waiting for the slowest run of a batch": busy_share(duration, workers, batch, spread=0.0),
    }
    return max(without, key=without.__getitem__)


def main() -> None:
    """Print the table, and draw the picture."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", type=Path, required=True)
    out = parser.parse_args().out
    figure, axes = plt.subplots(1, len(RUNS), figsize=(9.0, 3.0), sharey=True, layout="constrained")
    for axis, duration in zip(axes, RUNS, strict=True):
        for factor in BATCHES_PER_WORKER:
            shares = [busy_share(duration, workers, factor * workers) for workers in WORKERS]
            axis.semilogx(WORKERS, shares, "o-", label=f"batch = {factor} x workers")
            for workers, share in zip(WORKERS, shares, strict=True):
                rate = share * workers / (duration * np.exp(SPREAD**2 / 2.0))
                why = limit(duration, workers, factor * workers)
                told = f"{workers} | {factor * workers} | {100 * share:.2g} % | {float(f'{rate:.2g}'):g} | {why}"
                print(f"| {NAMES[duration]} | {told} |")
        axis.set_title(f"runs of {NAMES[duration]}")
        axis.set_xlabel("workers")
    axes[0].set_ylabel("share of the time in runs")
    axes[0].set_ylim(0.0, 1.0)
    axes[-1].legend(fontsize="small")
    figure.savefig(out, dpi=120)


if __name__ == "__main__":
    main()
