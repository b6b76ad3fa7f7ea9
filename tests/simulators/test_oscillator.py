"""The one-mass oscillator against closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from calib.effects.quadratic_drag import EFFECT as AIR_DRAG
from calib.errors import CalibError
from calib.modelling.model import Model
from calib.modelling.simulator import Request
from calib.records.excitation import Excitation
from calib.simulators.impact import kernel
from calib.simulators.oscillator import Oscillator
from calib.testing import SimulatorSuite

DECAY = Excitation("mass", "free decay")
TIMES = np.linspace(0.0, 2.0, 161)


def run(values, excitation=DECAY, request=None, hold="cubic", effects=()):
    record = Model(Oscillator(hold=hold, stop="gap" in values), effects).run(
        values, excitation, request or Request(times=TIMES)
    )
    assert record.attrs["status"] == "ok", record.attrs["reason"]
    return record


def recorded(quantity, time, value, **more):
    place = "base" if quantity == "base motion" else "mass"
    return Excitation(place, quantity, time=time, value=value, **more)


def decay(t, m, c, k, x, v):
    """Free motion by the matrix exponential's two roots, which are complex, real or one."""
    a, square = c / (2.0 * m), k / m - (c / (2.0 * m)) ** 2
    w = np.sqrt(complex(square))
    if w == 0.0:
        return np.exp(-a * t) * (x + (v + a * x) * t)
    return (np.exp(-a * t) * (x * np.cos(w * t) + (v + a * x) * np.sin(w * t) / w)).real


class TestConformance(SimulatorSuite):
    excitation = Excitation("mass", "force", frequency=4.0, amplitude=1.0)
    values = {"damping": 3.0, "gap": 1e-3, "restitution": 0.4}

    def make(self):
        return Oscillator(stop=True)


class TestConformanceOfPrescribedMotion(TestConformance):
    excitation = Excitation("mass", "displacement", frequency=4.0, amplitude=1e-3)

    @pytest.mark.parametrize("site", ["force", "excitation"])
    def test_a_law_acts_at_each_site(self, site):
        super().test_a_law_acts_at_each_site(site)

    test_a_spent_budget_is_a_status = None  # without a law that has internal states it takes no steps


@pytest.mark.parametrize(
    ("c", "k"), [(0.0, 400.0), (2.0, 400.0), (40.0, 400.0), (100.0, 400.0), (3.0, 0.0), (0.0, 0.0), (0.5, -4.0)]
)
def test_free_decay_under_critical_over_damped_and_without_spring(c, k):
    record = run({"damping": c, "stiffness": k, "initial_displacement": 0.01, "initial_velocity": -0.1})
    expected = decay(TIMES, 1.0, c, k, 0.01, -0.1)
    np.testing.assert_allclose(record.displacement[0], expected, rtol=0, atol=1e-13 + 1e-13 * abs(expected).max())


def test_a_constant_load_is_a_static_deflection_that_is_swung_into():
    record = run({"mass": 2.0, "damping": 4.0, "stiffness": 50.0, "load": 3.0})
    expected = 3.0 / 50.0 + decay(TIMES, 2.0, 4.0, 50.0, -3.0 / 50.0, 0.0)
    np.testing.assert_allclose(record.displacement[0], expected, rtol=0, atol=1e-14)


def test_a_free_mass_falls():
    record = run({"mass": 2.0, "damping": 0.0, "stiffness": 0.0, "load": 2.0 * 9.81, "initial_velocity": -1.0})
    np.testing.assert_allclose(record.displacement[0], -TIMES + 0.5 * 9.81 * TIMES**2, rtol=0, atol=1e-12)
    np.testing.assert_allclose(record.velocity[0], -1.0 + 9.81 * TIMES, rtol=0, atol=1e-12)


def test_a_damped_falling_mass_reaches_its_terminal_velocity():
    record = run({"mass": 2.0, "damping": 40.0, "stiffness": 0.0, "load": 2.0 * 9.81})
    np.testing.assert_allclose(
        record.velocity[0], 2.0 * 9.81 / 40.0 * (1.0 - np.exp(-20.0 * TIMES)), rtol=0, atol=1e-12
    )


@pytest.mark.parametrize("frequency", [0.5, 5.0, 30.0])
def test_the_steady_state_under_a_harmonic_force(frequency):
    excitation = Excitation("mass", "force", frequency=frequency, amplitude=3.0, phase=0.7)
    record = run({"mass": 2.0, "damping": 10.0, "stiffness": 900.0, "amplitude": 0.5}, excitation, Request())
    w = 2 * np.pi * frequency
    answer = 1.5 * np.exp(0.7j) / (900.0 - 2.0 * w**2 + 10j * w)
    turn = answer * np.exp(1j * w * record.time.values)
    np.testing.assert_allclose(record.displacement[0], turn.real, rtol=0, atol=1e-9 * abs(answer))
    np.testing.assert_allclose(record.velocity[0], (1j * w * turn).real, rtol=0, atol=1e-9 * w * abs(answer))
    np.testing.assert_allclose(record.section_displacement[0], answer.real, rtol=0, atol=1e-9 * abs(answer))


def test_the_steady_state_on_a_moving_base():
    excitation = Excitation("base", "base motion", frequency=5.0, amplitude=2e-3)
    record = run({"mass": 2.0, "damping": 10.0, "stiffness": 900.0}, excitation, Request())
    w = 2 * np.pi * 5.0
    answer = 2e-3 * (900.0 + 10j * w) / (900.0 - 2.0 * w**2 + 10j * w)
    expected = (answer * np.exp(1j * w * record.time.values)).real
    np.testing.assert_allclose(record.displacement[0], expected, rtol=0, atol=1e-9 * abs(answer))


@pytest.mark.parametrize(
    ("quantity", "hold", "order"),
    [("force", "cubic", 4), ("force", "linear", 2), ("force", "zero order", 1), ("base motion", "cubic", 4)],
)
def test_a_sampled_harmonic_converges_to_the_harmonic_with_the_order_of_its_hold(quantity, hold, order):
    w = 2 * np.pi * 3.0
    answer = 2e-3 * (900.0 + 10j * w if quantity == "base motion" else 1.0) / (900.0 - 2.0 * w**2 + 10j * w)
    values = {"mass": 2.0, "damping": 10.0, "stiffness": 900.0}
    errors = []
    for count in (80, 160):  # samples in 2 s; the input begins and ends outside the window that is looked at
        time = np.arange(-count // 4, count + count // 4) * (2.0 / count)
        turned = np.exp(1j * w * time[0])
        start = {"initial_displacement": (answer * turned).real, "initial_velocity": (1j * w * answer * turned).real}
        record = run(values | start, recorded(quantity, time, 2e-3 * np.cos(w * time)), hold=hold)
        errors.append(abs(record.displacement.values[0] - (answer * np.exp(1j * w * TIMES)).real).max())
    assert math.log2(errors[0] / errors[1]) > order - 0.3
    assert errors[1] < abs(answer) * {4: 2e-4, 2: 2e-2, 1: 0.3}[order]


def test_a_recorded_input_may_begin_before_time_zero_and_have_uneven_samples():
    time = np.sort(np.concatenate([[-0.5, 2.5], np.random.default_rng(1).uniform(-0.5, 2.5, 400)]))
    force = recorded("force", time, np.full(time.size, 5.0))
    record = run({"damping": 4.0, "stiffness": 50.0}, force)
    expected = 0.1 + decay(TIMES + 0.5, 1.0, 4.0, 50.0, -0.1, 0.0)
    np.testing.assert_allclose(record.displacement[0], expected, rtol=0, atol=1e-13)


def test_read_only_samples_and_times_compile_no_kernel_anew():
    times = np.linspace(0.0, 0.5, 101)
    force = np.sin(40.0 * times)

    def run(times, force):
        excitation = Excitation("mass", "force", time=times, value=force)
        state = np.array([1e-3, 0.0])
        state.flags.writeable = times.flags.writeable
        Model(Oscillator()).run({"mass": 1.0}, excitation, Request(times=times, initial_state=state))
        return list(kernel.advance.signatures)

    known = run(times, force)
    times.flags.writeable = force.flags.writeable = False
    assert run(times, force) == known


def test_the_servo_steps_as_a_second_order_system():
    gains = {"position_gain": 20.0, "velocity_gain": 30.0, "drive_constant": 5.0}
    reference = recorded("servo reference", TIMES, np.full(TIMES.size, 0.1))
    record = run({"mass": 10.0, "damping": 7.0, "stiffness": 0.0} | gains, reference)
    expected = 0.1 + decay(TIMES, 10.0, 7.0 + 150.0, 150.0 * 20.0, -0.1, 0.0)
    np.testing.assert_allclose(record.displacement[0], expected, rtol=0, atol=1e-14)


def test_a_bouncing_mass_meets_its_closed_form():
    g, e, height = 9.81, 0.7, 0.2
    times = np.linspace(0.0, 1.0, 301)
    values = {"mass": 3.0, "damping": 0.0, "stiffness": 0.0, "load": 3.0 * g, "gap": 0.05, "restitution": e}
    record = run(values | {"initial_displacement": 0.05 - height}, request=Request(times=times))
    first = math.sqrt(2 * height / g)
    speeds = g * first * e ** np.arange(record.impact_time.size)
    instants = first + np.concatenate([[0.0], np.cumsum(2.0 * speeds[1:] / g)])
    assert record.impact_time.size == np.sum(instants <= 1.0) >= 5
    np.testing.assert_allclose(record.impact_time, instants, rtol=0, atol=1e-11)
    np.testing.assert_allclose(record.impact_speed, speeds, rtol=0, atol=1e-10)
    last = np.searchsorted(instants, times, side="right") - 1
    flight = times - instants[last]
    expected = np.where(last < 0, height - 0.5 * g * times**2, speeds[last] * e * flight - 0.5 * g * flight**2)
    np.testing.assert_allclose(0.05 - record.displacement[0], expected, rtol=0, atol=1e-10)


def test_the_last_sample_is_one_of_the_motion_however_its_instant_is_rounded():
    """Pieces between impacts may end a rounding before the run: a twelfth of these motions lost their last sample."""
    times = np.arange(200) * 5e-3
    for gap in np.linspace(1.5e-3, 2.5e-3, 60):
        record = run({"damping": 2.0, "gap": gap, "initial_displacement": -4e-3}, request=Request(times=times))
        assert record.impact_time.size
        displacement, velocity = (record[channel].values[0, -3:] for channel in ("displacement", "velocity"))
        mean = (displacement[2] - displacement[1]) / 5e-3
        assert mean == pytest.approx((velocity[1] + velocity[2]) / 2.0, abs=1e-4)


def test_a_mass_that_has_bounced_out_rests_on_the_stop():
    values = {"damping": 0.0, "stiffness": 0.0, "load": 9.81, "gap": 0.05, "restitution": 0.5}
    record = run(values | {"initial_displacement": -0.05})
    np.testing.assert_allclose(record.displacement[0, -40:], 0.05, rtol=0, atol=1e-11)
    np.testing.assert_allclose(record.velocity[0, -40:], 0.0, rtol=0, atol=1e-9)


@pytest.mark.parametrize("e", [0.0, 0.3, 0.9, 1.0])
def test_energy_never_grows_without_excitation(e):
    record = run({"damping": 0.2, "gap": 2e-3, "restitution": e, "initial_velocity": 0.5})
    energy = 0.5 * record.velocity.values[0] ** 2 + 0.5 * 1000.0 * record.displacement.values[0] ** 2
    assert (np.diff(energy) <= 1e-12 * energy[0]).all()
    assert record.displacement.max() <= 2e-3 * (1 + 1e-9)


@pytest.mark.parametrize("driven", [False, True])
def test_a_drag_law_agrees_with_a_general_integrator(driven):
    values = {"mass": 2.0, "damping": 1.0, "stiffness": 300.0, "initial_displacement": 0.05, "c2": 6.0}
    time = np.linspace(0.0, 2.0, 801)
    force = 4.0 * np.sin(11.0 * time) * time
    excitation = recorded("force", time, force) if driven else DECAY
    record = run(values, excitation, effects=[AIR_DRAG])

    def rate(t, y):
        drive = 4.0 * np.sin(11.0 * t) * t if driven else 0.0
        return [y[1], (drive - 1.0 * y[1] - 300.0 * y[0]) / 2.0 - 6.0 * y[1] * abs(y[1])]

    peer = solve_ivp(rate, (0.0, 2.0), [0.05, 0.0], "DOP853", TIMES, rtol=1e-12, atol=1e-14, max_step=0.01)
    np.testing.assert_allclose(record.displacement[0], peer.y[0], rtol=0, atol=1e-7 * 0.05)
    np.testing.assert_allclose(record.velocity[0], peer.y[1], rtol=0, atol=1e-7)


def test_drag_alone_slows_a_free_mass_by_its_closed_form():
    record = run({"damping": 0.0, "stiffness": 0.0, "initial_velocity": 2.0, "c2": 3.0}, effects=[AIR_DRAG])
    np.testing.assert_allclose(record.velocity[0], 2.0 / (1.0 + 6.0 * TIMES), rtol=1e-9)


@pytest.mark.parametrize("number", [2, 7])
def test_as_many_force_laws_act_as_a_model_has(number):
    """A drag in so many parts, each an effect of its own, is the whole drag."""
    parts = [
        replace(AIR_DRAG, name=f"part {i}", parameters=(replace(AIR_DRAG.parameters[0], name=f"part_{i}"),))
        for i in range(number)
    ]
    values = {"damping": 1.0, "stiffness": 300.0, "initial_displacement": 0.05}
    shares = {f"part_{i}": 6.0 * (i + 1) / (0.5 * number * (number + 1)) for i in range(number)}
    whole, sum_of_parts = run({**values, "c2": 6.0}, effects=[AIR_DRAG]), run({**values, **shares}, effects=parts)
    np.testing.assert_allclose(sum_of_parts.displacement, whole.displacement, rtol=0, atol=1e-12 * 0.05)


@pytest.mark.parametrize(
    ("values", "status"),
    [
        ({"mass": 0.0}, "impossible value"),
        ({"mass": -1.0}, "impossible value"),
        ({"stiffness": math.inf}, "impossible value"),
        ({"gap": -math.inf}, "impossible value"),
        ({"damping": -1e3, "initial_velocity": 1.0}, "diverged"),
        ({"stiffness": -1e6, "initial_velocity": 1.0}, "diverged"),
        ({"stiffness": 1e300, "initial_velocity": 1.0}, None),
        ({"mass": 1e-300, "initial_velocity": 1.0}, None),
        ({"damping": 1e12, "initial_velocity": 1.0}, "ok"),
        ({"gap": -1e-3}, "ok"),
        ({"gap": 0.0, "restitution": 1.0}, "ok"),
    ],
)
def test_a_bad_motion_is_a_status(values, status):
    record = Model(Oscillator(stop="gap" in values)).run(values, DECAY, Request(times=TIMES, step_budget=100_000))
    assert record.attrs["status"] == status or status is None
    assert np.isfinite(record.displacement).all() if record.attrs["status"] == "ok" else record.attrs["reason"]


def test_what_it_cannot_take_is_refused():
    model = Model(Oscillator())
    force = recorded("force", TIMES, TIMES)
    with pytest.raises(CalibError, match="not driven by force at 'base'; it takes force at 'mass'"):
        model.run({}, Excitation("base", "force", frequency=1.0, amplitude=1.0))
    with pytest.raises(CalibError, match="unknown parameter 'gap'"):
        model.run({"gap": 1e-3}, DECAY, Request(times=TIMES))
    with pytest.raises(CalibError, match="did you mean 'linear'"):
        Oscillator(hold="liner")
    with pytest.raises(CalibError, match="input lasts from 0 to 2 s"):
        model.run({}, force, Request(times=np.linspace(0.0, 3.0, 11)))
    with pytest.raises(CalibError, match="must be at least two, and increase"):
        model.run({}, force, Request(times=np.array([0.0, 1.0, 1.0])))
    with pytest.raises(CalibError, match="state its output times"):
        model.run({}, DECAY)
    with pytest.raises(CalibError, match="no velocity, which the damper needs"):
        Model(Oscillator(hold="zero order")).run({}, recorded("base motion", TIMES, TIMES))
