"""Formulas of a force: their texts, units and values, and the law that the kernel interprets."""

import numpy as np
import pytest

from calib.diagnosis.discovery.dictionary import MAX_DEGREE, dictionary
from calib.diagnosis.discovery.formula import Factor, Formula, FormulaTerm, unit_text
from calib.diagnosis.discovery.free_force import DISPLACEMENT, VELOCITY
from calib.diagnosis.discovery.shapes import EVEN_POWER, ODD_POWER, SHAPES, SINE, STEP
from calib.modelling.laws import MAX_LAW_PARAMETERS
from calib.units import powers

REGION = {DISPLACEMENT: (-3e-3, 4e-3), VELOCITY: (-0.3, 0.25)}
BOTH = ((DISPLACEMENT, VELOCITY),)
NONE = np.zeros(4)
X, V = np.random.default_rng(1).uniform(-1.0, 1.0, (2, 40)) * np.array([[3e-3], [0.25]])


def one(code, argument, q=1.0, r=1.0, fixed=False):
    return FormulaTerm((Factor(code, argument, (q, r), fixed=fixed),), 2.0)


def test_every_term_is_finite_over_the_region_and_has_a_unit_of_length_and_time():
    terms = dictionary(BOTH, REGION)
    assert {f.code for term in terms for f in term.factors} == {code for code in SHAPES if code}
    for term in terms:
        assert np.isfinite(term.values(X, V)).all()
        metre, second, kilogram = powers(term.unit)
        for factor in term.factors:
            assert all(factor.bounds[k][0] < factor.numbers[k] < factor.bounds[k][1] for k in factor.free)
            metre += factor.power
            second -= factor.power * (factor.argument == VELOCITY)
        assert (metre, second, kilogram) == pytest.approx((1.0, -2.0, 0.0))


def test_products_of_powers_have_a_limited_degree():
    degrees = [
        sum(f.numbers[0] for f in term.factors)
        for term in dictionary(BOTH, REGION)
        if all(f.code in (EVEN_POWER, ODD_POWER) and f.fixed for f in term.factors)
    ]
    assert max(degrees) == MAX_DEGREE


def test_the_law_and_the_text_as_python_have_the_values_of_the_formula():
    seen = {}
    for term in dictionary(BOTH, REGION):
        seen.setdefault(tuple(f.code for f in term.factors), term)
    for term in seen.values():
        formula = Formula((FormulaTerm(term.factors, -3.0), one(STEP, VELOCITY, 0.1)))
        values = {**formula.candidate("found", ("mass",)).absent()}
        values |= {f"found_{n.name}": n.value for n in formula.numbers}
        candidate = formula.candidate("found", ("mass",))
        p = candidate.effect.bound(values).p
        law = [candidate.effect.law.function(0.0, *state, p, NONE, NONE) for state in zip(X, V, strict=True)]
        assert law == pytest.approx(formula.values(X, V), rel=1e-12)
        code = formula.code({n.name: repr(n.value) for n in formula.numbers})
        known = [eval(code, {"x": x, "v": v, "np": np}) for x, v in zip(X, V, strict=True)]
        assert known == pytest.approx(formula.values(X, V), rel=1e-12)


def test_texts_read_as_in_a_textbook():
    formula = Formula(
        (one(ODD_POWER, DISPLACEMENT, 3.0, fixed=True), one(ODD_POWER, VELOCITY, 2.0, fixed=True),
         one(EVEN_POWER, DISPLACEMENT, 3.0, fixed=True), one(SINE, DISPLACEMENT, 2e-3, 1e-4))
    )  # fmt: skip
    assert formula.text == "c1 x^3 + c2 v |v| + c3 |x|^3 + c4 sin(2 pi (x - b4)/a4)"
    assert formula.latex == (
        r"c_{1}\,x^{3} + c_{2}\,v\,|v| + c_{3}\,|x|^{3} + c_{4}\,\sin\frac{2\pi(x - b_{4})}{a_{4}}"
    )
    assert [n.unit for n in formula.numbers] == ["1/(m^2 s^2)", "1/m", "1/(m^2 s^2)", "m/s^2", "m", "m"]
    assert formula.length == 6
    assert formula.at({n.name: n.value + 1.0 for n in formula.numbers}).coefficients[0].value == 3.0


def test_units_are_written_as_a_quotient():
    assert [unit_text(*p) for p in ((1, -2), (-1, 0), (0, 0), (-0.5, -2), (0, -1), (-2, 1))] == [
        "m/s^2", "1/m", "1", "1/(m^0.5 s^2)", "1/s", "s/m^2"
    ]  # fmt: skip


def test_a_free_exponent_becomes_the_nearest_whole_one():
    term = one(ODD_POWER, VELOCITY, 2.1, 0.5)
    whole = term.with_whole_exponents()
    assert whole.free == []
    assert whole.coefficient * whole.values(X, V) == pytest.approx(
        2.0 * np.sign(V) * np.abs(V / 0.5) ** 2.0, rel=1e-12
    )  # fmt: skip


def test_it_is_absent_at_null_and_fits_into_a_law():
    formula = Formula(tuple(one(SINE, DISPLACEMENT, 2e-3, 1e-4) for _ in range(4)))
    candidate = formula.candidate("found", ("mass",))
    p = candidate.effect.bound({**candidate.held, **candidate.absent()}).p
    assert candidate.effect.law.function(0.0, 1e-3, 0.1, p, NONE, NONE) == 0.0
    assert len(candidate.effect.parameters) <= MAX_LAW_PARAMETERS
    assert candidate.form == tuple(f"found_{n.name}" for n in formula.shape_numbers)
