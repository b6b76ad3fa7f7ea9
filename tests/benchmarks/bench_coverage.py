"""Whether ranks of truths drawn from the prior are uniform, and whether intervals cover these truths.

    PYTHONPATH=tests python tests/benchmarks/bench_coverage.py ranks.jsonl --studies 400 --ranked 200

Simulation-based calibration (S. Talts et al., Validating Bayesian inference algorithms with simulation-based
calibration, arXiv:1804.06788): where the truth is drawn from the prior, its rank among draws of the posterior is
uniform. Each study appends its line to the file as it ends, and the same command goes on where it was stopped. Printed
are the p-values of chi-square over ten bins, and the share of intervals that cover, by how the mass meets its stop.
"""

import argparse
import json
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from functools import partial
from pathlib import Path

import numpy as np
from prior_studies import CONTACT, DRAWS, FREE, GRAZING, RANKED, SPACE, StudyOfDraw, study_of_draw
from scipy.stats import binomtest, chisquare

BINS = 10  # of the ranks  [count]


def known(path: Path) -> dict[int, StudyOfDraw]:
    """Studies of a file by their numbers; a last line that was torn is left out."""
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True) if path.exists() else []
    studies = (StudyOfDraw(**json.loads(line)) for line in lines if line.endswith("\n"))
    return {study.number: study for study in studies}


def made(numbers: Sequence[int], ranked: int, jobs: int) -> Iterator[StudyOfDraw]:
    """Studies of draws; the posterior of those with a number below `ranked` is sampled."""
    if jobs == 1:
        yield from (study_of_draw(number, number < ranked) for number in numbers)
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(partial(_made, ranked), numbers)


def _made(ranked: int, number: int) -> StudyOfDraw:
    return study_of_draw(number, number < ranked)


def uniformity(ranks: Sequence[int]) -> float:
    """p-value of ranks 0 to DRAWS under a uniform distribution: chi-square over BINS."""
    counts = np.bincount(np.array(ranks) * BINS // (DRAWS + 1), minlength=BINS)
    return float(chisquare(counts).pvalue)


def print_ranks(studies: Sequence[StudyOfDraw]) -> None:
    """Print the uniformity of the ranks."""
    ranked = [study for study in studies if study.ranks]
    for noise, name in (("the known noise", "ranks"), ("the noise of the residuals", "ranks_of_estimate")):
        values = {name_: uniformity([getattr(study, name)[name_] for study in ranked]) for name_ in RANKED}
        print(f"ranks of {len(ranked)}, {noise}: p " + ", ".join(f"{n} {p:.3f}" for n, p in values.items()))


def print_coverage(studies: Sequence[StudyOfDraw]) -> None:
    """Print the share of intervals that cover, of profiles and of the linearisation."""
    for intervals in ("profile", "local"):
        for parameter in SPACE.names:
            print(f"{intervals} {parameter}: {_share(studies, intervals, parameter)}")
            closed = [study for study in studies if parameter in study.closed]
            print(f"  of those whose profile is closed: {_share(closed, intervals, parameter)}")
            for contact in (CONTACT, GRAZING, FREE):
                print(f"  {contact}: {_share([s for s in studies if s.contact == contact], intervals, parameter)}")


def _share(studies: Sequence[StudyOfDraw], intervals: str, parameter: str) -> str:
    if not studies:
        return "none"
    inside = sum(study.covers(intervals, parameter) for study in studies)
    missing = sum(parameter not in getattr(study, intervals) for study in studies)
    low, high = binomtest(inside, len(studies)).proportion_ci(method="exact")
    without = f"; {missing} without an interval" if missing else ""
    return f"{inside} of {len(studies)}, {inside / len(studies):.1%} ({low:.1%} to {high:.1%}){without}"


def main() -> None:
    """Make the studies that the file lacks, and print what all of them say."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", type=Path, help="JSON lines, one a study")
    parser.add_argument("--studies", type=int, default=400, help="of which profiles are followed")
    parser.add_argument("--ranked", type=int, default=200, help="first ones of them whose posterior is sampled too")
    parser.add_argument("--first", type=int, default=0, help="number of the first one")
    parser.add_argument("--jobs", type=int, default=1)
    asked = parser.parse_args()
    before = known(asked.file)
    numbers = [
        number
        for number in range(asked.first, asked.first + asked.studies)
        if number not in before or (number < asked.ranked and not before[number].ranks)
    ]
    with asked.file.open("a", encoding="utf-8") as file:
        for count, study in enumerate(made(numbers, asked.ranked, asked.jobs), 1):
            file.write(json.dumps(asdict(study)) + "\n")
            file.flush()
            print(f"\r{count} of {len(numbers)} studies", end="", flush=True)
    studies = list(known(asked.file).values())
    print(f"\r{len(studies)} studies, {sum(sum(study.cpu) for study in studies) / 60.0:.1f} min of processor time")
    if any(study.ranks for study in studies):
        print_ranks(studies)
    print_coverage(studies)


if __name__ == "__main__":
    main()
