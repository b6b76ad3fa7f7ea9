"""Laws that generalise a cause, compared with it in the form that fits best."""

from dataclasses import replace
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest
from in_turn import InTurn

import calib.diagnosis.general_laws
from calib.diagnosis.candidate import Candidate
from calib.diagnosis.general_laws import with_general_laws
from calib.diagnosis.search import Round
from calib.diagnosis.signature import Point
from calib.diagnosis.stepwise import StepwiseState
from calib.diagnosis.suspect import Refitted, Scored, Untestable
from calib.effects.presliding import EFFECT as PRESLIDING
from calib.effects.stribeck import EFFECT as STRIBECK

NULL, OF_DAHL, LIMIT = 1100.0, 150.0, 3.0  # chi-square of 100 residuals; threshold of |z|
DIRECTIONS = count()
NEAR = replace(STRIBECK, special_cases={})  # comes near to Dahl's friction, as far as it is known
FORM = {"stribeck_distance": 1e-3, "stribeck_rise": 0.5, "stribeck_speed": 0.1}


def fit(chi2, **values):
    """Stand in for a fitted model, whose residual is unlike that of others."""
    point = Point(values, (), {})
    none = np.zeros((0, 0))
    return SimpleNamespace(
        chi2=chi2, chi2_over=lambda evidence: chi2, names=("damping",), point=point, candidates=(), columns=none,
        nuisances=none, reason="", residual=np.sqrt(chi2) * np.eye(100)[next(DIRECTIONS)],
    )  # fmt: skip


@pytest.fixture(autouse=True)
def judged(monkeypatch):
    """Judge a law in the cause's place as the test tells: why it would be no cause, "" at first."""
    reasons = [""]
    prediction = SimpleNamespace(prediction="of data to which it was not fitted")
    monkeypatch.setattr(calib.diagnosis.general_laws, "extension", lambda *model: prediction)
    monkeypatch.setattr(calib.diagnosis.general_laws, "rejection", lambda *model, further: reasons[-1])
    return reasons


def refitted(effect, chi2, held, form=()):
    """Suspect with which the model has this chi-square."""
    bounds = {name: (0.3 * value, 3.0 * value) for name, value in held.items()}
    candidate = Candidate(effect, (effect.parameters[0].name,), held, bounds=bounds, form=form)
    model = fit(chi2)
    model.candidates = (candidate,)
    return Refitted(candidate, Untestable(candidate, ""), model, NULL - chi2)


def at_half(suspect):
    """Suspect in twice the variance of the noise."""
    return replace(suspect, chi2_reduction=0.5 * suspect.chi2_reduction)


def scored(effect, chi2, held, bounds=None):
    """Suspect with another form, of which it is predicted that the model has this chi-square."""
    candidate = Candidate(effect, (effect.parameters[0].name,), held, bounds=bounds or {})
    return Scored(candidate, SimpleNamespace(chi2_reduction=0.5 * (NULL - chi2)), np.zeros(0), None, np.zeros(1))


def compared(of_guess, of_form, attempt=lambda step: step(), form_of_cause=1, others=(), law=NEAR, from_dahl=None):
    """Names of rivals, cause, state and bounds of fits, where Stribeck's friction has these chi-squares.

    of_guess : with the form that is tried; None where it was not refitted
    of_form, from_dahl : with its form fitted from there, and from where it is Dahl's
    """
    dahl = refitted(PRESLIDING, OF_DAHL, {"dahl_distance": 1e-3}, ("dahl_distance",) * form_of_cause)
    dahl.fit.point.values.update(dahl_force=0.2, dahl_distance=4e-3, damping=1.0)
    stribeck = refitted(law, of_guess or NULL, FORM)
    null, fits = fit(NULL), []
    then = *others, at_half(dahl), at_half(stribeck) if of_guess else scored(law, NULL, FORM, stribeck.candidate.bounds)
    of_then = Round(null, then, LIMIT, dahl, (dahl,), np.nan, chi2_of_null=0.5 * NULL)
    state = StepwiseState(null, dahl.fit, {}, (of_then,), ((dahl, (dahl,)),))

    def fitted(start, candidates, sizes=None, rival=np.inf):
        fits.append(rival)
        if sizes is None:
            return fit(of_form, **{name: 2.0 * value for name, value in FORM.items()})
        assert sizes == {"stribeck_force": 0.2, "stribeck_distance": 4e-3, "stribeck_rise": 0.0}
        assert start.values == {"damping": 1.0}
        assert [(c.name, c.form) for c in candidates] == [("stribeck", tuple(FORM))]
        return fit(from_dahl, **{name: 3.0 * value for name, value in FORM.items()})

    evidence = SimpleNamespace(parts=(), counted=lambda: 100.0, with_weights=lambda views: None)
    fitter = InTurn(evidence=evidence, fit=fitted, with_derivatives=lambda model: model, attempt=attempt)
    latest = with_general_laws(fitter, state)
    [(cause, rivals)] = latest.causes
    return [rival.name for rival in rivals], cause, latest, fits


@pytest.mark.parametrize(
    ("of_form", "names", "chosen"),
    [
        (143.0, ["presliding"], "presliding"),
        (137.0, ["stribeck", "presliding"], "presliding"),
        (110.0, ["stribeck"], "stribeck"),
    ],
)
def test_a_law_is_compared_with_its_special_case_in_the_form_that_fits_best(of_form, names, chosen):
    """Of two further parameters 5.99 is chance, in units of what Dahl's friction leaves."""
    found, cause, latest, [bound] = compared(300.0, of_form)
    assert (found, cause.name) == (names, chosen)
    assert bound == pytest.approx(OF_DAHL * (1.0 - 5.99 / 98.0), rel=0.01)
    if chosen == "stribeck":
        assert latest.final is cause.fit
        assert cause.candidate.held == {name: 2.0 * value for name, value in FORM.items()}
        last = latest.rounds[-1]
        assert last.chosen is last.suspects[0] is last.rivals[0]
        assert last.chosen.chi2_reduction == 0.5 * (NULL - of_form)  # in the noise of then
        assert last.prediction == "of data to which it was not fitted"


def test_a_law_that_would_be_no_cause_by_itself_does_not_take_its_place(judged):
    judged.append("it does not predict data to which it was not fitted")
    names, cause, latest, _ = compared(300.0, 110.0)
    assert (names, cause.name) == (["presliding"], "presliding")
    assert latest.rounds[-1].chosen.name == "presliding"


def test_forms_that_were_only_scored_are_no_leaders(judged):
    """Those of the law and of the cause, of which less is left than the refits have."""
    others = (
        scored(STRIBECK, 10.0, {**FORM, "stribeck_speed": 0.4}),
        scored(PRESLIDING, -2000.0, {"dahl_distance": 0.1}),
    )
    names, _, latest, _ = compared(300.0, 110.0, others=others)
    assert names == ["stribeck"]
    assert [s.name for s in latest.rounds[-1].suspects].count("stribeck") == 1


def test_a_law_that_explains_little_with_the_form_it_is_tried_with_is_out_of_reach():
    assert compared(700.0, 110.0)[3] == []


@pytest.mark.parametrize("of_guess", [700.0, None])
@pytest.mark.parametrize(("from_dahl", "names"), [(143.0, ["presliding"]), (110.0, ["stribeck"])])
def test_a_law_that_contains_the_cause_is_fitted_from_there_whatever_its_guess_explains(of_guess, from_dahl, names):
    """Of a poor guess the fit ends in another minimum, or there was none: from the cause it explains as much at least.

    Of that guess alone it would be out of reach.
    """
    found, cause, _, fits = compared(of_guess, 600.0, law=STRIBECK, from_dahl=from_dahl)
    assert found == [cause.name] == names
    assert len(fits) == (2 if of_guess else 1)
    if names == ["stribeck"]:
        assert cause.candidate.held == {name: 3.0 * value for name, value in FORM.items()}


@pytest.mark.parametrize(
    ("of_form", "names"), [(155.0, ["presliding", "stribeck"]), (165.0, ["presliding"]), (140.0, ["stribeck"])]
)
def test_a_law_of_no_more_parameters_than_the_cause_does_not_contain_it_and_is_judged_by_its_aic(of_form, names):
    """A joint of sliders beside one yielding spring with its form fitted: each has four; 6 is a tie."""
    found, cause, _, [bound] = compared(300.0, of_form, form_of_cause=3)
    assert (found, cause.name) == (names, names[0])
    assert bound == pytest.approx(OF_DAHL * (1.0 + 6.0 / 98.0), rel=0.01)


def test_a_law_for_whose_form_the_budget_does_not_suffice_is_untried():
    names, _, latest, _ = compared(300.0, 110.0, attempt=lambda step: None)
    assert names == ["presliding"]
    assert latest.rounds[-1].untried == ("stribeck",)


def test_a_law_takes_the_place_untested_where_the_earlier_causes_cannot_be_simulated_alone(judged, monkeypatch):
    judged.append("it does not predict data to which it was not fitted")
    alone = fit(NULL)
    alone.names = ()
    monkeypatch.setattr(calib.diagnosis.general_laws, "without_cause", lambda *model: alone)
    names, _, latest, _ = compared(300.0, 110.0)
    assert names == ["stribeck"]
    assert latest.rounds[-1].prediction is None
