"""Forces withheld from a model are found in its frequency responses: `discover` on stepped sines of the oscillator."""

import numpy as np
import pytest

from calib.diagnosis.discovery.discover import discover
from calib.diagnosis.discovery.outcome import FOUND, NOTHING, UNDETERMINED
from calib.diagnosis.discovery.serialise import discovery_result
from calib.diagnosis.effort import Budget
from calib.dynamics.swept_response import swept_response
from calib.effects.cubic_stiffness import EFFECT as CUBIC_STIFFNESS
from calib.effects.quadratic_drag import EFFECT as QUADRATIC_DRAG
from calib.execution.pool import InProcess
from calib.features.frequency_response import ResponseDistance
from calib.modelling.model import Model
from calib.modelling.parameter import Space, Window
from calib.objective import Objective, Reference, Term
from calib.objective.stable_stretches import read_at
from calib.optimisers.multistart import Multistart
from calib.records.excitation import Excitation
from calib.records.response import make_response
from calib.simulators.oscillator import Oscillator
from calib.study import CalibrationStudy

FORCE = Excitation("mass", "force", frequency=3.0, amplitude=1.0)
TRUE = {"mass": 1.0, "stiffness": 400.0, "damping": 2.0}  # kg, N/m, N s/m
LEVELS, FREQUENCIES = (0.3, 0.8), np.linspace(2.8, 3.6, 11)  # N, Hz
NOISE = 0.01  # of the rms amplitude of a level, in each part


def stepped(acting, *effects):
    """Record of sweeps up at the levels, with noise that it states."""
    number = np.repeat(np.arange(float(len(LEVELS))), FREQUENCIES.size)
    points = np.tile(FREQUENCIES, len(LEVELS))
    drive = np.repeat(LEVELS, FREQUENCIES.size), "N", number, 1.0
    asked = make_response(points, ["mass"], np.ones((1, points.size)), *drive)
    amplitude = read_at(swept_response(Model(Oscillator(), effects), {**TRUE, **acting}, FORCE, asked), asked)
    rms = [np.sqrt(np.mean(np.abs(amplitude[0, number == own]) ** 2)) for own in np.unique(number)]
    sigma = NOISE * np.repeat(rms, FREQUENCIES.size)
    noise = sigma * (np.random.default_rng(0).standard_normal((2, points.size)).T @ [1.0, 1j])
    return make_response(
        points, ["mass"], amplitude + noise, *drive, sigma=sigma[None], frequency_sigma=np.full(points.size, 1e-3),
        place="mass", quantity="force",
    )  # fmt: skip


def found(acting, *effects, budget=None):
    """What is written of a search in the record of a hidden force."""
    reference = Reference("levels", stepped(acting, *effects), excitation=FORCE)
    study = CalibrationStudy(
        name="withheld",
        model=Model(Oscillator()),
        space=Space({"stiffness": Window(300.0, 500.0), "damping": Window(0.5, 8.0, "log")}, {"mass": 1.0}),
        objective=Objective({"levels": reference}, [Term(ResponseDistance())]),
        optimiser=Multistart,
        budget=1,
        seed=1,
    )
    return discovery_result(discover(study, {}, TRUE, [], pool=InProcess, budget=Budget.of(budget)), TRUE)


@pytest.mark.slow
def test_a_cubic_spring_is_a_function_of_displacement_with_its_power_and_equivalent_stiffness():
    hidden = 8e4  # 1/(m^2 s^2)
    result = found({"k3": hidden}, CUBIC_STIFFNESS)
    assert (result.verdict, result.arguments) == (FOUND, ("displacement",))
    assert result.left_out == ("sweep 0 of levels", "sweep 1 of levels")
    assert result.left_out_deviance[1] < 0.2 * result.left_out_deviance[0]
    assert result.explained > 0.95
    assert result.formula.text == "c1 x^3"
    [number] = result.formula.numbers
    assert number.value == pytest.approx(-hidden, abs=4.0 * number.error)
    told = result.describing_function
    a = np.array(told.amplitudes)
    apart = np.array(told.stiffness) - 0.75 * hidden * a**2
    apart -= np.average(apart, weights=a**2)  # that of the calibrated spring
    assert np.abs(apart).max() < 0.05 * 0.75 * hidden * a[-1] ** 2
    assert "describing function" in told.limits


@pytest.mark.slow
def test_drag_is_a_function_of_velocity_whose_formula_a_budget_leaves_out():
    result = found({"c2": 5.0}, QUADRATIC_DRAG, budget="90")
    assert (result.verdict, result.cut_short, result.formulas) == (UNDETERMINED, True, ())
    assert (result.body, result.arguments) == ("mass", ("velocity",))
    assert result.explained > 0.95
    told = result.describing_function
    linear = np.polyfit(told.amplitudes, told.damping, 1)[0]  # by 8 c2 a omega / (3 pi)
    assert linear == pytest.approx(8.0 * 5.0 * 2.0 * told.frequency / 3.0, rel=0.1)


@pytest.mark.slow
def test_nothing_is_found_in_responses_where_nothing_is_hidden():
    result = found({})
    assert (result.verdict, result.describing_function) == (NOTHING, None)
