"""Claims about profiles of the likelihood, on problems whose profiles are known in closed form."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import brentq

from calib.confidence.likelihood import LEVEL
from calib.confidence.local import local
from calib.confidence.notes import PointNotes
from calib.confidence.profile import CROSSED, JUMP, NO_MOTION, WINDOW_END
from calib.confidence.profiles import LocalAnalysis, profiles
from calib.confidence.serialise import confidence_result
from calib.errors import CalibError
from calib.modelling.parameter import Space, Window

TIME = np.linspace(0.0, 40.0, 400)
NAMES = "abcd"


class Problem:
    """Residuals of points in the unit cube, counted.

    Parameters
    ----------
    residuals : of a point (dim,) -> (m,), or None where the simulation fails
    kind : of a point -> kind of the motion
    """

    def __init__(self, residuals, dim, kind=lambda u: "period-1"):
        self.residuals, self.kind, self.number = residuals, kind, 0
        self.space = Space({name: Window(0.0, 1.0) for name in NAMES[:dim]})

    def outcome(self, u):
        residuals = self.residuals(u)
        if residuals is None:
            return SimpleNamespace(cost=math.inf, residuals=None, status="diverged", kind=None)
        wrong = self.kind(u) == "chaotic"
        return SimpleNamespace(
            cost=10.0 * wrong + float(np.linalg.norm(residuals)), residuals=residuals, status="ok", kind=self.kind(u)
        )

    def __call__(self, points):
        self.number += len(points)
        return [self.outcome(u) for u in points]

    def analyse(self, u):
        outcome = self.outcome(u)
        return LocalAnalysis(outcome, local(self, self.space, u, outcome=outcome))

    def profiles(self, u, notes=None, **more):
        notes = Notes() if notes is None else notes
        return profiles(self, self.analyse, self.space.names, np.array(u, dtype=float), notes, **more)

    def result(self, found):
        return confidence_result("test", self.space, dict.fromkeys(self.space.names, "1"), found, 0, 0.0)


class Notes(dict):
    """Points in memory; interrupted by Ctrl-C once there are `most` of them."""

    most = math.inf

    def add(self, key, point):
        if len(self) >= self.most:
            raise KeyboardInterrupt
        self[key] = point


def noise(seed, memory=0.0):
    kicks = 0.1 * np.random.default_rng(seed).standard_normal(TIME.size)
    for k in range(1, kicks.size):
        kicks[k] += memory * kicks[k - 1]
    return kicks


def linear(seed=0, memory=0.0, dim=3, size=2.0):
    mixed = np.eye(dim) + 0.4
    matrix = size * np.column_stack([np.sin((k + 1) * TIME + k) for k in range(dim)]) @ mixed
    own = noise(seed, memory)
    return Problem(lambda u: matrix @ (u - 0.5) + own, dim), matrix, own


def banana(width=1.0, bend=3.0):
    """Rosenbrock's valley over [-2, 2] x [-2, 6]; sum of squares 10 width^2 (1-x)^2 + 10 bend^2 (y-x^2)^2 + noise."""
    rng = np.random.default_rng(1)
    own = rng.standard_normal(60)
    own[:10] -= own[:10].mean()
    own[10:20] -= own[10:20].mean()

    def residuals(u):
        x, y = 4.0 * u[0] - 2.0, 8.0 * u[1] - 2.0
        signal = np.zeros(60)
        signal[:10], signal[10:20] = width * (1.0 - x), bend * (y - x**2)
        return own + signal

    return Problem(residuals, 2)


@pytest.mark.parametrize("memory", [0.0, 0.8])
def test_a_parabolic_profile_gives_the_local_interval(memory):
    problem, matrix, own = linear(memory=memory)
    best = 0.5 - np.linalg.lstsq(matrix, own, rcond=None)[0]
    found = problem.profiles(best)
    for profile in problem.result(found).profiles:
        assert (profile.low.value, profile.high.value) == pytest.approx(
            found.analysis.confidence.interval[profile.name], rel=1e-3
        )
        assert {profile.low.cause, profile.high.cause} == {CROSSED}
        assert profile.text.startswith("as the local interval")


def test_the_search_is_finished_before_profiles_begin():
    problem, matrix, own = linear()
    best = 0.5 - np.linalg.lstsq(matrix, own, rcond=None)[0]
    found = problem.profiles(best + 0.02)
    assert found.centre.u == pytest.approx(best, abs=1e-4)
    assert any("not quite the best" in remark for remark in problem.result(found).remarks)


def test_profiles_of_a_curved_valley_are_those_known():
    width, bend = 1.0, 3.0
    problem = banana(width, bend)
    found = problem.profiles([0.75, 0.375])
    likelihood, (of_x, of_y) = found.centre.likelihood, problem.result(found).profiles
    limit_x = likelihood.quantile([0]) / likelihood.factor([0], np.ones(1))  # of the excess of the sum of squares
    limit_y = likelihood.quantile([1]) / likelihood.factor([1], np.ones(1))

    def excess(y):
        x = np.linspace(-2.0, 2.0, 40001)
        return np.min(10.0 * width**2 * (1.0 - x) ** 2 + 10.0 * bend**2 * (y - x**2) ** 2) - limit_y

    half = math.sqrt(limit_x / (10.0 * width**2))
    ends_x = np.array([of_x.low.value, of_x.high.value]) * 4.0 - 2.0
    ends_y = np.array([of_y.low.value, of_y.high.value]) * 8.0 - 2.0
    known = np.array([brentq(excess, -1.9, 1.0), brentq(excess, 1.0, 5.9)])
    assert ends_x == pytest.approx([1.0 - half, 1.0 + half], abs=0.01 * 2.0 * half)
    assert ends_y == pytest.approx(known, abs=0.01 * (known[1] - known[0]))
    assert "curvature" in of_y.text
    for point in of_x.points:  # not only the ends: the whole profile
        exact = 10.0 * width**2 * (1.0 - (4.0 * point.value - 2.0)) ** 2 * likelihood.factor([0], np.ones(1))
        assert point.ratio == pytest.approx(exact, rel=0.01, abs=0.01)


def test_an_interval_on_a_logarithmic_window_is_compared_on_that_scale():
    problem = banana(1.0, 3.0)
    found = problem.profiles([0.75, 0.375])
    assert "logarithmic" not in problem.result(found).profiles[1].text
    problem.space = Space({"a": Window(0.0, 1.0), "b": Window(0.001, 0.1, "log")})
    profile = problem.result(found).profiles[1]
    low, high = profile.local
    reach = math.log(profile.high.value / profile.value) / math.log(high / profile.value)
    assert f"{reach:.3g} times as far above" in profile.text
    assert "on the logarithmic scale of the window" in profile.text


def test_an_interval_that_never_ends_is_open():
    problem, _, own = linear(dim=2)
    problem.residuals = lambda u: own + np.sin(TIME) * (u[0] - 0.5) + 0.01 * np.cos(TIME) * (u[1] - 0.5)
    found = problem.profiles([0.5, 0.5])
    narrow, wide = problem.result(found).profiles
    assert (narrow.low.cause, narrow.high.cause) == (CROSSED, CROSSED)
    assert (wide.low.cause, wide.high.cause) == (WINDOW_END, WINDOW_END)
    assert (wide.low.value, wide.high.value) == (0.0, 1.0)
    assert wide.low.text.startswith("open")
    assert "open" in wide.text


def test_a_value_at_the_end_of_its_window_has_one_side():
    _, matrix, own = linear(dim=2)
    problem = Problem(lambda u: own + matrix @ (u - [-0.02, 0.5]), 2)
    low, high = problem.profiles([0.0, 0.5]).ends["a"]
    assert (low.cause, high.cause) == (WINDOW_END, CROSSED)
    assert low.distance == pytest.approx(0.0, abs=1e-8)
    assert high.distance > 0.0


@pytest.mark.parametrize("fault", ["fails", "chaotic"])
def test_an_interval_ends_where_no_motion_can_be_compared(fault):
    problem, matrix, own = linear()
    best = 0.5 - np.linalg.lstsq(matrix, own, rcond=None)[0]
    edge = best[0] + 0.5 * 2.0 * problem.profiles(best).centre.likelihood.standard_error[0]
    if fault == "fails":
        broken = Problem(lambda u: None if u[0] > edge else matrix @ (u - 0.5) + own, 3)
    else:
        broken = Problem(problem.residuals, 3, lambda u: "chaotic" if u[0] > edge else "period-1")
    found = broken.profiles(best)
    profile = broken.result(found).profiles[0]
    assert profile.high.cause == NO_MOTION
    assert profile.high.value == pytest.approx(edge, abs=0.01 * (profile.high.value - profile.low.value))
    assert ("diverged" if fault == "fails" else "chaotic") in profile.high.text
    assert profile.low.cause == CROSSED
    assert any("could not be compared" in remark for remark in broken.result(found).remarks)


def test_a_profile_goes_on_through_a_change_of_the_kind_of_motion():
    problem, matrix, own = linear()
    best = 0.5 - np.linalg.lstsq(matrix, own, rcond=None)[0]
    smooth = problem.profiles(best)
    edge = best[0] + 0.5 * smooth.ends["a"][1].distance
    changing = Problem(problem.residuals, 3, lambda u: "period-2" if u[0] > edge else "period-1")
    found = changing.profiles(best)
    profile = changing.result(found).profiles[0]
    assert profile.high.cause == CROSSED
    assert found.ends["a"][1].distance == pytest.approx(smooth.ends["a"][1].distance, rel=1e-3)
    assert "the kind of motion changes at about" in profile.text


def test_a_jump_of_the_likelihood_ends_the_interval():
    problem, matrix, own = linear()
    best = 0.5 - np.linalg.lstsq(matrix, own, rcond=None)[0]
    edge = best[0] + 0.5 * problem.profiles(best).ends["a"][1].distance
    jumping = Problem(
        lambda u: matrix @ (u - 0.5) + own + (0.2 * np.cos(9.0 * TIME) if u[0] > edge else 0.0),
        3, lambda u: "period-2" if u[0] > edge else "period-1",
    )  # fmt: skip
    found = jumping.profiles(best)
    profile = jumping.result(found).profiles[0]
    assert profile.high.cause == JUMP
    assert profile.high.value == pytest.approx(edge, abs=0.01 * (profile.high.value - profile.low.value))
    assert "period-1 to period-2" in profile.high.text


def test_profiles_begin_again_from_a_better_point_that_they_meet():
    """Two minima behind a low hill; the search has ended in the worse one."""
    own = noise(0)

    def two_minima(u):
        x = (u[0] - 0.5) / 0.15
        return own + np.sin(TIME) * 0.01 * (x**2 - 1.0) + np.cos(TIME) * 0.004 * (x - 1.0)

    problem = Problem(two_minima, 1)
    grid = np.linspace(0.2, 0.8, 601)
    squares = np.array([np.sum(two_minima([x]) ** 2) for x in grid])
    left, right = (part[squares[part].argmin()] for part in (np.arange(300), np.arange(300, 601)))
    worse = left if squares[left] > squares[right] else right
    assert squares[worse] > squares.min() + 0.002
    found = problem.profiles([grid[worse]])
    assert found.improved
    assert found.centre.u[0] == pytest.approx(grid[np.argmin(squares)], abs=1e-2)
    assert any("better point" in remark for remark in problem.result(found).remarks)


def test_residuals_without_derivatives_are_profiled_too():
    problem, matrix, own = linear(dim=2)
    smooth = problem.profiles([0.5, 0.5])
    rough = Problem(lambda u: matrix @ (u + 0.004 * np.sin(9e4 * u) - 0.5) + own, 2)
    found = rough.profiles([0.5, 0.5])
    result = rough.result(found)
    assert not found.centre.likelihood.differentiable
    assert "have no derivatives" in result.noise
    for name, (low, high) in found.ends.items():
        assert low.distance + high.distance >= 0.7 * sum(end.distance for end in smooth.ends[name])
        assert result.profiles[0].local is None


def test_a_pair_of_parameters_has_the_ratio_of_its_covariance():
    problem, matrix, own = linear()
    best = 0.5 - np.linalg.lstsq(matrix, own, rcond=None)[0]
    found = problem.profiles(best, pairs=[("a", "c")])
    [(pair, points)] = found.pairs
    covariance = found.centre.likelihood.covariance[np.ix_([0, 2], [0, 2])]
    assert len(points) == 81
    for (i, j), point in points.items():
        shift = np.array(point.u)[[0, 2]] - found.centre.u[[0, 2]]
        assert pair.ratio((i, j), point) == pytest.approx(
            shift @ np.linalg.solve(covariance, shift), rel=1e-2, abs=1e-2
        )
    [document] = problem.result(found).pairs
    assert document.quantile == pytest.approx(6.18, rel=0.02)  # of chi-square with two degrees of freedom, at the level
    assert pytest.approx(0.9545, abs=1e-4) == LEVEL


def test_progress_counts_evaluations_of_finished_points_and_ends_at_what_it_foresees():
    problem, told = banana(), []
    found = problem.profiles(
        [0.75, 0.375], pairs=[("a", "b")], on_progress=lambda done, foreseen: told.append((done, foreseen))
    )
    done = [one for one, _ in told]
    points = [point for both in found.points.values() for own in both for point in own]
    nodes = [point for grid in found.pairs for node, point in grid[1].items() if node != (0, 0)]
    assert done == sorted(done)
    assert told[-1] == (sum(point.evaluations for point in (*points, *nodes)),) * 2
    middle = [foreseen for one, foreseen in told if one >= 0.1 * done[-1]]
    assert 0.5 * done[-1] < min(middle) < max(middle) < 2.0 * done[-1]


@pytest.mark.parametrize("most", [0, 1, 4, 11, 40])
def test_an_interrupted_run_ends_in_the_same_numbers(most):
    problem = banana()
    whole, notes = problem.profiles([0.75, 0.375], pairs=[("a", "b")]), Notes()
    needed, problem.number, notes.most = problem.number, 0, most
    with pytest.raises(KeyboardInterrupt):
        problem.profiles([0.75, 0.375], notes, pairs=[("a", "b")])
    notes.most, problem.number = math.inf, 0
    again = problem.profiles([0.75, 0.375], notes, pairs=[("a", "b")])
    assert problem.result(again) == problem.result(whole)
    assert most < 2 or problem.number < needed


def test_notes_survive_a_torn_line_and_forget_points_of_something_else(tmp_path):
    problem, path = banana(), tmp_path / "confidence.jsonl"
    with PointNotes(path, ["this"]) as notes:
        whole = problem.profiles([0.75, 0.375], notes)
        kept, evaluations = notes.known, notes.evaluations
    assert kept == 0
    text = path.read_bytes()
    path.write_bytes(text[:-30])
    with PointNotes(path, ["this"]) as notes:
        assert notes.known == text.count(b"\n") - 2
        assert problem.result(problem.profiles([0.75, 0.375], notes)) == problem.result(whole)
        assert notes.evaluations == evaluations
    assert path.read_bytes().count(b"\n") == text.count(b"\n")
    with PointNotes(path, ["that"]) as notes:
        assert notes.known == 0


def test_a_damaged_line_of_notes_is_named(tmp_path):
    path = tmp_path / "confidence.jsonl"
    with PointNotes(path, ["this"]) as notes:
        banana().profiles([0.75, 0.375], notes)
    lines = path.read_bytes().splitlines(keepends=True)
    lines[2] = lines[2].replace(b"0.", b"1.", 1)
    path.write_bytes(b"".join(lines))
    with pytest.raises(CalibError, match=r"line 3 is damaged .*--fresh"):
        PointNotes(path, ["this"])


def test_a_best_point_that_fails_is_refused():
    problem = Problem(lambda u: None, 2)
    with pytest.raises(CalibError, match="cannot be evaluated .*diverged"):
        problem.profiles([0.5, 0.5])
