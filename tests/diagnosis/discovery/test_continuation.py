"""A formula is continued beyond the visited states as far as its numbers, and the formulas that tie with it, allow."""

import numpy as np
import pytest

from calib.diagnosis.discovery.continuation import MAX_CONTINUATION, continued_region
from calib.diagnosis.discovery.formula import Factor, Formula, FormulaTerm
from calib.diagnosis.discovery.formulas import FormulaTrial
from calib.diagnosis.discovery.free_force import DISPLACEMENT, VELOCITY, free_force
from calib.diagnosis.discovery.penalised import FreeModel, States
from calib.diagnosis.discovery.shapes import EVEN_POWER, ODD_POWER, POLE_ABOVE
from calib.diagnosis.fit import Fit
from calib.diagnosis.signature import Point

PHASE = np.linspace(0.0, 2.0 * np.pi, 200)
STATES = States(4e-3 * np.cos(PHASE), -0.3 * np.sin(PHASE))
MODEL = FreeModel((free_force("mass", [VELOCITY], STATES.region),), (), STATES)
LINEAR = np.linalg.lstsq(MODEL.visited, STATES.v, rcond=None)[0][:, None]  # which a calibrated damping absorbs
DRAG = FormulaTerm((Factor(ODD_POWER, VELOCITY, (2.0, 1.0), fixed=True),), -0.8)
CUBE = FormulaTerm((Factor(ODD_POWER, VELOCITY, (3.0, 1.0), fixed=True),), -2.0)
POLE = FormulaTerm((Factor(POLE_ABOVE, DISPLACEMENT, (6e-3, 2.0)),), 1e-6)


def trial(terms, share):
    """Return a formula whose numbers have these relative standard errors."""
    formula = Formula(tuple(terms))
    numbers = {f"found_{n.name}": n.value for n in formula.numbers}
    rng = np.random.default_rng(0)
    columns = np.linalg.qr(rng.standard_normal((400, len(numbers))))[0] / (share * np.abs(list(numbers.values())))
    point, rows = Point(numbers, (), {}), np.zeros(400, dtype=int)
    fit = Fit(point, (), rng.standard_normal(400), columns, tuple(numbers), (), np.zeros((400, 0)), rows)
    return FormulaTrial(formula, formula.candidate("found", ("mass",)), "found", fit, None)


def test_a_formula_whose_numbers_are_well_known_is_continued_to_the_limit():
    region = continued_region(trial([DRAG], 0.02), [], STATES, MODEL, LINEAR)
    low, high = STATES.region[VELOCITY]
    reach = MAX_CONTINUATION * (high - low)
    assert region[VELOCITY] == pytest.approx((low - reach, high + reach))


def test_one_whose_numbers_are_not_known_ends_with_the_visited_states():
    assert continued_region(trial([DRAG], 0.3), [], STATES, MODEL, LINEAR) == STATES.region


def test_a_formula_that_ties_ends_it_where_both_part():
    """Beside a calibrated damping v |v| and v^3 are similar inside, by a few per cent, and not outside."""
    inside = np.abs(STATES.v) ** 3 @ np.abs(STATES.v) ** 2 / np.sum(np.abs(STATES.v) ** 6)
    rival = trial([FormulaTerm(CUBE.factors, 0.55 * DRAG.coefficient * inside)], 0.02)
    low, high = continued_region(trial([DRAG], 0.02), [rival], STATES, MODEL, LINEAR)[VELOCITY]
    assert 1.0 < high / STATES.region[VELOCITY][1] < 1.7
    assert low == pytest.approx(-high, rel=0.05)


def test_a_rival_that_differs_by_what_calibration_absorbs_does_not_end_it():
    damped = trial([DRAG, FormulaTerm((Factor(ODD_POWER, VELOCITY, (1.0, 1.0), fixed=True),), 0.4)], 0.02)
    alone = continued_region(trial([DRAG], 0.02), [], STATES, MODEL, LINEAR)
    beside = continued_region(trial([DRAG], 0.02), [damped], STATES, MODEL, LINEAR)
    assert beside[VELOCITY] == alone[VELOCITY]


def test_no_formula_is_continued_to_its_pole():
    low, high = continued_region(trial([POLE], 0.02), [], STATES, MODEL, LINEAR)[DISPLACEMENT]
    assert STATES.region[DISPLACEMENT][1] <= high < 6e-3
    assert low < STATES.region[DISPLACEMENT][0]


def test_a_rival_that_differs_at_once_leaves_the_visited_states():
    offset = FormulaTerm((Factor(EVEN_POWER, VELOCITY, (2.0, 1.0), fixed=True),), 5.0)
    assert continued_region(trial([DRAG], 0.02), [trial([offset], 0.02)], STATES, MODEL, LINEAR) == STATES.region
