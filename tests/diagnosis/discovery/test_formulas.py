"""Formulas refitted inside a simulator in closed form, and judged."""

from types import SimpleNamespace

import numpy as np
import pytest
from diagnosis.discovery.test_penalised import STATES, free_model
from straight_line import MODEL, START, TIME, TRUE, WINDOWS, Evidence, straight

from calib.diagnosis.bench import SimulatedRows
from calib.diagnosis.discovery.formulas import formulas_of, prefix_of
from calib.diagnosis.discovery.free_force import DISPLACEMENT
from calib.diagnosis.discovery.left_out import left_out_misfit
from calib.diagnosis.discovery.penalised import penalised_fit
from calib.diagnosis.refit import Fitter
from calib.diagnosis.signature import Point
from calib.execution.pool import InProcess
from calib.modelling.parameter import Space

NONE = np.zeros(4)


class InQuarters(Evidence):
    """The line, of which one quarter after the other is left out."""

    parts = (SimpleNamespace(name="record", is_swept=False, period=None, level=None, time=TIME, nuisance=()),)

    def counted(self):
        return float(TIME.size)

    def segments(self):
        return np.arange(TIME.size) // (TIME.size // 4)

    def of(self, name):
        return slice(None)


def simulate(run):
    """Line and forces over the states that are visited."""
    total = straight(run.values)
    for effect in run.effects:
        p = effect.bound(run.values).p
        states = zip(STATES.x, STATES.v, strict=True)
        total = total + np.array([effect.law.function(0.0, x, v, p, NONE, NONE) for x, v in states])
    return SimulatedRows(total[None], np.ones(TIME.size))


def searched(force, seed=0):
    """Return the free force that is fitted to a line and a force (n,) with unit noise, and its formulas."""
    measured = straight(TRUE) + force + np.random.default_rng(seed).standard_normal(TIME.size)
    fitter = Fitter(InProcess(simulate), InQuarters(measured), Space(WINDOWS), MODEL)
    null = fitter.fit(Point(START, (), {"record": SimulatedRows(straight(START)[None], np.ones(TIME.size))}))
    fitted = penalised_fit(fitter, null, free_model(DISPLACEMENT))
    return fitted, formulas_of(fitter, null, fitted, left_out_misfit(fitter.evidence, fitted.fit, fitted))


@pytest.fixture(scope="module")
def bent():
    return searched(-10.0 * STATES.x * np.abs(STATES.x))[1]


def test_the_simplest_formula_within_a_tie_is_first(bent):
    best = bent[0]
    assert best.formula.text == "c1 x |x|"
    assert best.formula.coefficients[0].value == pytest.approx(-10.0, abs=4.0 * best.errors()["c1"])
    assert (best.ties, best.on_front, best.predicts, best.explains) == (True,) * 4
    ties = [trial.formula.length for trial in bent if trial.ties]
    assert ties == sorted(ties)
    assert all(trial.ric - min(t.ric for t in bent) > 6.0 for trial in bent if not trial.ties)


def test_a_formula_that_is_wrong_does_not_predict(bent):
    wrong = [trial for trial in bent if trial.formula.text == "c1 x^5"]
    assert all(not trial.predicts for trial in wrong)


def test_names_are_those_that_the_model_does_not_have():
    assert prefix_of(["stiffness", "founded"]) == "found"
    assert prefix_of(["found_c1", "stiffness"]) == "found2"


@pytest.mark.slow
def test_a_term_that_chance_prefers_is_not_taken():
    """Of some thirty terms the best reduces chi-square by 2 ln 30 in noise: AIC would take it in one of three."""
    first = [searched(-10.0 * STATES.x * np.abs(STATES.x), seed)[1][0] for seed in range(1, 9)]
    assert sum(trial.formula.text == "c1 x |x|" for trial in first) >= 7
    assert all(len(trial.formula.terms) == 1 for trial in first)
