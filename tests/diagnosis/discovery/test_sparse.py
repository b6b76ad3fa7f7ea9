"""Sparse selection of formulas, on a force over a straight line."""

from functools import cache

import numpy as np
import pytest
from diagnosis.discovery.test_penalised import STATES, fitted, free_model

from calib.diagnosis.discovery.formula import Formula
from calib.diagnosis.discovery.free_force import DISPLACEMENT, VELOCITY
from calib.diagnosis.discovery.sparse import LinearisedForce, selected_formulas

X, V = STATES.x, STATES.v


LAWS = {
    "bent": -10.0 * X * np.abs(X),
    "friction": 10.0 * np.tanh(V / 0.1),
    "both": 40.0 * X**3 - 30.0 * V * np.abs(V),
    "stop": 20.0 * np.maximum(0.0, X - 0.377) ** 1.5,
    "square": 10.0 * X**2,
}


@cache
def selected(arguments, law):
    """Return the problem of a law and its formulas."""
    force = LAWS[law]
    problem = LinearisedForce(fitted(free_model(*arguments), force)[1])
    return problem, selected_formulas(problem)


@pytest.mark.parametrize(
    ("arguments", "law", "text"),
    [
        ((DISPLACEMENT,), "bent", "c1 x |x|"),
        pytest.param((VELOCITY,), "friction", "c1 tanh(v/a1)", marks=pytest.mark.slow),
        pytest.param((DISPLACEMENT, VELOCITY), "both", "c1 x^3 + c2 v |v|", marks=pytest.mark.slow),
    ],
)
def test_the_formula_of_a_force_is_within_a_tie_of_the_best(arguments, law, text):
    problem, found = selected(arguments, law)
    least = found[0].aic(problem.dispersion)
    near = [s for s in found if s.aic(problem.dispersion) - least < 6.0]
    shortest = min(s.formula.length for s in near)
    own = min((s for s in near if s.formula.length == shortest), key=lambda s: s.aic(problem.dispersion))
    assert own.formula.text == text


@pytest.mark.slow
def test_a_formula_is_refined_between_the_points_of_the_grid():
    _, found = selected((DISPLACEMENT,), "stop")
    own = next(s for s in found if s.formula.text == "c1 max(0, x - a1)^1.5")
    assert own.formula.shape_numbers[0].value == pytest.approx(0.377, abs=0.03)
    assert own.formula.coefficients[0].value == pytest.approx(20.0, rel=0.1)


@pytest.mark.slow
def test_what_calibration_absorbs_is_no_term():
    _, found = selected((DISPLACEMENT,), "square")
    assert all(term.arguments for s in found for term in s.formula.terms)  # the height absorbs a constant


def test_calibrated_values_are_predicted_beside_a_formula():
    problem, found = selected((DISPLACEMENT,), "bent")
    own = next(s for s in found if s.formula.text == "c1 x |x|")
    values = problem.calibrated(own.formula)
    assert values["height"] == pytest.approx(40.0, abs=0.5)
    assert values["rate"] == pytest.approx(0.7, abs=0.02)
    assert problem.calibrated(Formula())["height"] != pytest.approx(values["height"], abs=1e-6)
