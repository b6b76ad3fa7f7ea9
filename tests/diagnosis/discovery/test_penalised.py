"""Fits of models with free forces, on a simulator in closed form."""

import numpy as np
import pytest
from straight_line import MODEL, START, TIME, TRUE, WINDOWS, Evidence, straight

from calib.diagnosis.bench import SimulatedRows
from calib.diagnosis.candidate import Candidate
from calib.diagnosis.discovery.free_force import DISPLACEMENT, VELOCITY, free_force
from calib.diagnosis.discovery.penalised import FreeModel, States, nested, penalised_fit
from calib.diagnosis.refit import Fitter
from calib.diagnosis.signature import Point
from calib.execution.pool import InProcess
from calib.modelling.parameter import Space

STATES = States(np.sin(7.0 * TIME), np.cos(7.0 * TIME))
BENDING = 2e-3  # of the answer by its square: a fit takes several steps


def free_model(*arguments):
    forces = tuple(free_force("mass", [a], STATES.region) for a in arguments)
    candidates = []
    for force in forces:
        held = {p.name: p.nominal for p in force.effect.parameters if p.null is None}
        scale = dict.fromkeys(force.coefficients, 100.0)
        candidates.append(Candidate(force.effect, force.coefficients, held, scale))
    return FreeModel(forces, tuple(candidates), STATES)


def fitted(model, force, seed=0):
    """Fit a line and free forces to a line and a force (n,), seen through a bent sensor, with unit noise."""

    def bent(rows):
        return rows + BENDING * rows**2

    def simulate(run):
        names = [name for name in model.coefficients if name in run.values]
        own = model.visited @ np.array([run.values[name] for name in names]) if names else 0.0
        return SimulatedRows(bent(straight(run.values) + own)[None], np.ones(TIME.size))

    measured = bent(straight(TRUE) + force) + np.random.default_rng(seed).standard_normal(TIME.size)
    fitter = Fitter(InProcess(simulate), Evidence(measured), Space(WINDOWS), MODEL)
    seen = {"record": SimulatedRows(bent(straight(START))[None], np.ones(TIME.size))}
    null = fitter.fit(Point(START, (), seen))
    return null, penalised_fit(fitter, null, model)


def test_a_force_is_fitted_with_the_calibrated_parameters():
    force = 10.0 * STATES.x * np.abs(STATES.x)
    null, found = fitted(free_model(DISPLACEMENT), force)
    assert found.fit.chi2 < 1.15 * TIME.size < null.chi2
    value, error = found.surface(STATES.x, STATES.v)
    apart = value - value.mean() - (force - force.mean())  # the height absorbs a constant
    assert np.sqrt(np.mean(apart**2)) < 0.5
    assert np.mean(np.abs(apart) < 2.5 * error) > 0.8
    assert found.fit.value("rate") == pytest.approx(TRUE["rate"], abs=0.02)


def test_what_a_calibrated_parameter_absorbs_is_no_part_of_the_force():
    _, found = fitted(free_model(DISPLACEMENT), 10.0 * STATES.x**2)
    assert found.smoothing.absorbed.shape[1] == 1
    assert found.surface(STATES.x, STATES.v)[0].mean() == pytest.approx(0.0, abs=1e-6)


def test_forces_of_two_arguments_add_up():
    one, other = 8.0 * STATES.x**3, 8.0 * np.tanh(3.0 * STATES.v)
    _, found = fitted(free_model(DISPLACEMENT, VELOCITY), one + other)
    value, _ = found.surface(STATES.x, STATES.v)
    assert np.sqrt(np.mean((value - value.mean() - one - other) ** 2)) < 0.7
    assert found.effective_parameters < 18.0


def test_a_term_is_fitted_by_a_step_from_the_sum_that_has_it():
    force = 8.0 * STATES.x**3
    _, found = fitted(free_model(DISPLACEMENT, VELOCITY), force)
    ahead = {}
    for argument in (DISPLACEMENT, VELOCITY):
        model = free_model(argument)
        chi2, values = nested(found, model)
        own = model.visited @ np.array([values[name] for name in model.coefficients])
        ahead[argument] = chi2, own - own.mean()
        assert {*model.coefficients, *WINDOWS} == set(values)
    assert ahead[DISPLACEMENT][0] < 1.2 * TIME.size < ahead[VELOCITY][0]
    assert np.sqrt(np.mean((ahead[DISPLACEMENT][1] - force + force.mean()) ** 2)) < 0.7


def test_without_a_force_nothing_but_noise_is_fitted():
    null, found = fitted(free_model(DISPLACEMENT), np.zeros_like(TIME))
    assert found.effective_parameters < 6.0
    assert null.chi2 - found.fit.chi2 < 20.0
    assert np.abs(found.surface(STATES.x, STATES.v)[0]).max() < 1.0
