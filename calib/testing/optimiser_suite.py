"""What every optimiser has to fulfil, as tests that its author subclasses.

::

    class TestMultistart(OptimiserSuite):
        def make(self, dim, seed, budget, batch):
            return Multistart(dim, seed, budget, batch)

The suite needs pytest: `calib[testing]`.
"""

import threading
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from calib.study import Outcome
from calib.study.contracts import Optimiser

MakeOptimiser = Callable[..., Optimiser]  # (dim, seed, budget, batch), all with a default
BOWL = np.array([0.62, 0.31, 0.45, 0.7])  # where the bowl is least, cut to the dimensions wanted


def bowl(u: np.ndarray, centre: np.ndarray) -> Outcome:
    """Outcome at u (dim,) of a quadratic bowl about a centre (dim,): residuals are the distances, scaled by axis."""
    residuals = (u - centre) * np.arange(1, u.size + 1)
    return Outcome(float(np.sqrt(residuals @ residuals)), residuals, "ok", "period 1")


def failure(u: np.ndarray) -> Outcome:
    """Outcome of a run that failed, wherever it was."""
    return Outcome(np.inf, None, "diverged", None)


def search(
    optimiser: Optimiser, outcome: Callable[[np.ndarray], Outcome], budget: int
) -> tuple[np.ndarray, list[Outcome]]:
    """Ask and tell until the budget is spent or the optimiser stops; all points (n, dim) and their outcomes."""
    points: list[np.ndarray] = []
    outcomes: list[Outcome] = []
    while len(points) < budget and optimiser.stop() is None:
        asked = optimiser.ask()
        returned = [outcome(u) for u in asked]
        points += list(asked)
        outcomes += returned
        optimiser.tell(asked, returned)
    return np.array(points), outcomes


class OptimiserSuite:
    """Subclass it, say how an optimiser is made, and pytest does the rest.

    Attributes
    ----------
    budget : evaluations within which the bowl has to be found
    close_enough : distance from its least point that counts as zero, in units of the window [1]
    """

    budget = 300
    close_enough = 0.05

    def make(self, dim: int, seed: int, budget: int, batch: int) -> Optimiser:
        """Return an optimiser; the subclass says which."""
        raise NotImplementedError("an OptimiserSuite says how its optimiser is made: def make(self, dim, seed, ...)")

    @pytest.fixture
    def optimiser(self) -> Iterator[MakeOptimiser]:
        """Make optimisers as `make` does, and close them after the test."""
        made: list[Optimiser] = []

        def making(dim: int = 2, seed: int = 1, budget: int | None = None, batch: int = 1) -> Optimiser:
            made.append(self.make(dim, seed, budget or self.budget, batch))
            return made[-1]

        yield making
        for each in made:
            each.close()

    def lowest(self, optimiser: Optimiser, centre: np.ndarray) -> np.ndarray:
        """Return the best point that an optimiser finds in the bowl."""
        points, outcomes = search(optimiser, lambda u: bowl(u, centre), self.budget)
        return points[np.argmin([outcome.cost for outcome in outcomes])]

    @pytest.mark.parametrize(("dim", "batch"), [(1, 1), (3, 1), (3, 8)])
    def test_points_lie_in_the_cube_and_have_its_dimension(
        self, optimiser: MakeOptimiser, dim: int, batch: int
    ) -> None:
        points, _ = search(optimiser(dim, batch=batch), lambda u: bowl(u, BOWL[:dim]), 60)
        assert points.shape[1] == dim
        assert ((points >= 0) & (points <= 1)).all()

    def test_it_finds_the_least_point_of_a_bowl(self, optimiser: MakeOptimiser) -> None:
        assert np.abs(self.lowest(optimiser(2), BOWL[:2]) - BOWL[:2]).max() < self.close_enough

    def test_it_finds_the_least_point_in_one_dimension(self, optimiser: MakeOptimiser) -> None:
        assert abs(self.lowest(optimiser(1), BOWL[:1])[0] - BOWL[0]) < self.close_enough

    def test_it_finds_a_least_point_on_the_bound(self, optimiser: MakeOptimiser) -> None:
        corner = np.array([1.0, 0.31])
        assert np.abs(self.lowest(optimiser(2), corner) - corner).max() < self.close_enough

    @pytest.mark.parametrize("batch", [1, 6])
    def test_the_same_outcomes_lead_to_the_same_points_bit_for_bit(self, optimiser: MakeOptimiser, batch: int) -> None:
        def outcome(u: np.ndarray) -> Outcome:
            return failure(u) if u[0] < 0.2 else bowl(u, BOWL[:3])

        first, outcomes = search(optimiser(3, seed=5, batch=batch), outcome, 120)
        np.random.default_rng().random()
        again, log = optimiser(3, seed=5, batch=batch), iter(outcomes)
        replayed, _ = search(again, lambda u: next(log), len(first))
        np.testing.assert_array_equal(replayed, first)

    def test_another_seed_leads_to_other_points(self, optimiser: MakeOptimiser) -> None:
        first, second = (search(optimiser(3, seed=s), lambda u: bowl(u, BOWL[:3]), 60)[0] for s in (5, 6))
        assert first.shape != second.shape or (first != second).any()

    def test_the_global_generator_is_neither_read_nor_seeded(self, optimiser: MakeOptimiser) -> None:
        before = np.random.get_state(legacy=False)  # noqa: NPY002 - it is the global generator that is watched
        search(optimiser(2), lambda u: bowl(u, BOWL[:2]), 60)
        after = np.random.get_state(legacy=False)  # noqa: NPY002
        np.testing.assert_equal(after, before)

    @pytest.mark.parametrize("batch", [1, 8])
    def test_it_survives_that_every_run_fails(self, optimiser: MakeOptimiser, batch: int) -> None:
        points, _ = search(optimiser(3, budget=max(100, self.budget), batch=batch), failure, 100)
        assert len(points) >= 100
        assert ((points >= 0) & (points <= 1)).all()

    def test_it_survives_runs_that_fail_in_a_slab(self, optimiser: MakeOptimiser) -> None:
        def outcome(u: np.ndarray) -> Outcome:
            return failure(u) if u[0] > 0.8 else bowl(u, BOWL[:2])

        points, outcomes = search(optimiser(2), outcome, self.budget)
        best = points[np.argmin([each.cost for each in outcomes])]
        assert np.abs(best - BOWL[:2]).max() < self.close_enough

    @pytest.mark.parametrize("failed", [False, True])
    def test_it_takes_a_screen_before_the_first_ask(self, optimiser: MakeOptimiser, failed: bool) -> None:
        screen = np.random.default_rng(3).random((16, 2))
        outcome = failure if failed else lambda u: bowl(u, BOWL[:2])
        searcher = optimiser(2)
        searcher.tell(screen, [outcome(u) for u in screen])
        points, _ = search(searcher, lambda u: bowl(u, BOWL[:2]), 30)
        assert ((points >= 0) & (points <= 1)).all()

    def test_it_stops_when_the_budget_is_spent(self, optimiser: MakeOptimiser) -> None:
        searcher = optimiser(2, budget=40)
        assert searcher.stop() is None
        points, _ = search(searcher, lambda u: bowl(u, BOWL[:2]), 1000)
        assert len(points) <= 40
        assert isinstance(searcher.stop(), str)

    def test_points_before_the_first_ask_count_against_the_budget(self, optimiser: MakeOptimiser) -> None:
        searcher, earlier = optimiser(2, budget=40), np.random.default_rng(3).random((16, 2))
        searcher.tell(earlier, [bowl(u, BOWL[:2]) for u in earlier])
        points, _ = search(searcher, lambda u: bowl(u, BOWL[:2]), 1000)
        assert len(points) <= 24
        assert isinstance(searcher.stop(), str)

    def test_it_closes_twice_and_leaves_no_thread(self, optimiser: MakeOptimiser) -> None:
        before = set(threading.enumerate())
        searcher = optimiser(2)
        search(searcher, lambda u: bowl(u, BOWL[:2]), 10)
        searcher.close()
        searcher.close()
        assert set(threading.enumerate()) <= before
