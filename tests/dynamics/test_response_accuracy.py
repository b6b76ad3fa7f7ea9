"""Accuracy of frequency responses: against stepped sweeps and folds of another integrator, and closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
from dynamics.driven_plants import Plant, after_period, fold, one_mass, sweep
from scipy.integrate import solve_ivp
from simulators.four_dof_peer import spring_drive

from calib.dynamics.backbone import backbones
from calib.dynamics.harmonic_response import balanced_response
from calib.dynamics.orbits import shoot
from calib.dynamics.response import frequency_response, harmonics_of_cycle
from calib.dynamics.setting import Setting
from calib.effects.backlash import EFFECT as BACKLASH
from calib.effects.backlash import SLIDING_RANGE
from calib.effects.cubic_stiffness import EFFECT as CUBIC_STIFFNESS
from calib.modelling.model import Model
from calib.records.excitation import Excitation
from calib.simulators.four_dof import FourDof
from calib.simulators.oscillator import Oscillator

MASS, DAMPING, STIFFNESS = 1.0, 1.0, 400.0  # kg, N s/m, N/m
FORCE = Excitation("mass", "force", frequency=3.0, amplitude=1.0, phase=0.4)
SHAKER = Excitation("end", "displacement", frequency=26.24, amplitude=1e-4, phase=0.4)
STEPS = 128  # of a period of a smooth motion, of order 8
KINKED_STEPS = 4096  # of a period of a motion with kinks in its force, which lower the order
FINER = 6.0  # the division of the steps by which calib integrates kinks in a force to 1e-6 of the amplitude


def oscillator(*effects, options=(), **values):
    own = {"mass": MASS, "damping": DAMPING, "stiffness": STIFFNESS, **values}
    return Setting(Model(Oscillator(**dict(options)), effects), FORCE, own)


def one_mass_driven(force, **laws):
    return one_mass(MASS, DAMPING, STIFFNESS, force, phase=FORCE.phase, **laws)


def duffing():
    """Setting, plant, window [Hz] and level."""
    return oscillator(CUBIC_STIFFNESS, k3=4e5), one_mass_driven(0.6, cubic=4e5), (2.5, 4.5), 0.6


def duffing_with_stop():
    setting = oscillator(CUBIC_STIFFNESS, options={"stop": True}, k3=1e5, gap=0.02, restitution=0.6)
    return setting, one_mass_driven(0.8, cubic=1e5, gap=0.02, restitution=0.6), (3.35, 4.2), 0.8


def four_dof():
    values, level = {"k3": 2e9, "gap": 1e-2, "damping": 0.02}, 1e-4
    setting = Setting(Model(FourDof(), [replace(CUBIC_STIFFNESS, bodies=("q3",))]), SHAKER, values)
    own = {p.name: p.nominal for p in FourDof.parameters} | values
    mass, stiffness, damping, load = spring_drive(own, level)
    inverse = np.linalg.inv(mass)
    plant = Plant(inverse @ stiffness, inverse @ damping, inverse @ [load, 0.0, 0.0, 0.0], body=2, cubic=2e9,
                  phase=SHAKER.phase)  # fmt: skip
    return setting, plant, (46.0, 52.0), level


CASES = {"duffing": duffing, "duffing with a stop": duffing_with_stop, "four_dof": four_dof}


def with_play(level, width, force):
    """Setting and plant of a mount with play behind a slider  [N, m, m/s^2]."""
    setting = oscillator(BACKLASH, backlash_stiffness=60.0, backlash_width=width, backlash_force=force)
    return setting, one_mass_driven(level, play=np.array([60.0, width, force, SLIDING_RANGE * force]))


def map_at(setting, frequency, level):
    return setting.map({"excitation.frequency": frequency, "excitation.amplitude": level})


def first_harmonic(setting, frequency, level, state, body=0):
    return harmonics_of_cycle(setting, 1, 1, frequency, level, state)[0][body, 1]


@pytest.fixture(scope="module", params=CASES)
def case(request):
    """Setting, plant, window, level, response, and its folds by rising frequency."""
    setting, plant, window, level = CASES[request.param]()
    response = frequency_response(setting, window, [level], steps=3)
    folds = [point for one in response.branches for point in one.branch.points if point.kind == "fold"]
    return setting, plant, window, level, response, sorted(folds, key=lambda point: point.parameter)


def stable_harmonics(setting, response, frequency, level, body):
    """Complex first harmonics [m] of the stable motions at a frequency, each by shooting from a point of a branch."""
    found = []
    for one in response.branches:
        offset = one.frequency - frequency
        for place in np.flatnonzero(offset[:-1] * offset[1:] <= 0.0):
            nearest = place + int(abs(offset[place + 1]) < abs(offset[place]))
            cycle = shoot(map_at(setting, frequency, level), one.branch.states[nearest], one.branch.periods)
            if cycle.converged and cycle.stable:
                assert one.branch.periods == 1
                found.append(first_harmonic(setting, frequency, level, cycle.state, body))
    return found


# --- the integrator of the sweeps


@pytest.mark.parametrize("name", CASES)
def test_the_integrator_of_the_sweeps_is_as_exact_as_an_adaptive_one(name):
    _, plant, window, _ = CASES[name]()
    n, frequency = plant.load.size, window[0]
    y = np.array([*np.linspace(1e-3, 4e-3, n), *np.linspace(0.6, 0.1, n), 0.0, 0.0, 0.0])

    def rate(t, x):
        acceleration = plant.load * math.cos(2.0 * math.pi * frequency * t + plant.phase)
        acceleration = acceleration - plant.stiffness @ x[:n] - plant.damping @ x[n:]
        acceleration[plant.body] -= plant.cubic * x[plant.body] ** 3
        return np.concatenate([x[n:], acceleration])

    def touch(t, x):
        return plant.gap - x[plant.body]

    touch.terminal, touch.direction = True, -1.0
    t, x, impacts, end = 0.0, y[: 2 * n], 0, 1.0 / frequency
    while t < end:
        events = touch if np.isfinite(plant.gap) else None
        flight = solve_ivp(rate, (t, end), x, "DOP853", rtol=1e-12, atol=1e-15, events=events)
        t, x = flight.t[-1], flight.y[:, -1]
        if flight.status == 1:
            x[n + plant.body] *= -plant.restitution
            impacts += 1
    ahead, own_impacts = after_period(y, plant, frequency, STEPS)
    assert own_impacts == impacts
    assert (impacts > 0) == (name == "duffing with a stop")
    np.testing.assert_allclose(ahead[:n], x[:n], rtol=0, atol=1e-9 * np.abs(x[:n]).max())
    np.testing.assert_allclose(ahead[n : 2 * n], x[n:], rtol=0, atol=1e-9 * np.abs(x[n:]).max())


# --- sweeps and folds


@pytest.mark.slow
def test_stepped_sweeps_up_and_down_have_the_amplitudes_of_the_stable_motions(case):
    """With impacts the harmonics of the response are of a motion with kinks, exact to some 1e-6; else to 1e-9."""
    setting, plant, window, level, response, folds = case
    beside = [fold.parameter * (1.0 + share) for fold in folds for share in (-1e-3, 1e-3)]
    frequencies = np.sort([*np.linspace(*window, 8)[1:-1], *beside])
    motions = [stable_harmonics(setting, response, f, level, plant.body) for f in frequencies.tolist()]
    apart = [np.ptp(np.abs(own)) > 0.1 * np.abs(own).max() for own in motions]
    assert any(apart)
    assert not all(apart)
    up, down = sweep(plant, frequencies, STEPS), sweep(plant, frequencies[::-1], STEPS)[::-1]
    tolerance = 1e-6 if np.isfinite(plant.gap) else 1e-9
    for own, rising, falling in zip(motions, up, down, strict=True):  # all harden: the sweep up keeps the larger motion
        assert abs(max(own, key=abs) / rising - 1.0) < tolerance
        assert abs(min(own, key=abs) / falling - 1.0) < tolerance


@pytest.mark.slow
def test_folds_are_those_of_another_shooting(case):
    _, plant, _, _, _, folds = case
    assert folds
    for point in folds:
        expected = fold(plant, point.state, point.parameter, STEPS)
        assert point.parameter == pytest.approx(expected, rel=1e-9)


# --- play


@pytest.mark.slow
def test_a_mount_with_play_has_the_amplitudes_of_a_stepped_sweep():
    """By settling and by harmonic balance, for a slider that does not slide may rest anywhere."""
    (setting, plant), level = with_play(0.6, 4e-3, 5.0), 0.6
    frequencies = np.array([3.05, 3.25, 3.4])
    expected = sweep(plant, frequencies, KINKED_STEPS)
    finer = replace(setting, model=Model(setting.model.simulator.finer("time_step", FINER), setting.model.effects))
    for held, tolerance in ((setting, 2e-6), (finer, 1e-6)):
        for frequency, swept in zip(frequencies.tolist(), expected, strict=True):
            map = map_at(held, frequency, level)
            settled = map.orbit(map.initial, 250).states[-1]
            assert settled[2] == 0.0
            assert abs(first_harmonic(held, frequency, level, settled) / swept - 1.0) < tolerance
    [one] = balanced_response(setting, (3.05, 3.4), [level], harmonics=15, steps=2).branches
    np.testing.assert_allclose(one.harmonics[0, 1, [0, -1]], expected[[0, -1]], rtol=1e-5)


@pytest.mark.parametrize("frequency", [3.3, 3.4])
def test_play_whose_slider_slides_has_the_amplitude_of_another_integrator(frequency):
    (setting, plant), level = with_play(0.8, 2e-3, 0.9), 0.8
    map = map_at(setting, frequency, level)
    cycle = shoot(map, map.orbit(map.initial, 60).states[-1])
    assert cycle.converged
    assert abs(cycle.multipliers[-1]) < 1e-6, "the slider moves"
    [expected] = sweep(plant, [frequency], KINKED_STEPS)
    assert abs(first_harmonic(setting, frequency, level, cycle.state) / expected - 1.0) < 1e-6


# --- the bilinear oscillator


@pytest.mark.slow
def test_the_backbone_of_a_bilinear_oscillator_has_the_frequency_of_the_closed_form_at_every_level():
    """2 w1 w2 / (w1 + w2), Shaw and Holmes, J. Sound Vib. 90 (1983) 129; damping lowers it by the ratio squared."""
    free, contact = math.sqrt(STIFFNESS / MASS), 1.3 * math.sqrt(STIFFNESS / MASS)  # rad/s
    expected = 2.0 * free * contact / (free + contact) / (2.0 * math.pi)
    stop = {
        "gap": 0.0, "contact_time": math.pi / math.sqrt(contact**2 - free**2), "hunt_crossley": 0.0,
        "contact_exponent": 1.0,
    }  # fmt: skip
    for ratio in (1e-2, 1e-3):
        setting = oscillator(options={"stop": True, "contact": "hunt_crossley"}, **stop)
        setting.values["damping"] = 2.0 * ratio * free * MASS
        [one] = backbones(setting, "mass", (2.9, 5.0), (0.01, 1.0), harmonics=31)
        assert one.amplitude[-1] == pytest.approx(100.0 * one.amplitude[0], rel=1e-4)
        assert np.ptp(one.frequency) < 1e-12 * expected
        np.testing.assert_allclose(one.frequency, expected, rtol=5e-3 * ratio**2 + 1e-12)


# --- the order of harmonic balance


def test_the_amplitude_of_a_strongly_nonlinear_motion_converges_with_the_harmonics():
    """The spring's cubic force is three times its linear one; a hundredth of the error is left by two more orders."""
    setting, level, frequency, errors = oscillator(CUBIC_STIFFNESS, k3=4e5), 5.0, 5.5, []
    state = None
    for harmonics in (1, 3, 5, 7, 9):
        response = balanced_response(setting, (2.5, frequency), [level], harmonics=harmonics, steps=2)
        one = max(response.branches, key=lambda branch: abs(branch.harmonics[0, 1, -1]))
        if state is None:
            state = shoot(map_at(setting, frequency, level), one.branch.states[-1]).state
        errors.append(abs(one.harmonics[0, 1, -1] / first_harmonic(setting, frequency, level, state) - 1.0))
    assert all(later < 0.01 * earlier for earlier, later in zip(errors[:-1], errors[1:], strict=True)), errors
    assert errors[-1] < 1e-11
