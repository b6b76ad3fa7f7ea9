"""The best pair of causes, in a small model whose effects are known."""

from types import SimpleNamespace

import numpy as np
import pytest
from straight_line import MODEL, START, TIME, TRUE, WINDOWS, Evidence, straight

from calib.diagnosis.bench import SimulatedRows
from calib.diagnosis.candidate import Candidate
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.excess import significant
from calib.diagnosis.refit import Fitter
from calib.diagnosis.replacement import _Linear, best_pair, is_pair_significant
from calib.diagnosis.screening import screened
from calib.diagnosis.signature import Point
from calib.execution.pool import InProcess
from calib.modelling.parameter import Parameter, Space

WAVE, DIP = np.sin(3.0 * TIME), np.exp(-((TIME - 2.0) ** 2))
HIDDEN = 40.0 * WAVE + 25.0 * DIP
MIX = (HIDDEN + 0.7 * np.sin(40.0 * TIME)) / 40.0  # imitates both
NAMES = ("wave", "dip", "soft", "step", "mix", "twin")


def effect(name):
    parameters = [Parameter(name, "1", 0.0, "", null=0.0)]
    return SimpleNamespace(
        name=name, null={name: 0.0}, parameters=parameters, differentiable=True, guess=None, generalises=()
    )


CANDIDATES = [Candidate(effect(name), (name,), {}, {name: 100.0}) for name in NAMES[:4]]


def simulate(run):
    """A line, with the effects beside it; `soft` begins like all that is hidden, and goes no further than 1 % of it."""
    size = {name: run.values.get(name, 0.0) for name in NAMES}
    rows = straight(run.values) + size["wave"] * WAVE + (size["dip"] + size["twin"]) * DIP + size["mix"] * MIX
    rows = rows + size["step"] * (TIME > 1.0)
    return SimulatedRows((rows + HIDDEN * 0.01 * np.tanh(size["soft"]))[None], np.ones(TIME.size))


class InSegments(Evidence):
    """With segments of the record, for score tests."""

    def segments(self):
        return np.arange(self.measured.size) // 40


def test_the_best_pair_is_found_though_another_is_predicted_to_explain_more():
    """With `soft` any pair is predicted to explain all; of those that act alike beside it one is fitted."""
    measured = straight(TRUE) + HIDDEN + np.random.default_rng(0).standard_normal(TIME.size)
    fitter = Fitter(InProcess(simulate), InSegments(measured), Space(WINDOWS), MODEL)
    seen = {"record": SimulatedRows(straight(START)[None], np.ones(TIME.size))}
    null = fitter.fit(Point(START, (), seen))
    twin = Candidate(effect("twin"), ("twin",), {}, {"twin": 100.0})
    suspects, _ = screened(fitter, null, [*CANDIDATES, twin], 0)
    assert max(suspects, key=lambda s: s.predicted_reduction).name == "soft"
    fitted, fit = [], fitter.fit

    def noted(start, candidates=(), sizes=None, **options):
        fitted.append({candidate.name for candidate in candidates})
        return fit(start, candidates, sizes, **options)

    fitter.fit = noted
    causes, final = best_pair(fitter, null, (), null, suspects)
    assert {cause.name for cause, _ in causes} in ({"wave", "dip"}, {"wave", "twin"})
    assert [final.value(cause.name) for cause, _ in causes if cause.name == "wave"] == pytest.approx([40.0], abs=1.0)
    assert {"soft", "dip"} not in fitted or {"soft", "twin"} not in fitted


@pytest.mark.parametrize(("hidden", "shows"), [(HIDDEN, True), (40.0 * MIX, False)])
def test_a_cause_that_imitates_two_is_seen_through_by_a_test_of_two_where_no_sum_of_squares_shows_it(hidden, shows):
    measured = straight(TRUE) + hidden + np.random.default_rng(1).standard_normal(TIME.size)
    fitter = Fitter(InProcess(simulate), InSegments(measured), Space(WINDOWS), MODEL)
    seen = {"record": SimulatedRows(straight(START)[None], np.ones(TIME.size))}
    null, mix, known = fitter.fit(Point(START, (), seen)), Candidate(effect("mix"), ("mix",), {}, {"mix": 100.0}), {}
    suspects, _ = screened(fitter, null, [mix, *CANDIDATES], 0, known)
    final = fitter.with_derivatives(fitter.fit(null.point, [mix], {"mix": 40.0}))
    assert not significant(final.chi2 - TIME.size, np.sqrt(2.0 * TIME.size))
    [own] = [suspect for suspect in suspects if suspect.name == "mix"]
    cause = own.refitted(final, null.chi2 - final.chi2)
    known = {key: value for key, value in known.items() if key != id(CANDIDATES[2])}  # `soft` is all that is hidden
    assert is_pair_significant(null, [(cause, (cause,))], final, [mix, *CANDIDATES], known) == shows


def noise_of(squares):
    """Stand in for a calibrated model without parameters that leaves residuals of these squares."""
    residual = np.sqrt(squares)
    none = np.zeros((residual.size, 0))
    return SimpleNamespace(
        names=(), columns=none, nuisances=none, residual=residual, chi2=residual @ residual, point=Point({}, (), {})
    )


@pytest.mark.parametrize(("share", "significant"), [(0.99, False), (1.01, True)])
def test_the_best_of_many_pairs_has_to_explain_more_than_the_best_would_by_chance(share, significant):
    """Of ten orthogonal candidates there are 45 pairs: the probability of each is divided among them (Bonferroni)."""
    number = 10
    candidates = [SimpleNamespace(name=f"c{k}", free=("size",), sign=0) for k in range(number)]
    known = {id(c): SimpleNamespace(columns=np.eye(number)[:, [k]]) for k, c in enumerate(candidates)}
    limit = -2.0 * np.log((1.0 - CRITERIA.confidence_level) / 45)  # chi-square of two degrees of freedom: exponential
    final = noise_of([0.5 * share * limit] * number)
    assert is_pair_significant(SimpleNamespace(names=()), (), final, candidates, known) == significant


@pytest.mark.parametrize(("reduction", "predicted"), [(3.9, 0), (4.1, 1)])
def test_a_pair_has_to_lower_akaike_s_criterion(reduction, predicted):
    candidates = [SimpleNamespace(name=name, sign=0) for name in ("one", "other")]
    pairs = _Linear.without_causes(SimpleNamespace(names=()), (), noise_of([0.5 * reduction] * 2)).pairs(
        candidates, [np.eye(2)[:, :1], np.eye(2)[:, 1:]]
    )
    assert [explained for explained, _ in pairs] == pytest.approx([reduction] * predicted)


def test_a_cause_that_is_absent_at_infinity_stays_in_what_is_predicted_without_causes():
    """A clipped channel: no finite step takes the limit away."""
    columns, residual = np.eye(4)[:, :2], np.arange(4.0)
    final = SimpleNamespace(
        names=("damping", "limit"), value={"damping": 0.1, "limit": 0.7}.get, columns=columns, residual=residual,
        nuisances=np.zeros((4, 0)), point=Point({"damping": 0.1, "limit": 0.7}, (), {}),
    )  # fmt: skip
    clipping = SimpleNamespace(candidate=SimpleNamespace(absent=lambda: {"limit": np.inf}))
    about = _Linear.without_causes(SimpleNamespace(names=("damping",)), [(clipping, ())], final)
    np.testing.assert_array_equal(about.residual, residual)
    assert about.rest == {"damping": 0.1}
