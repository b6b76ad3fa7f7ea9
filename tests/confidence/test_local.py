"""Claims about standard errors, intervals and what is not determined."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from calib.confidence.covariance import distance_to_minimum, sandwich
from calib.confidence.identifiability import MAX_WINDOW_SHARE, combination, undetermined_combinations
from calib.confidence.local import local
from calib.errors import CalibError
from calib.modelling.parameter import Space, Window

TIME = np.linspace(0.0, 12.0 * np.pi, 400)


def outcome(residuals, status="ok", kind="period 1"):
    return SimpleNamespace(cost=0.0, residuals=residuals, status=status, kind=kind)


def linear(matrix, centre, noise):
    """Evaluate residuals matrix @ (u - centre) + noise."""
    return lambda points: [outcome(matrix @ (u - centre) + noise) for u in points]


def cube(*names):
    return Space({name: Window(0.0, 1.0) for name in names})


def waves(rng, dim, scale=3.0):
    return scale * np.column_stack([np.sin((k + 1) * TIME + rng.uniform(0.0, 6.0)) for k in range(dim)])


def coverage(noise, seeds=100, dim=4, blocks=None, calculate=None):
    """Share of 2-standard-error intervals that hold the truth, least squares on a linear problem."""
    held = []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        matrix, n = waves(rng, dim), noise(rng)
        truth = np.full(dim, 0.5)
        u = truth - np.linalg.lstsq(matrix, n, rcond=None)[0]
        if calculate is None:
            c = local(linear(matrix, truth, n), cube(*"abcdef"[:dim]), u, blocks=blocks)
            held += [low <= 0.5 <= high for low, high in c.interval.values()]
        else:
            held += list(np.abs(u - truth) <= 2.0 * calculate(matrix, matrix @ (u - truth) + n))
    return np.mean(held)


def white(rng):
    return 0.3 * rng.standard_normal(TIME.size)


def first_order(rng, memory=0.8):
    kicks = 0.3 * rng.standard_normal(TIME.size + 100)
    noise = np.zeros_like(kicks)
    for i in range(1, kicks.size):
        noise[i] = memory * noise[i - 1] + kicks[i]
    return noise[100:]


def ordinary(matrix, residuals):
    variance = residuals @ residuals / (residuals.size - matrix.shape[1])
    return np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix)) * variance)


def test_white_noise_gives_the_textbook_covariance():
    rng = np.random.default_rng(1)
    matrix, noise = waves(rng, 3), white(rng)
    step = np.linalg.lstsq(matrix, noise, rcond=None)[0]
    c = local(linear(matrix, np.full(3, 0.5), noise), cube("a", "b", "c"), 0.5 - step)
    expected = ordinary(matrix, noise - matrix @ step)
    np.testing.assert_allclose(list(c.standard_error.values()), expected, rtol=0.15)
    assert np.all(np.array(list(c.standard_error.values())) > 0.97 * expected)
    assert c.status == "ok"
    assert not c.reason
    assert not c.undetermined
    assert not c.at_edge


def test_white_noise_is_covered():
    assert 0.92 <= coverage(white) <= 0.99


def test_noise_that_differs_between_blocks_is_covered():
    blocks = np.repeat([0, 1], TIME.size // 2)
    assert 0.91 <= coverage(lambda rng: white(rng) * np.where(blocks, 0.05, 2.0), blocks=blocks) <= 0.995


def test_noise_with_a_memory_is_covered_where_the_naive_interval_fails():
    assert coverage(first_order, calculate=ordinary) < 0.85
    assert 0.90 <= coverage(first_order) <= 0.99


def test_terms_that_hear_the_same_noise_are_not_counted_twice():
    """Two blocks of which the second repeats the first: independence would promise errors 1.4 times too small."""
    half = TIME.size // 2
    blocks = np.repeat([0, 1], half)
    held = {True: [], False: []}
    for seed in range(100):
        rng = np.random.default_rng(seed)
        matrix = np.tile(waves(rng, 3)[:half], (2, 1))
        noise, noise_draws = np.tile(white(rng)[:half], 2), np.tile(rng.standard_normal((100, half)), 2)
        u = 0.5 - np.linalg.lstsq(matrix, noise, rcond=None)[0]
        for known in held:
            evaluate = linear(matrix, np.full(3, 0.5), noise)
            c = local(evaluate, cube("a", "b", "c"), u, blocks=blocks, noise_draws=noise_draws if known else None)
            held[known] += [low <= 0.5 <= high for low, high in c.interval.values()]
    assert np.mean(held[False]) < 0.88
    assert 0.91 <= np.mean(held[True]) <= 0.99


def test_few_residuals_widen_the_interval_as_student_says():
    rng = np.random.default_rng(3)
    held = []
    for _ in range(300):
        matrix, noise = rng.standard_normal((8, 3)), 0.1 * rng.standard_normal(8)
        u = 0.5 - np.linalg.lstsq(matrix, noise, rcond=None)[0]
        if np.all((u > 0.0) & (u < 1.0)):
            c = local(linear(matrix, np.full(3, 0.5), noise), cube("a", "b", "c"), u)
            held += [low <= 0.5 <= high for low, high in c.interval.values()]
    assert 0.90 <= np.mean(held) <= 0.99


def test_sandwich_of_a_known_heteroscedastic_problem():
    """One parameter, two blocks of unit sensitivity: var = (n1 s1^2 + n2 s2^2) / (n1 + n2)^2."""
    rng = np.random.default_rng(4)
    blocks = np.repeat([0, 1], [3000, 1000])
    noise = rng.standard_normal(4000) * np.where(blocks, 3.0, 0.1)
    residuals = noise - noise.mean()
    covariance, freedom = sandwich(np.ones((4000, 1)), residuals, blocks)
    assert covariance[0, 0] == pytest.approx((3000 * 0.01 + 1000 * 9.0) / 4000**2, rel=0.15)
    assert 700 < freedom[0] < 1300  # the noisy block alone decides


def test_two_parameters_that_act_through_their_ratio_are_named_with_it():
    space = Space({"stiffness": Window(50.0, 200.0, "log"), "mass": Window(0.5, 2.0, "log"), "gap": Window(0.0, 1e-3)})
    rng = np.random.default_rng(5)
    noise = 0.02 * rng.standard_normal(TIME.size)

    def motion(v):
        return np.sin(np.sqrt(v["stiffness"] / v["mass"] / 100.0) * TIME) + 1e3 * v["gap"] * np.cos(TIME)

    def evaluate(points):
        return [outcome(motion(space.values(u)) - np.sin(TIME) - 0.4 * np.cos(TIME) + noise) for u in points]

    c = local(evaluate, space, space.point({"stiffness": 100.0, "mass": 1.0, "gap": 0.4e-3}))
    (group,) = c.undetermined
    assert set(group.members) == {"stiffness", "mass"}
    assert "stiffness / mass" in group.text
    assert group.direction["stiffness"] * group.direction["mass"] > 0.0
    assert c.interval["stiffness"] == (50.0, 200.0)
    assert c.interval["gap"][1] - c.interval["gap"][0] < 0.05e-3


def test_nearly_collinear_parameters_are_named_though_their_errors_are_small():
    rng = np.random.default_rng(6)
    matrix = waves(rng, 3, scale=300.0)
    matrix[:, 1] = matrix[:, 0] + 6.0 * np.cos(5.0 * TIME)
    noise = 0.1 * white(rng)
    u = 0.5 - np.linalg.lstsq(matrix, noise, rcond=None)[0]
    c = local(linear(matrix, np.full(3, 0.5), noise), cube("a", "b", "c"), u)
    (group,) = c.undetermined
    assert set(group.members) == {"a", "b"}
    assert group.reason == "nearly collinear"
    assert max(c.standard_error.values()) < MAX_WINDOW_SHARE


def test_three_nearly_collinear_parameters_with_narrow_intervals_are_said_to_be_correlated():
    precision = np.eye(3) - (1.0 - 1e-3) * np.ones((3, 3)) / 3.0
    covariance = 1e-6 * np.linalg.inv(precision)
    (group,) = undetermined_combinations(cube("a", "b", "c"), np.full(3, 0.5), covariance)
    assert group.members == ("a", "b", "c")
    assert group.reason == "nearly collinear"
    assert re.match(r"a, b, c: their estimates are correlated \(\w with \w by \+0\.99", group.text)
    assert "each is determined within its interval" in group.text


def test_a_parameter_without_influence_is_not_determined():
    rng = np.random.default_rng(7)
    matrix, noise = waves(rng, 2), white(rng)
    matrix[:, 1] = 0.0
    c = local(linear(matrix, np.full(2, 0.5), noise), cube("a", "idle"), np.full(2, 0.5))
    assert [g.members for g in c.undetermined] == [("idle",)]
    assert c.standard_error["idle"] == np.inf
    assert c.summary().standard_error["idle"] is None
    assert c.interval["idle"] == (0.0, 1.0)


@pytest.mark.parametrize(("least", "reported"), [(0.7, 0.7), (2.0, np.inf)])
def test_a_standard_error_beyond_the_window_is_infinite(least, reported):
    matrix, noise = waves(np.random.default_rng(4), 1), white(np.random.default_rng(5))
    noise -= matrix[:, 0] * (matrix[:, 0] @ noise) / (matrix[:, 0] @ matrix[:, 0])  # the point is the minimum
    [textbook] = ordinary(matrix, noise)
    c = local(linear(matrix, np.full(1, 0.5), noise * least / textbook), cube("a"), np.full(1, 0.5))
    assert c.standard_error["a"] == pytest.approx(reported, rel=0.15)
    assert c.interval["a"] == (0.0, 1.0)


def test_what_moves_along_with_an_idle_parameter_is_not_determined_either():
    space = cube("a", "idle", "follower")
    errors, together = np.array([0.01, 300.0, 0.6]), 0.9  # the follower's part in that direction is 0.2 %
    covariance = np.diag(errors**2)
    covariance[1, 2] = covariance[2, 1] = together * errors[1] * errors[2]
    groups = undetermined_combinations(space, np.full(3, 0.5), covariance)
    assert [g.members for g in groups] == [("idle",), ("follower",)]
    assert groups[1].text == "follower: not determined inside its window"


def test_where_no_parameter_has_influence_none_is_determined():
    noise = white(np.random.default_rng(4))
    c = local(linear(np.zeros((TIME.size, 2)), np.zeros(2), noise), cube("a", "b"), np.ones(2))
    assert {group.members for group in c.undetermined} == {("a",), ("b",)}
    assert c.interval == {"a": (0.0, 1.0), "b": (0.0, 1.0)}


def test_a_log_window_gives_an_interval_symmetric_in_the_logarithm():
    space = Space({"damping": Window(1e-3, 1e-1, "log")})
    rng = np.random.default_rng(8)
    noise = white(rng)
    c = local(linear(3.0 * np.sin(TIME)[:, None], np.array([0.5]), noise), space, np.array([0.5]))
    low, high = c.interval["damping"]
    assert low * high == pytest.approx(1e-2**2)
    assert c.standard_error["damping"] == pytest.approx(np.log(high / low) / 4.0 * 1e-2, rel=0.02)


def test_a_parameter_at_its_edge_is_said_and_judged_from_inside():
    rng = np.random.default_rng(9)
    matrix, noise = waves(rng, 2), 0.1 * white(rng)
    asked = []

    def evaluate(points):
        asked.extend(points)
        return [outcome(matrix @ (u - [-0.05, 0.5]) + noise) for u in points]

    c = local(evaluate, cube("a", "b"), np.array([0.0, 0.5]))
    assert c.at_edge == {"a": "low"}
    assert c.interval["a"][0] == 0.0
    assert np.min(asked) >= 0.0


def test_a_search_that_stopped_early_widens_its_interval_by_the_distance_to_the_minimum_and_says_so():
    rng = np.random.default_rng(10)
    matrix, noise = waves(rng, 2), 0.1 * white(rng)
    evaluate, minimum = linear(matrix, np.full(2, 0.5), noise), 0.5 - np.linalg.lstsq(matrix, noise, rcond=None)[0]
    there = local(evaluate, cube("a", "b"), minimum)
    c = local(evaluate, cube("a", "b"), minimum - [0.05, 0.0])
    assert c.reason == (
        "the search ended before the best value of a was reached; the intervals were widened by the distance to it"
    )
    assert c.interval["a"][1] > 0.5
    assert 0.05 < c.standard_error["a"] < 0.06  # the error by the residuals is added in quadrature
    assert (there.reason, there.standard_error["a"] < 0.01) == ("", True)


def test_a_search_that_stopped_where_the_slopes_mislead_has_no_intervals():
    rng = np.random.default_rng(10)
    matrix, noise = waves(rng, 2), 0.1 * white(rng)
    minimum = 0.5 - np.linalg.lstsq(matrix, noise, rcond=None)[0]

    def bent(points):
        """Linear about the end of the search; nearer to the minimum the residuals grow."""
        return [outcome(matrix @ (u - 0.5) + noise + 50.0 * max(u[0] - minimum[0] + 0.03, 0.0)) for u in points]

    c = local(bent, cube("a", "b"), minimum - [0.05, 0.0])
    assert (c.status, c.interval, c.standard_error) == ("not available", {}, {})
    assert c.reason.startswith(
        "the search did not end at a minimum: the residuals still fall towards another value of a, and there they come "
    )
    assert c.linearised is not None  # profiles begin with a fit from there


@pytest.mark.parametrize("bad", [{"status": "timeout"}, {"kind": "period 2"}])
def test_a_search_that_stopped_short_of_what_cannot_be_compared_has_no_intervals(bad):
    rng = np.random.default_rng(10)
    matrix, noise = waves(rng, 2), 0.1 * white(rng)

    def evaluate(points):
        return [outcome(matrix @ (u - 0.5) + noise, **(bad if u[0] > 0.48 else {})) for u in points]

    c = local(evaluate, cube("a", "b"), np.array([0.45, 0.5]))
    assert c.status == "not available"
    assert "the simulation that they lead to cannot be compared: its" in c.reason


def test_the_minimum_is_sought_in_the_window():
    jacobian, residuals = np.array([[1.0, 1.0], [0.0, 1.0], [0.0, 0.0]]), np.array([1.0, 0.2, 5.0])
    step = distance_to_minimum(jacobian, residuals, np.array([0.3, 0.5]))  # free of bounds: (-0.8, -0.2)
    assert step == pytest.approx([-0.3, -0.45])
    assert distance_to_minimum(jacobian, residuals, np.array([0.0, 0.05])) == pytest.approx([0.0, -0.05])
    assert distance_to_minimum(np.zeros((3, 2)), residuals, np.full(2, 0.5)) == pytest.approx([0.0, 0.0])


@pytest.mark.parametrize("bad", [{"status": "timeout"}, {"kind": "period 2"}])
def test_one_failing_side_is_replaced_by_the_other(bad):
    rng = np.random.default_rng(11)
    matrix, noise = waves(rng, 2), white(rng)

    def evaluate(points):
        return [outcome(matrix @ (u - 0.5) + noise, **(bad if u[0] > 0.5 else {})) for u in points]

    assert local(evaluate, cube("a", "b"), np.full(2, 0.5)).status == "ok"


def test_failing_neighbours_give_a_reason_and_no_numbers():
    rng = np.random.default_rng(12)
    matrix, noise = waves(rng, 2), white(rng)

    def evaluate(points):
        return [outcome(matrix @ (u - 0.5) + noise, kind="period 1" if u[1] == 0.5 else "irregular") for u in points]

    c = local(evaluate, cube("a", "b"), np.full(2, 0.5))
    assert c.status == "not available"
    assert "b" in c.reason
    assert "irregular, not period 1" in c.reason
    assert c.standard_error == {}
    assert c.summary().interval == {}


def test_a_failed_best_point_gives_a_reason():
    c = local(lambda points: [outcome(None, status="diverged")], cube("a"), np.array([0.5]))
    assert c.status == "not available"
    assert "diverged" in c.reason


def test_residuals_that_are_not_differentiable_give_no_intervals():
    def evaluate(points):
        return [outcome(np.random.default_rng(u.view(np.uint64)).standard_normal(50)) for u in points]

    c = local(evaluate, cube("a"), np.array([0.3]))
    assert c.status == "not available"
    assert "not differentiable" in c.reason


def test_a_smooth_curvature_does_not_disturb():
    rng = np.random.default_rng(13)
    slope = 0.1 * TIME * np.cos(TIME)
    noise = 0.02 * rng.standard_normal(TIME.size)
    noise -= slope * (slope @ noise) / (slope @ slope)  # the point is the minimum

    def evaluate(points):
        return [outcome(np.sin((1.0 + 0.1 * (u[0] - 0.5)) * TIME) - np.sin(TIME) + noise) for u in points]

    c = local(evaluate, cube("frequency"), np.array([0.5]), outcome=evaluate([[0.5]])[0])
    assert c.standard_error["frequency"] == pytest.approx(0.02 / np.linalg.norm(slope), rel=0.3)
    assert c.evaluations <= 6


@pytest.mark.parametrize(
    ("shifts", "text"),
    [((0.7, 0.7), "a / b"), ((0.7, -0.7), "a * b"), ((0.9, 0.45), "a / b^2"), ((0.3, 0.6), "b / a^2")],
)
def test_a_combination_of_log_parameters_is_a_product_of_powers(shifts, text):
    windows = (Window(0.1, 10.0, "log"), Window(1.0, 100.0, "log"))
    assert combination(("a", "b"), windows, (0.5, 0.5), shifts) == text


def test_a_wrong_number_of_blocks_is_refused():
    with pytest.raises(CalibError, match="one block number per residual"):
        local(linear(np.ones((20, 1)), 0.5, np.ones(20)), cube("a"), np.array([0.5]), blocks=np.zeros(3))


@pytest.mark.parametrize("records", [3, 6, 10])
def test_the_noise_of_one_feature_is_not_taken_for_that_of_another(records):
    """Two features of one number a record, one of them a hundred times as noisy as the other."""
    matrix = np.kron(np.eye(2), np.ones((records, 1)))
    level, blocks = np.repeat([0.001, 0.1], records), np.repeat([0, 1], records)
    rng, squares, held = np.random.default_rng(records), [], []
    for _ in range(200):
        noise = level * rng.standard_normal(2 * records)
        step = np.linalg.lstsq(matrix, noise, rcond=None)[0]
        covariance, freedom = sandwich(matrix, noise - matrix @ step, blocks)
        squares.append(np.diag(covariance))
        held.append(np.abs(step) <= stats.t.isf(0.025, freedom) * np.sqrt(squares[-1]))
    assert np.sqrt(np.mean(squares, axis=0)) == pytest.approx(level[[0, -1]] / np.sqrt(records), rel=0.25)
    assert np.mean(held) > 0.9
