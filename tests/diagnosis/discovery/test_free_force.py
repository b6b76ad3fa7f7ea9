"""Free functions as force laws, against splines of scipy."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from calib.diagnosis.discovery.free_force import (
    DISPLACEMENT,
    VELOCITY,
    FreeForce,
    along_v,
    along_x,
    breakpoints,
    free_force,
    odd_along_v,
    odd_along_x,
    odd_over_states,
    over_states,
)
from calib.modelling.laws import MAX_LAW_PARAMETERS
from calib.modelling.model import Model
from calib.records.excitation import Excitation
from calib.simulators.oscillator import Oscillator

REGION = {DISPLACEMENT: (-3e-3, 4e-3), VELOCITY: (-0.3, 0.25)}
NONE = np.zeros(4)


def numbers(force: FreeForce, coefficients):
    values = {p.name: p.nominal for p in force.effect.parameters} | dict(
        zip(force.coefficients, coefficients, strict=True)
    )
    return force.effect.bound(values).p


@pytest.mark.parametrize(("argument", "law"), [(DISPLACEMENT, along_x), (VELOCITY, along_v)])
def test_a_function_of_one_argument_is_the_spline_of_its_coefficients(argument, law):
    force = free_force("mass", [argument], REGION)
    c = np.random.default_rng(1).standard_normal(len(force.coefficients))
    [t] = force.breaks
    spline = BSpline(np.concatenate([[t[0]] * 3, t, [t[-1]] * 3]), c, 3)
    u = np.linspace(*REGION[argument], 101)[:-1]
    p = numbers(force, c)
    known = [law.function(0.0, s, s, p, NONE, NONE) for s in u]
    assert known == pytest.approx(spline(u), abs=1e-12)
    assert force.matrix(u, u) @ c == pytest.approx(spline(u), abs=1e-12)


def test_a_function_of_two_arguments_is_the_product_of_splines():
    force = free_force("mass", [DISPLACEMENT, VELOCITY], REGION)
    one, other = (np.random.default_rng(k).standard_normal(t.size + 2) for k, t in enumerate(force.breaks))
    x, v = np.random.default_rng(3).uniform(-1.0, 1.0, (2, 50)) * np.array([[5e-3], [0.4]])
    p = numbers(force, np.outer(one, other).ravel())
    known = [over_states.function(0.0, *state, p, NONE, NONE) for state in zip(x, v, strict=True)]
    along = [FreeForce("mass", (a,), (t,)).matrix(x, v) for a, t in zip(force.arguments, force.breaks, strict=True)]
    assert known == pytest.approx((along[0] @ one) * (along[1] @ other), abs=1e-12)
    assert force.matrix(x, v) @ np.outer(one, other).ravel() == pytest.approx(known, abs=1e-12)


@pytest.mark.parametrize(
    ("arguments", "law"),
    [([DISPLACEMENT], odd_along_x), ([VELOCITY], odd_along_v), ([DISPLACEMENT, VELOCITY], odd_over_states)],
)
def test_an_odd_function_is_the_spline_of_its_mirrored_coefficients(arguments, law):
    force = free_force("mass", arguments, REGION, odd=True)
    assert [(t[0], t[-1]) for t in force.breaks] == [(-max(map(abs, REGION[a])), max(map(abs, REGION[a])))
                                                     for a in arguments]  # fmt: skip
    c = np.random.default_rng(1).standard_normal(len(force.coefficients))
    x, v = np.random.default_rng(3).uniform(-1.0, 1.0, (2, 50)) * np.array([[5e-3], [0.4]])
    whole = FreeForce("mass", force.arguments, force.breaks)
    assert len(force.coefficients) == len(whole.coefficients) // 2
    expected = whole.matrix(x, v) @ force.all_coefficients(c)
    assert whole.matrix(-x, -v) @ force.all_coefficients(c) == pytest.approx(-expected, abs=1e-12)
    p = numbers(force, c)
    assert [law.function(0.0, *state, p, NONE, NONE) for state in zip(x, v, strict=True)] == pytest.approx(expected)
    assert force.matrix(x, v) @ c == pytest.approx(expected, abs=1e-12)
    for own, all_rows in zip(force.roughness, whole.roughness, strict=True):
        assert own @ c == pytest.approx(all_rows @ force.all_coefficients(c), abs=1e-9)


def test_half_of_a_function_of_a_clearance_lies_in_a_compliant_contact():
    region = {DISPLACEMENT: (-1e-5, 4e-3), VELOCITY: (-0.3, 0.25)}
    [t] = free_force("interface", [DISPLACEMENT], region, in_contact=True).breaks
    assert (t[0], t[6], t[12]) == pytest.approx((-1e-5, 0.0, 4e-3), abs=1e-18)
    assert (np.diff(t) > 0.0).all()
    force = free_force("interface", [DISPLACEMENT, VELOCITY], region, in_contact=True)
    assert [own.size for own in force.breaks] == [6, 6]
    straight = [force.matrix(np.array([x]), np.zeros(1)) @ np.ones(len(force.coefficients)) for x in (-5e-6, 2e-3)]
    assert straight == pytest.approx([1.0, 1.0])


def test_outside_the_region_the_function_is_continued_linearly():
    force = free_force("mass", [DISPLACEMENT], REGION)
    c = np.random.default_rng(1).standard_normal(len(force.coefficients))
    for end, out in zip(REGION[DISPLACEMENT], (-1.0, 1.0), strict=True):
        u = end + out * np.array([-1e-8, 0.0, 1e-3, 2e-3])
        inner, edge, near, far = force.matrix(u, u) @ c
        assert far - near == pytest.approx(near - edge)
        assert (edge - inner) / 1e-8 == pytest.approx((far - edge) / 2e-3, rel=1e-3)


@pytest.mark.parametrize("arguments", [[DISPLACEMENT], [VELOCITY], [DISPLACEMENT, VELOCITY]])
def test_linear_functions_are_smooth_and_others_are_not(arguments):
    force = free_force("mass", arguments, REGION)
    x, v = (u.ravel() for u in np.meshgrid(*(np.linspace(*REGION[a], 40) for a in (DISPLACEMENT, VELOCITY))))
    linear = 1.0 + (100.0 * x if DISPLACEMENT in arguments else 0.0) + (3.0 * v if VELOCITY in arguments else 0.0)
    c = np.linalg.lstsq(force.matrix(x, v), linear, rcond=None)[0]
    assert force.matrix(x, v) @ c == pytest.approx(linear, abs=1e-9)
    bent = np.linalg.lstsq(force.matrix(x, v), linear**2, rcond=None)[0]
    assert len(force.roughness) == len(arguments)
    for rows in force.roughness:
        assert rows @ c == pytest.approx(0.0, abs=1e-8)
        assert np.abs(rows @ bent).max() > 1e-4


def test_breakpoints_of_the_velocity_are_denser_at_rest():
    t = breakpoints(-0.3, 0.6, 12, grade=2.0)
    assert t[[0, 6, -1]] == pytest.approx([-0.3, 0.0, 0.6])
    assert (np.diff(np.diff(t)[6:]) > 0.0).all()
    assert np.diff(breakpoints(0.1, 0.6, 4, grade=2.0)) == pytest.approx(0.125)
    [graded] = free_force("mass", [VELOCITY], REGION).breaks
    assert np.abs(graded[[7, 9]]).max() < 0.02 * np.diff(REGION[VELOCITY])[0]


def test_its_numbers_fit_into_a_law():
    assert max(np.count_nonzero(numbers(free_force("mass", a, REGION), np.ones(k))) for a, k in (
        ([DISPLACEMENT], 15), ([VELOCITY], 19), ([DISPLACEMENT, VELOCITY], 64)
    )) <= MAX_LAW_PARAMETERS  # fmt: skip


@pytest.mark.slow  # compiles a kernel with the law in it
def test_it_is_absent_at_null_and_acts_as_the_law_that_it_approximates():
    simulator, drive = Oscillator(), Excitation("mass", "force", frequency=10.0, amplitude=4.0)
    force = free_force("mass", [DISPLACEMENT], {DISPLACEMENT: (-2e-2, 2e-2)})
    bare, model = Model(simulator), Model(simulator, [force.effect])
    without = bare.run({}, drive).displacement.values
    assert np.array_equal(model.run({}, drive).displacement.values, without)
    x = np.linspace(-2e-2, 2e-2, 200)
    c = np.linalg.lstsq(force.matrix(x, x), -500.0 * x, rcond=None)[0]
    stiffer = bare.run({"stiffness": bare.nominal["stiffness"] + 500.0 * bare.nominal["mass"]}, drive)
    with_force = model.run(dict(zip(force.coefficients, c, strict=True)), drive)
    assert with_force.displacement.values == pytest.approx(
        stiffer.displacement.values, abs=1e-6 * np.abs(without).max()
    )
