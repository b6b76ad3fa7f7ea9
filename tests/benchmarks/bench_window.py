"""How many evaluations a window takes: emulated margins against classifiers of the label, on windows of known volume.

Run as ``PYTHONPATH=tests python tests/benchmarks/bench_window.py --seeds 10 --evaluations 300``; a sample of it is
a test in ``tests/confidence/window``. Peers learn whether a point is admissible, and nothing else: boosted trees
(scikit-learn) from Sobol points, and a Gaussian-process classifier (Bernoulli likelihood, Laplace's approximation,
Matern 5/2 with a length for each parameter) whose points are chosen in batches where it is least certain, as level sets
are sought in psychophysics (Letham et al. 2022, AISTATS 151, 8539; AEPsych).

Printed are, for each window, the misclassified volume over the admissible volume (median and largest of the seeds), and
in how many seeds the true share of the box lies in the stated 95 % interval.
"""

import argparse
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from benchmarks.window_cases import CASES, DIM, WindowCase, sobol, true_share
from sklearn.ensemble import HistGradientBoostingClassifier
from sklearn.gaussian_process import GaussianProcessClassifier
from sklearn.gaussian_process.kernels import ConstantKernel, Matern
from stated_interval import half_widths
from threadpoolctl import threadpool_limits

from calib.confidence.window.design import WindowDesign, space_filling, start_points
from calib.confidence.window.sampling import fine_sample
from calib.confidence.window.share import volume_share

BATCH = 25  # points of which the next ones are chosen
REFITTED_UP_TO = 300  # points, up to which the classifier's hyperparameters are estimated anew; it costs minutes later
POOL_POINTS = 1 << 11  # among which the classifier's next points are chosen

START_KERNEL = ConstantKernel(10.0, (1e-1, 1e4)) * Matern(np.full(DIM, 0.7), (0.05, 30.0), nu=2.5)


class WindowOutcome(NamedTuple):
    """Misclassified volume over the admissible one, and where a share is stated its interval over the true share.

    Attributes
    ----------
    misclassified : over the admissible volume  [1]
    interval : ends of the stated 95 % interval, over the true share  [1]; None where none is stated
    error : of the stated share over the half of its interval on that side  [1]
    stated : expected misclassified volume over the stated share  [1]
    """

    misclassified: float
    interval: tuple[float, float] | None = None
    error: float = float("nan")
    stated: float = float("nan")


def misclassified(case: WindowCase, said: np.ndarray, points: np.ndarray) -> float:
    """Misclassified over admissible volume of a case, from what is said of points (m, 6)."""
    true = case.admissible(points)
    return float((said != true).sum() / true.sum())


def emulated_margins(case: WindowCase, seed: int, evaluations: list[int]) -> dict[int, WindowOutcome]:
    """Outcome after each number of evaluations."""
    truth, points = true_share(case), case.points(case.test_points, 2)
    design, found = WindowDesign(DIM, seed), {}
    observed = case.observe(np.vstack([case.start(), space_filling(DIM, start_points(DIM), seed)]))
    while True:
        number = len(observed.points)
        if number in evaluations:
            region = design.region(observed)
            sample = fine_sample(region, observed.points[observed.admissible], seed)
            share = volume_share(region, sample, observed, seed)
            wrong = misclassified(case, region.probability(points) > 0.5, points)
            interval = share.low / truth, share.high / truth
            stated = share.misclassified / share.value
            found[number] = WindowOutcome(wrong, interval, half_widths(share, truth), stated)
        left = [end - number for end in evaluations if end > number]
        if not left:
            return found
        more = design.next_points(observed, min(BATCH, left[0]))
        observed = case.observe(np.vstack([observed.points, more]))


def boosted_trees(case: WindowCase, seed: int, evaluations: list[int]) -> dict[int, WindowOutcome]:
    """Outcome of boosted trees that learn the label of Sobol points."""
    found, test = {}, case.points(case.test_points, 2)
    for number in evaluations:
        start = case.start()
        points = np.vstack([start, space_filling(DIM, number - len(start), seed)])
        trees = HistGradientBoostingClassifier(random_state=seed, min_samples_leaf=5).fit(
            points, case.admissible(points)
        )
        found[number] = WindowOutcome(misclassified(case, trees.predict(test), test))
    return found


def bernoulli_level_set(case: WindowCase, seed: int, evaluations: list[int]) -> dict[int, WindowOutcome]:
    """Outcome of a Gaussian-process classifier whose points are chosen where it is least certain."""
    found, test = {}, case.points(case.test_points, 2)
    points = np.vstack([case.start(), space_filling(DIM, start_points(DIM), seed)])
    kernel = START_KERNEL
    while True:
        number, labels = len(points), case.admissible(points)
        if number <= REFITTED_UP_TO:
            classifier = GaussianProcessClassifier(START_KERNEL, n_restarts_optimizer=2, random_state=seed)
            kernel = classifier.fit(points, labels).kernel_
        else:
            classifier = GaussianProcessClassifier(kernel, optimizer=None).fit(points, labels)
        if number in evaluations:
            found[number] = WindowOutcome(misclassified(case, classifier.predict(test), test))
        left = [end - number for end in evaluations if end > number]
        if not left:
            return found
        pool = sobol(POOL_POINTS, seed + 1000 * number)
        unsure = np.argsort(np.abs(classifier.predict_proba(pool)[:, 1] - 0.5))[: 4 * BATCH]
        chosen = np.random.default_rng(seed + number).permutation(unsure)[: min(BATCH, left[0])]
        points = np.vstack([points, pool[chosen]])


METHODS: dict[str, Callable[[WindowCase, int, list[int]], dict[int, WindowOutcome]]] = {
    "emulated margins": emulated_margins,
    "Bernoulli level set": bernoulli_level_set,
    "boosted trees": boosted_trees,
}


def print_outcomes(case: WindowCase, method: str, seeds: range, evaluations: list[int]) -> None:
    """Print a line for each seed and number of evaluations, then one for all seeds and each number."""
    begin, outcomes = time.process_time(), list[dict[int, WindowOutcome]]()
    for seed in seeds:
        outcomes.append(METHODS[method](case, seed, evaluations))
        for number, one in outcomes[-1].items():
            interval = "" if one.interval is None else ", interval {:.2f} to {:.2f} true shares".format(*one.interval)
            print(f"  seed {seed} {number:5}: {one.misclassified:.2%}{interval}", flush=True)
    seconds = (time.process_time() - begin) / len(seeds)
    for number in evaluations:
        own = [outcome[number] for outcome in outcomes]
        wrong = np.array([one.misclassified for one in own])
        line = f"{case.name:8} {method:20} {number:5}: {np.median(wrong):.1%}, at most {wrong.max():.1%}"
        if own[0].interval is not None:
            line += f", stated {np.median([one.stated for one in own]):.1%}"
            line += f", interval honest in {sum(one.error <= 1.0 for one in own)} of {len(own)}"
        print(f"{line} ({seconds:.0f} s CPU a seed)", flush=True)


def main() -> None:
    """Print outcomes for each case and method."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--evaluations", default="100,300")
    parser.add_argument("--methods", default=",".join(METHODS))
    parser.add_argument("--cases", default=",".join(case.name for case in CASES))
    options = parser.parse_args()
    evaluations = [int(number) for number in options.evaluations.split(",")]
    with threadpool_limits(1):
        for case in [case for case in CASES if case.name in options.cases.split(",")]:
            for method in options.methods.split(","):
                print_outcomes(case, method, range(options.first, options.first + options.seeds), evaluations)


if __name__ == "__main__":
    main()
