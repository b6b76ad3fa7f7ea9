"""Fits of small models whose least-squares answers are known."""

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from in_turn import Processes
from scipy.optimize import curve_fit
from scipy.signal import lfilter
from straight_line import MODEL, START, TIME, TRUE, WINDOWS, Evidence, straight

from calib.diagnosis.bench import SimulatedRows
from calib.diagnosis.candidate import Candidate
from calib.diagnosis.effort import Effort
from calib.diagnosis.refit import Fitter
from calib.diagnosis.signature import Point
from calib.diagnosis.speculation import SpeculativePool
from calib.execution.pool import InProcess
from calib.modelling.parameter import Parameter, Space, Window


def decaying(values):
    return values["height"] * np.exp(-values["rate"] * TIME)


def fitted(function, autocorrelation=0.0, seed=0, windows=WINDOWS, start=START):
    noise = np.random.default_rng(seed).standard_normal(TIME.size)
    noise = lfilter([np.sqrt(1.0 - autocorrelation**2)], [1.0, -autocorrelation], noise)
    measured = function(TRUE) + noise

    def simulate(run):
        return SimulatedRows(function(run.values)[None], np.ones(TIME.size))

    fitter = Fitter(InProcess(simulate), Evidence(measured), Space(windows), MODEL)
    seen = {"record": SimulatedRows(function(start)[None], np.ones(TIME.size))}
    return fitter, fitter.fit(Point(start, (), seen)), measured


def test_a_linear_model_is_fitted_at_once():
    fitter, fit, measured = fitted(straight)
    design = np.column_stack([np.ones_like(TIME), 10.0 * TIME])
    best = np.linalg.lstsq(design, measured, rcond=None)[0]
    assert [fit.value("height"), fit.value("rate")] == pytest.approx(best, rel=1e-5)
    assert fit.reason == ""
    assert fit.chi2 == pytest.approx(np.sum((measured - design @ best) ** 2))
    assert fitter.effort.done <= 10


def test_its_standard_errors_are_those_of_the_normal_equations():
    design = np.column_stack([np.ones_like(TIME), 10.0 * TIME])
    known = np.sqrt(np.diag(np.linalg.inv(design.T @ design)))
    errors = [fitted(straight, seed=seed)[1].error(["height", "rate"]) for seed in range(20)]
    assert np.mean(errors, axis=0) == pytest.approx(known, rel=0.1)


def test_autocorrelation_of_what_is_left_widens_them():
    white = np.mean([fitted(straight, seed=seed)[1].error(["height"]) for seed in range(20)])
    red = np.mean([fitted(straight, 0.8, seed)[1].error(["height"]) for seed in range(20)])
    assert red / white == pytest.approx(3.0, rel=0.2)  # sqrt((1 + 0.8) / (1 - 0.8))


def test_a_nonlinear_model_reaches_the_least_squares_answer_with_few_simulations():
    fitter, fit, measured = fitted(decaying)
    best, covariance = curve_fit(lambda t, a, b: a * np.exp(-b * t), TIME, measured, p0=[30.0, 0.5], sigma=np.ones(400))
    off = np.array([fit.value("height"), fit.value("rate")]) - best
    assert (np.abs(off) < 0.1 * np.sqrt(np.diag(covariance))).all()
    assert fitter.effort.done <= 20


@pytest.mark.parametrize("power", [1, 2])
def test_a_trial_is_scaled_by_the_power_with_which_its_change_grows(power):
    """By its square a wave of size 5 changes the record 100 times as much as one of size 0.5."""

    def simulate(run):
        waved = straight(run.values) + run.values.get("wave", 0.0) ** power * np.sin(3.0 * TIME)
        return SimulatedRows(waved[None], np.ones(TIME.size))

    measured = straight(TRUE) + 5.0**power * np.sin(3.0 * TIME)
    fitter = Fitter(InProcess(simulate), Evidence(measured), Space(WINDOWS), MODEL)
    seen = {"record": SimulatedRows(straight(TRUE)[None], np.ones(TIME.size))}
    parameters = [Parameter("wave", "1", 0.0, "", null=0.0)]
    effect = SimpleNamespace(name="wave", null={"wave": 0.0}, parameters=parameters, guess=None)
    wave = Candidate(effect, ("wave",), scale={"wave": 100.0})
    base = fitter.fit(Point(TRUE, (), seen))
    trials = fitter.trials(base, wave, [np.array([0.5]), np.array([2.0])])
    for reduction, size in trials:
        assert reduction == pytest.approx(base.chi2, rel=1e-3)
        assert size == pytest.approx([5.0], rel=1e-3)


def test_a_fit_ends_at_the_bound_of_a_window():
    _, fit, _ = fitted(decaying, windows=WINDOWS | {"rate": Window(0.01, 0.6)})
    assert fit.value("rate") == pytest.approx(0.6)


def test_where_the_motion_fails_there_is_a_reason_and_no_parameter():
    def simulate(run):
        return SimulatedRows(np.zeros((0, 0)), np.zeros(0), status="diverged", reason="")

    fitter = Fitter(InProcess(simulate), Evidence(decaying(TRUE)), Space(WINDOWS), MODEL)
    seen = {"record": SimulatedRows(decaying(START)[None], np.ones(TIME.size))}
    fit = fitter.fit(Point(START, (), seen))
    assert (fit.names, fit.reason) == ((), "its simulation fails at the start")


def test_fits_in_turn_are_those_of_one_after_the_other_and_the_next_ones_simulate_ahead():
    """The bound of each is the least chi-square before it; what is fitted ahead changes no step of differences."""
    starts = [{**START, "rate": rate} for rate in (0.3, 0.6, 0.9)]

    def simulate(run):
        return SimulatedRows(decaying(run.values)[None], np.ones(TIME.size))

    def results(processes):
        fitter = Fitter(
            Effort(SpeculativePool(processes, processes.jobs - 1)), Evidence(measured), Space(WINDOWS), MODEL
        )
        fits = []

        def fitted_below(start, own):
            return own.fit(Point(start, (), known), rival=min((fit.chi2 for fit in fits), default=np.inf))

        for fit in fitter.in_turn([partial(fitted_below, start) for start in starts]):
            fits.append(fit)
        return [fit.residual.tolist() for fit in fits], fitter.steps, fitter.effort.done

    _, _, measured = fitted(decaying)
    known = {"record": SimulatedRows(decaying(START)[None], np.ones(TIME.size))}
    one, two = Processes(1, simulate), Processes(2, simulate)
    assert results(one) == results(two)
    alone, both = ([tuple(run.values.values()) for run in processes.begun] for processes in (one, two))
    assert alone.index(tuple(starts[1].values())) > both.index(tuple(starts[1].values())) == 1
    assert len(set(alone)) == len(alone)
    assert set(alone) <= set(both)


@pytest.mark.parametrize(
    ("damping", "stiffness", "at_an_edge"), [(0.01, 3.0, True), (0.005, 3.0, False), (0.005, 1.0, True)]
)
def test_a_calibrated_value_is_at_an_edge_of_its_window(damping, stiffness, at_an_edge):
    windows = {"damping": Window(0.002, 0.01, "log"), "stiffness": Window(1.0, 9.0)}
    fitter = Fitter(InProcess(None), None, SimpleNamespace(windows=windows), None)
    values = {"damping": damping, "stiffness": stiffness}
    assert fitter.is_at_an_edge(SimpleNamespace(value=values.get)) == at_an_edge
