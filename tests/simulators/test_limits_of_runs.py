"""Runs at their limits: many impacts, inputs on their own clock, growth, fast excitations, stiff internal states."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from simulators.four_dof_peer import spring_drive

from calib.effects.bouc_wen import EFFECT as BOUC_WEN
from calib.effects.coulomb_friction import EFFECT as COULOMB
from calib.effects.delayed_feedback import EFFECT as DELAYED_FEEDBACK
from calib.effects.phase_jitter import EFFECT as PHASE_JITTER
from calib.effects.presliding import EFFECT as PRESLIDING
from calib.effects.stribeck import EFFECT as STRIBECK
from calib.errors import CalibError
from calib.modelling.model import Model
from calib.modelling.simulator import Request
from calib.records.excitation import Excitation
from calib.simulators.delaminated_beam.impacts import IMPACTS
from calib.simulators.delaminated_beam.reduced.plan import ReducedTrace
from calib.simulators.delaminated_beam.stationary import Contact
from calib.simulators.four_dof import FourDof
from calib.simulators.oscillator import Oscillator

BOUNCING = {"mass": 1.0, "damping": 0.0, "stiffness": 0.0, "load": 1.0, "gap": 1.0, "restitution": 1.0}
FALL = np.sqrt(2.0)  # time to the stop  [s]
SLOW = {"mass": 1.0, "damping": 0.5, "stiffness": 40.0}
TIME = np.linspace(-0.5, 1.5, 2001)
RECORDED = Excitation("end", "displacement", time=TIME, value=1e-4 * np.sin(40.0 * np.pi * TIME) * (TIME > -0.4))


def test_a_record_holds_all_impacts_however_many():
    number = 5000
    times = np.linspace(0.0, 2.0 * FALL * number, 11)
    record = Model(Oscillator(stop=True)).run(BOUNCING, Excitation("mass", "free decay"), Request(times=times))
    expected = FALL * (2.0 * np.arange(number) + 1.0)
    assert record.impact_time.values == pytest.approx(expected, rel=1e-9)


def test_a_period_map_returns_all_impacts():
    values = {p.name: p.nominal for p in Oscillator(stop=True).parameters} | BOUNCING | {"amplitude": 0.0}
    drive = Excitation("mass", "force", frequency=1.0 / (2.0 * FALL * 300.5), amplitude=1.0)
    orbit = Oscillator(stop=True).period_map(values, drive, ()).orbit(np.zeros(2), 1)
    assert orbit.status == "ok"
    assert len(orbit.impacts) == 300 or len(orbit.impacts) == 301


def test_contact_of_a_beam_with_more_impacts_than_are_kept_is_refused():
    trace = ReducedTrace(
        times=np.zeros(0), samples=np.zeros((0, 5)), impacts=np.zeros((4, 2)), central=np.zeros((4, 2)),
        closed=np.zeros(1), total=np.zeros(5), nearest=np.zeros(0), passes=np.zeros(3),
    )  # fmt: skip
    trace.total[IMPACTS] = 4
    assert len(Contact.of(trace, 0.0, 1.0).impacts) == 4
    trace.total[IMPACTS] = 5
    with pytest.raises(CalibError, match="5 impacts, of which only 4"):
        Contact.of(trace, 0.0, 1.0)


def test_a_recorded_drive_keeps_its_clock():
    record = Model(FourDof()).run({}, RECORDED, Request(times=TIME))
    assert record.attrs["status"] == "ok"
    np.testing.assert_array_equal(record.time.values, TIME)
    later = Excitation("end", "displacement", time=TIME + 0.5, value=RECORDED.as_samples.value)
    expected = Model(FourDof()).run({}, later, Request())
    np.testing.assert_allclose(record.displacement.values, expected.displacement.values, atol=1e-11)
    part = Model(FourDof()).run({}, RECORDED, Request())
    assert part.time.values[0] == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(part.displacement.values, record.displacement.values[:, TIME >= 0.0], atol=1e-11)


@pytest.mark.parametrize("times", [np.linspace(0.0, 3.0, 301), np.linspace(-2.0, 1.0, 301), np.linspace(1.0, 0.0, 101)])
def test_output_times_that_a_recorded_drive_does_not_cover_are_refused(times):
    with pytest.raises(CalibError, match="output"):
        Model(FourDof()).run({}, RECORDED, Request(times=times))


def test_a_motion_without_clearance_does_not_diverge():
    drive = Excitation("end", "displacement", frequency=26.24, amplitude=5e-3)
    closed, nearly = (
        Model(FourDof()).run({"gap": gap, "restitution": 0.3}, drive, Request(periods=2, samples=50, settle=60))
        for gap in (0.0, 1e-8)
    )
    assert closed.attrs["status"] == "ok", closed.attrs["reason"]
    assert abs(closed.velocity.values).max() == pytest.approx(abs(nearly.velocity.values).max(), rel=1e-3)


def test_a_free_decay_without_clearance_does_not_diverge():
    initial = np.array([1e-3, 0.0, 2e-3, 0.0, 0.0, 0.0, 0.0, 0.0])
    request = Request(times=np.linspace(0.0, 0.2, 101), initial_state=initial)
    record = Model(FourDof()).run({"gap": 0.0, "restitution": 0.3}, Excitation("end", "free decay"), request)
    assert record.attrs["status"] == "ok", record.attrs["reason"]


@pytest.mark.parametrize("begin", [1e-3, 1e-9])
def test_a_motion_that_grows_to_a_limit_cycle_does_not_diverge(begin):
    values = {
        "mass": 1.0, "damping": 0.0, "stiffness": 900.0, "gap": 5e-3, "restitution": 0.5,
        "initial_displacement": begin, "feedback_damping": -4.0, "feedback_delay": 1e-3,
    }  # fmt: skip
    model = Model(Oscillator(stop=True), [DELAYED_FEEDBACK])
    record = model.run(values, Excitation("mass", "free decay"), Request(times=np.linspace(0.0, 20.0, 2001)))
    assert record.attrs["status"] == "ok", record.attrs["reason"]
    assert abs(record.displacement.values[0, -500:]).max() == pytest.approx(7.603e-3, rel=1e-3)


def test_a_fast_jitter_of_a_slow_drive_is_resolved():
    """The mean of cos(w t + sin(W t)) over a fast tone W is J0(1) cos(w t); the oscillator does not follow W."""
    drive, request = (
        Excitation("mass", "force", frequency=0.1, amplitude=1.0),
        Request(periods=1, samples=200, settle=0),
    )
    jitter = {"jitter_sin": 1.0, "jitter_frequency": 50.0}
    coarse = Model(Oscillator(), [PHASE_JITTER]).run({**SLOW, **jitter}, drive, request)
    fine = Model(Oscillator().finer("time_step", 128.0), [PHASE_JITTER]).run({**SLOW, **jitter}, drive, request)
    size = abs(fine.displacement.values).max()
    np.testing.assert_allclose(coarse.displacement.values, fine.displacement.values, atol=1e-5 * size)


def test_friction_that_slips_in_much_less_than_a_step_is_constant():
    """A free mass that slides at v0 against Dahl's friction F comes by x = v0 t - F t^2 / 2."""
    values = {
        "mass": 1.0, "damping": 0.0, "stiffness": 0.0, "initial_velocity": 3.0, "dahl_force": 2.0,
        "dahl_distance": 2e-6,
    }  # fmt: skip
    times = np.linspace(0.0, 1.0, 51)
    record = Model(Oscillator(), [PRESLIDING]).run(values, Excitation("mass", "free decay"), Request(times=times))
    assert record.attrs["status"] == "ok", record.attrs["reason"]
    np.testing.assert_allclose(record.displacement.values[0], 3.0 * times - times**2, atol=1e-5)


@pytest.mark.parametrize("distance", [1e-6, 1e-8])
@pytest.mark.parametrize(
    ("effect", "named"),
    [
        (PRESLIDING, {"dahl_force": 2.0, "dahl_distance": 1.0}),
        (STRIBECK, {"stribeck_force": 2.0, "stribeck_rise": 0.0, "stribeck_distance": 1.0}),
        (BOUC_WEN, {"hysteresis_force": 2.0, "hysteresis_distance": 1.0}),
    ],
    ids=lambda one: getattr(one, "name", ""),
)
def test_friction_whose_stroke_is_many_yield_displacements_costs_steps_at_its_reversals_alone(effect, named, distance):
    """On a spring each half swing then loses 2 F / k, as with Coulomb's friction; up to 1e7 distances a swing.

    The friction builds up while the mass moves by the distance from rest, in a time of the order of its square root.
    """
    force, stiffness, start = 2.0, 100.0, 0.11  # N, N/m, m: turns at -0.07 m and 0.03 m
    values = {"mass": 1.0, "damping": 0.0, "stiffness": stiffness, "initial_displacement": start}
    values |= {name: value * distance if name.endswith("distance") else value for name, value in named.items()}
    times = np.linspace(0.0, 0.27 * np.pi, 109)
    request = Request(times=times, step_budget=int(40 / np.sqrt(distance)))
    record = Model(Oscillator(), [effect]).run(values, Excitation("mass", "free decay"), request)
    assert record.attrs["status"] == "ok", record.attrs["reason"]
    half, loss = np.floor(10.0 * times / np.pi), force / stiffness
    side = np.where(half % 2 == 0, 1.0, -1.0)
    exact = side * loss + (start - (2.0 * half + 1.0) * loss) * side * np.cos(10.0 * times - half * np.pi)
    np.testing.assert_allclose(record.displacement.values[0], exact, atol=0.5 * np.sqrt(distance))


def test_friction_of_a_long_stroke_is_that_of_an_implicit_method():
    values = {"mass": 1.0, "damping": 0.0, "stiffness": 100.0, "initial_displacement": 0.11}
    times = np.linspace(0.0, 0.5, 51)
    record = Model(Oscillator(), [PRESLIDING]).run(
        values | {"dahl_force": 2.0, "dahl_distance": 1e-5}, Excitation("mass", "free decay"), Request(times=times)
    )

    def rates(t, y):
        x, v, z = y
        return v, -100.0 * x - 2.0 * z, (v - z * abs(v)) / 1e-5

    known = solve_ivp(rates, (0.0, 0.5), [0.11, 0.0, 0.0], "Radau", times, rtol=1e-10, atol=1e-13)
    np.testing.assert_allclose(record.displacement.values[0], known.y[0], atol=1e-9)


@pytest.mark.parametrize("speed", [1e-3, 1e-5])
def test_friction_that_sticks_takes_few_steps_and_is_that_of_an_implicit_method(speed):
    """Force below that of friction: the mass creeps at about the speed over which friction builds up."""
    values = {**SLOW, "friction": 20.5, "friction_slip": speed}
    drive = Excitation("mass", "force", frequency=1.0, amplitude=20.0)
    request = Request(periods=2, samples=50, settle=0, step_budget=20_000)
    record = Model(Oscillator(), [COULOMB]).run(values, drive, request)
    assert record.attrs["status"] == "ok", record.attrs["reason"]

    def rates(t, y):
        x, v = y
        load = 20.0 * np.cos(2.0 * np.pi * t) - values["damping"] * v - values["stiffness"] * x
        return v, (load - 20.5 * np.tanh(v / speed)) / values["mass"]

    known = solve_ivp(rates, (0.0, 2.0), [0.0, 0.0], "Radau", record.time.values, rtol=1e-10, atol=1e-9 * speed)
    np.testing.assert_allclose(record.displacement.values[0], known.y[0], atol=1e-5 * speed)
    np.testing.assert_allclose(record.velocity.values[0], known.y[1], atol=1e-4 * speed)


@pytest.mark.slow
@pytest.mark.parametrize(("size", "budget"), [(20.0, 100_000), (200.0, 200_000)])
def test_friction_on_each_of_four_bodies_is_that_of_an_implicit_method(size, budget):
    """Bodies stick and slide by turns, at the larger friction one of them never slides."""
    values = {p.name: p.nominal for p in FourDof.parameters} | {"gap": 1.0, "friction": size, "friction_slip": 1e-4}
    drive = Excitation("end", "displacement", frequency=26.0, amplitude=1e-3)
    request = Request(periods=1, samples=50, settle=0, step_budget=budget)
    record = Model(FourDof(), [COULOMB]).run(values, drive, request)
    assert record.attrs["status"] == "ok", record.attrs["reason"]
    mass, stiffness, damping, load = spring_drive(values, 1e-3)

    def rates(t, y):
        pull = np.array([load * np.cos(2.0 * np.pi * 26.0 * t), 0.0, 0.0, 0.0])
        linear = np.linalg.solve(mass, pull - damping @ y[4:] - stiffness @ y[:4])
        return np.concatenate([y[4:], linear - size * np.tanh(y[4:] / 1e-4)])

    times = record.time.values
    known = solve_ivp(rates, (0.0, times[-1]), np.zeros(8), "Radau", times, rtol=1e-9, atol=1e-13)
    np.testing.assert_allclose(record.displacement.values, known.y[:4], atol=1e-8)


def test_friction_that_asks_for_too_many_steps_ends_with_the_step_budget():
    values = {**SLOW, "dahl_force": 2.0, "dahl_distance": 1e-5}
    request = Request(periods=1, samples=50, settle=0, step_budget=1000)
    drive = Excitation("mass", "force", frequency=1.0, amplitude=20.0)
    record = Model(Oscillator(), [PRESLIDING]).run(values, drive, request)
    assert (record.attrs["status"], record.sizes["time"]) == ("step budget", 0)
