"""Which explanations are distinguishable."""

from types import SimpleNamespace

import numpy as np
import pytest
from in_turn import InTurn

from calib.diagnosis.rivals import (
    chi2_of_another_rival,
    not_refuted,
    rival_suspects,
    special_cases,
    with_possible_causes,
    within_reach,
)
from calib.diagnosis.search import _refits, _refits_from_the_middle, _similar_to_the_best

SIZE, LIMIT = 1000.0, 3.4
EVIDENCE = SimpleNamespace(parts=(), counted=lambda: SIZE)


def suspect(name, parameters, reduction, chi2, generalises=(), most=4):
    """Stand in for a suspect that reduces chi-square by `reduction` to `chi2`, of at most so many parameters."""
    fit = SimpleNamespace(
        chi2=chi2,
        columns=np.zeros((0, 0)),
        nuisances=np.zeros((0, 0)),
        residual=np.zeros(0),
        point=SimpleNamespace(simulated={}),
    )
    penalty = 2.0 * parameters
    return SimpleNamespace(
        name=name, parameter_count=parameters, aic_penalty=penalty, chi2_reduction=reduction, fit=fit,
        generalises=generalises, candidate=SimpleNamespace(max_parameter_count=most),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("parameters", "behind", "left", "alike"),
    [
        (2, 5.0, SIZE, True),
        (2, 7.0, SIZE, False),  # two models of one size, as far apart as data have to tell them
        (1, 11.0, SIZE, True),  # the best has a parameter more, which is below the threshold: 3.4^2
        (1, 12.0, SIZE, False),
        (3, 3.0, SIZE, True),
        (3, 5.0, SIZE, False),
        (2, 50.0, 10.0 * SIZE, True),  # where much is left that nothing explains
        (1, 110.0, 10.0 * SIZE, True),
    ],
)
def test_a_rival_is_alike_within_what_its_parameters_and_the_noise_allow(parameters, behind, left, alike):
    best, other = suspect("best", 2, 200.0, left), suspect("other", parameters, 200.0 - behind, left)
    assert [s.name for s in rival_suspects(EVIDENCE, [other, best], LIMIT)] == ["best", "other"][: 1 + alike]


@pytest.mark.parametrize(
    ("parameters", "behind", "names"),
    [
        (4, 5.8, ["simple"]),  # 5.99: 95 % of two degrees of freedom
        (4, 6.2, ["general", "simple"]),  # it may be either
        (4, 15.0, ["general"]),
        (1, -1.0, ["simple"]),  # whether its form is fitted or not
    ],
)
def test_a_law_that_explains_no_more_than_its_special_case_is_no_rival_of_it(parameters, behind, names):
    general = suspect("general", parameters, 200.0, SIZE, ("simple",))
    simple = suspect("simple", 2, 200.0 - behind, SIZE)
    assert [s.name for s in rival_suspects(EVIDENCE, [general, simple], LIMIT)] == names


def test_a_law_is_no_special_case_of_one_of_no_more_parameters():
    general, formed = suspect("general", 1, 198.0, SIZE, ("formed",)), suspect("formed", 4, 204.0, SIZE)
    assert [s.name for s in rival_suspects(EVIDENCE, [general, formed], LIMIT)] == ["general", "formed"]


def test_a_law_is_not_represented_by_a_special_case_that_is_left_out_itself():
    """A joint of sliders contains one yielding spring, and that Dahl's friction, which no joint of sliders contains."""
    sliders, spring = suspect("sliders", 1, 203.0, SIZE, ("spring",)), suspect("spring", 1, 201.0, SIZE, ("dahl",))
    rivals = rival_suspects(EVIDENCE, [sliders, spring, suspect("dahl", 1, 200.0, SIZE)], LIMIT)
    assert [s.name for s in rivals] == ["sliders", "dahl"]


def test_the_fit_of_a_form_has_to_make_a_rival():
    general, simple = suspect("general", 1, 198.0, SIZE, ("simple",)), suspect("simple", 2, 204.0, SIZE)
    other, unlike = suspect("other", 4, 204.0, SIZE, ("simple",)), suspect("unlike", 2, 204.0, SIZE)
    assert chi2_of_another_rival(EVIDENCE, [simple, other], general) == pytest.approx(SIZE - 5.99, abs=0.01)
    assert chi2_of_another_rival(EVIDENCE, [other], general) == SIZE + 6.0
    assert chi2_of_another_rival(EVIDENCE, [unlike], general) == SIZE + 2.0


def test_special_cases_of_a_rival_are_compared_with_it_however_far_behind_the_form_they_are_tried_with():
    """A law of three parameters of form fits better than its special case with a poor guess of its one."""
    general, other = suspect("general", 1, 200.0, SIZE, ("simple",)), suspect("other", 1, 190.0, SIZE)
    far, near = suspect("simple", 1, 20.0, SIZE, ("simplest",)), suspect("simple", 1, 120.0, SIZE, ("simplest",))
    simplest = suspect("simplest", 1, 15.0, SIZE)
    possible = [simplest, far, other, general, near]
    suspects = [*possible, suspect("impossible", 1, 0.0, SIZE, ("simplest",))]
    assert special_cases([general], possible, suspects) == [near, simplest]
    assert special_cases([general, near], possible, suspects) == [simplest]
    assert special_cases([other], possible, suspects) == []
    assert special_cases([suspect("most general", 1, 210.0, SIZE, ("impossible",))], possible, suspects) == [simplest]


@pytest.mark.parametrize(("behind", "kept"), [(5.8, True), (6.2, False)])  # 5.99: 95 % of two degrees of freedom
def test_a_special_case_is_a_rival_where_the_further_parameters_of_the_general_law_may_be_absent(behind, kept):
    general, simple = suspect("general", 4, 200.0, SIZE, ("simple",)), suspect("simple", 2, 200.0 - behind, SIZE)
    assert not_refuted(EVIDENCE, [suspect("worse", 1, 150.0, SIZE), general], [simple]) == [simple] * kept


def fitted(name, reduction, *residual):
    """Stand in for a refitted suspect, whose fit leaves this beside the noise in directions that are told apart."""
    whole = np.array([np.sqrt(SIZE), *residual, *[0.0] * (3 - len(residual))])
    found = suspect(name, 1, reduction, float(whole @ whole))
    found.fit.residual = whole
    return found


@pytest.mark.parametrize(
    ("remainder", "reduction", "alike"),
    [
        ((25.0, 20.0), 0.99, True),  # of what is left a small part is like what tells them apart
        ((0.0, 28.0), 0.99, False),  # all of it would have to be
        ((25.0, 20.0), 0.4, False),  # it explains too little to be what the best stands for
    ],
)
def test_where_more_than_noise_is_left_a_suspect_may_be_behind_for_that(remainder, reduction, alike):
    """The best takes 20 of what the other leaves, which is the cause."""
    best = fitted("best", 5000.0, remainder[0], remainder[1] - 20.0, 16.0)
    other = fitted("other", 5000.0 * reduction, *remainder, 16.0)
    found = with_possible_causes(EVIDENCE, (best,), [other, best])
    assert [s.name for s in found] == ["best", "other"][: 1 + alike]


def test_where_noise_is_left_no_suspect_is_behind_for_anything_else():
    best, other = fitted("best", 500.0, 5.0), fitted("other", 490.0, 5.0, 4.0)
    assert with_possible_causes(EVIDENCE, (best,), [other]) == (best,)
    assert with_possible_causes(EVIDENCE, (), [other]) == ()


@pytest.mark.parametrize(
    ("behind", "remainder", "bounds", "in_reach"),
    [
        (180.0, 7.0, {"width": (1.0, 2.0)}, True),  # the best leaves 49 above noise, known to 3 * 44.7
        (190.0, 7.0, {"width": (1.0, 2.0)}, False),
        (130.0, 0.0, {"width": (1.0, 2.0)}, True),
        (140.0, 0.0, {"width": (1.0, 2.0)}, False),
        (24.0, 7.0, {}, False),
    ],
)
def test_a_suspect_is_in_reach_whose_gap_to_the_best_is_less_than_that_may_leave(behind, remainder, bounds, in_reach):
    best, other = fitted("best", 500.0, remainder), fitted("other", 500.0 - behind, 0.0)
    other.candidate = SimpleNamespace(bounds=bounds)
    assert within_reach(EVIDENCE, (best,), [best, other]) == [other] * in_reach


def scored(name, reduction, angle):
    """Stand in for a suspect with a score test, whose signature makes this angle with that of the first  [degrees]."""
    signature = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])[:, None]
    return SimpleNamespace(name=name, predicted_reduction=reduction, signature_columns=signature)


def test_what_is_much_similar_to_the_best_is_refitted_though_its_score_test_predicts_less():
    """Quadratic drag beside linear drag: 92 % by the score test, 99.7 % once it is fitted."""
    best = SimpleNamespace(**vars(scored("linear_drag", 97.0, 0.0)), fit=SimpleNamespace(chi2=3.0))
    worse = SimpleNamespace(**vars(scored("preload", 98.0, 17.0)), fit=SimpleNamespace(chi2=9.0))
    significant = [worse, best, scored("softening", 93.0, 25.0), scored("quadratic_drag", 92.0, 7.6)]
    assert [s.name for s in _similar_to_the_best(significant, [worse, best])] == ["quadratic_drag"]
    assert _similar_to_the_best(significant, []) == []


def test_the_fit_of_what_is_much_similar_to_the_best_is_not_given_up(monkeypatch):
    """A zero of the height beside a gap under a falling cube: both explain the same, by ways of different length."""
    rivals = {}

    def refitted(fitter, base, suspect, threshold, rival):
        rivals[suspect.name] = rival
        return SimpleNamespace(**vars(suspect), fit=SimpleNamespace(chi2=9.0 if suspect.name == "other" else 5.0))

    monkeypatch.setattr("calib.diagnosis.search._refitted", refitted)
    fitter = InTurn(effort=SimpleNamespace(suffices=lambda: True, spent=False))
    leaders = [scored("gap", 90.0, 0.0), scored("other", 80.0, 40.0), scored("zero", 70.0, 1.0)]
    done, untried = _refits(fitter, SimpleNamespace(residual=np.ones(2)), leaders, 3, LIMIT, np.inf)
    assert ([s.name for s in done], untried) == (["gap", "other", "zero"], ())
    assert rivals["other"] < np.inf == rivals["gap"] == rivals["zero"]


def test_suspects_are_fitted_from_the_middle_of_the_windows_too_and_the_better_fit_is_kept(monkeypatch):
    """Stand-ins: from the end of a window drag attains 100 and lag 150; from the middle 20 and 200, and friction 50."""

    def scored(name):
        found = SimpleNamespace(name=name, is_testable=name != "steps", candidate=candidates[name])
        found.derivatives = np.zeros((10, 1))
        found.refitted = lambda fit, drop: SimpleNamespace(
            name=name, candidate=candidates[name], fit=fit, chi2_reduction=drop
        )
        return found

    def fit(chi2):
        return SimpleNamespace(
            names=("damping",), chi2=chi2, residual=np.zeros(10), columns=np.zeros((10, 2)), point="middle"
        )

    def fitted(start, made, sizes, columns, rival):
        assert (start, columns.shape) == ("middle", (10, 3))
        return fit({"drag": 20.0, "lag": 200.0, "friction": 50.0, "offset": 1000.0}[sizes])

    candidates = {
        name: SimpleNamespace(absent=lambda name=name: name) for name in ("drag", "lag", "friction", "offset", "steps")
    }
    suspects, base = [scored(name) for name in candidates], fit(1000.0)
    before = [suspects[0].refitted(fit(100.0), 900.0), suspects[1].refitted(fit(150.0), 850.0)]
    monkeypatch.setattr("calib.diagnosis.search.screened", lambda *given: (suspects, 3.0))
    monkeypatch.setattr("calib.diagnosis.search.cosine", lambda *given: 0.0)
    effort = SimpleNamespace(suffices=lambda: True)
    fitter = InTurn(in_the_middle=lambda base: fit(5000.0), effort=effort, fit=fitted)
    given = (fitter, base, suspects, 0, 3.0, np.inf, before)
    found, untried = _refits_from_the_middle(*given)
    assert {s.name: s.chi2_reduction for s in found} == {"drag": 980.0, "lag": 850.0, "friction": 950.0}
    assert untried == ()
    fitter.attempt = lambda step: None  # where the budget is spent
    assert _refits_from_the_middle(*given) == (before, ())
    del fitter.attempt
    fitter.in_the_middle = lambda base: None  # where it cannot be simulated
    assert _refits_from_the_middle(*given) == (before, ())
