"""What the posterior of a study costs beside its simulations: processor time of the sampler and of the book-keeping.

    PYTHONPATH=tests python tests/benchmarks/bench_posterior.py --seed 0

A synthetic record of `four_dof` with five unknown parameters is profiled from its truth, and its posterior distribution
sampled with each point on disk. Printed are the seconds of the simulations with their scores, of the points' file, and
of the sampler, which trains networks; the last two for each second of the first, and for 10 000 evaluations.
"""

import argparse
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from recovery import CASES, noisy

from calib.confidence import profiled, sampled
from calib.confidence.notes import PointNotes
from calib.execution.pool import InProcess
from calib.modelling.model import Model
from calib.modelling.parameter import Space
from calib.objective import Objective, Reference, Term
from calib.optimisers.multistart import Multistart
from calib.study import CalibrationStudy, evaluate


class Timed:
    """A function whose processor time is counted  [s]."""

    def __init__(self, function: Callable[..., Any]):
        self.function, self.seconds = function, 0.0

    def __call__(self, *given: Any) -> Any:
        """Call it."""
        begin = time.process_time()
        try:
            return self.function(*given)
        finally:
            self.seconds += time.process_time() - begin


class TimedNotes(PointNotes):
    """Points in a file, whose processor time is counted."""

    def __init__(self, path: Path):
        super().__init__(path, "benchmark")
        self.add_all = Timed(super().add_all)


def study_of(seed: int) -> tuple[CalibrationStudy, np.ndarray]:
    """A study of a record made from hidden values, and these in the unit cube."""
    case, rng = CASES["four_dof"], np.random.default_rng(seed)
    truth, motion = case.truth(rng)
    reference = Reference(
        "made", noisy(motion, rng), nuisance=case.nuisance, excitation=case.excitation, request=case.request
    )
    space = Space(case.windows, case.fixed)
    study = CalibrationStudy(
        name="posterior", model=Model(case.simulator), space=space,
        objective=Objective({"made": reference}, [Term(case.feature)]), optimiser=Multistart, budget=case.budget,
        seed=seed,
    )  # fmt: skip
    return study, space.point(truth)


def main() -> None:
    """Sample a posterior and print the costs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    study, truth = study_of(parser.parse_args().seed)
    simulation = Timed(partial(evaluate, study.without_search()))
    pool = InProcess(simulation)
    with tempfile.TemporaryDirectory() as folder, TimedNotes(Path(folder) / "points.jsonl") as notes:
        profiles = profiled(study, pool, truth, notes)
        simulation.seconds = notes.add_all.seconds = 0.0
        begin = time.process_time()
        posterior = sampled(study, pool, profiles, notes, {})
        whole = time.process_time() - begin
    parts = {"simulations and scores": simulation.seconds, "points' file": notes.add_all.seconds}
    parts["sampler"] = whole - sum(parts.values())
    number = posterior.evaluations
    print(f"{number} evaluations, effective size {posterior.effective_size:.0f}")
    for name, seconds in parts.items():
        print(
            f"{name}: {seconds:.1f} s of processor time, {seconds / number * 1e4:.1f} s for 10 000 evaluations, "
            f"{seconds / simulation.seconds:.2f} of the simulations"
        )


if __name__ == "__main__":
    main()
