"""Curves of visited states, over which arguments of a force cannot be told apart."""

import numpy as np
import pytest

from calib.diagnosis.discovery.penalised import States
from calib.diagnosis.discovery.place import ForcePlace
from calib.diagnosis.discovery.visited_curve import curve_in_words, is_closed_curve, is_open_curve

ON_MASS = ForcePlace("mass", {"mass": 1.0})
PHASE = np.linspace(0.0, 6.0 * np.pi, 400)
FALL = np.linspace(0.0, 3.0, 200)  # s


def falling(speed):
    return 47.0 - speed * FALL - 0.5 * 9.81 * FALL**2, -speed - 9.81 * FALL


def together(*motions):
    return States(*np.concatenate(motions, axis=1))


OPEN = together(falling(1.0))
CLOSED = States(2e-3 * np.cos(PHASE), -0.4 * np.sin(PHASE))
WIDE = {
    "two amplitudes": together((CLOSED.x, CLOSED.v), (2.0 * CLOSED.x, 2.0 * CLOSED.v)),
    "free decay": States(np.exp(-0.05 * PHASE) * CLOSED.x, np.exp(-0.05 * PHASE) * CLOSED.v),
    "thrown at two speeds": together(falling(1.0), falling(15.0)),
}


def test_of_one_drop_either_argument_is_a_function_of_the_other():
    assert is_open_curve(OPEN)
    told = curve_in_words(OPEN, ON_MASS)
    assert told.startswith("on mass all records visit one curve of displacement and velocity: a force over one")
    assert "another initial velocity, amplitude or frequency" in told


def test_on_one_steady_tone_even_functions_coincide():
    assert (is_open_curve(CLOSED), is_closed_curve(CLOSED)) == (False, True)
    assert "even functions of both, such as x^2 and v^2, coincide" in curve_in_words(CLOSED, ON_MASS)


@pytest.mark.parametrize("kind", WIDE)
def test_states_of_different_motions_are_no_curve(kind):
    assert (is_open_curve(WIDE[kind]), is_closed_curve(WIDE[kind])) == (False, False)
    assert curve_in_words(WIDE[kind], ON_MASS) == ""


def test_states_that_do_not_move_are_no_curve():
    assert curve_in_words(States(np.zeros(5), np.zeros(5)), ON_MASS) == ""


@pytest.mark.parametrize("count", [3, 6, 8, 12, 16, 20])
def test_few_samples_of_a_cycle_are_no_curve_for_a_function_that_passes_through_each(count):
    phase = 2.0 * np.pi * (np.arange(10 * count) / count + 0.01)
    assert not is_open_curve(States(2e-3 * np.cos(phase), -0.4 * np.sin(phase)))
    states = States(*np.random.default_rng(count).standard_normal((2, count)))
    assert not is_open_curve(states)


def test_a_drop_of_few_samples_is_one():
    x, v = falling(1.0)
    assert is_open_curve(States(x[::6], v[::6]))
