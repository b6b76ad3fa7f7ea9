"""The minimal model: the figures of its default set, the laws of physics, the contract of a simulator."""

import os
import pickle
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.linalg import eigh

from calib import records
from calib.errors import CalibError
from calib.modelling.laws import BoundLaw
from calib.modelling.laws import excitation as excitation_law
from calib.modelling.laws import restitution as restitution_law
from calib.modelling.model import Model
from calib.modelling.simulator import Request
from calib.records.excitation import Excitation
from calib.simulators.four_dof import FourDof
from calib.simulators.four_dof.drives import DRIVES, structure
from calib.simulators.four_dof.lumped import lumped
from calib.simulators.impact import kernel
from calib.simulators.impact.initial_state import start
from calib.simulators.impact.modes import modal
from calib.simulators.impact.problem import IMPACTS, STEPS
from calib.simulators.impact.scratch import scratch
from calib.testing.simulator_suite import SimulatorSuite

PERIOD = 1.0 / 26.24  # s
MODEL = Model(FourDof())
NOMINAL = MODEL.nominal


def shaker(amplitude=1.5e-3, frequency=26.24, phase=0.0):
    return Excitation("end", "displacement", frequency=frequency, amplitude=amplitude, phase=phase)


def advance(problem, state, periods=1, capacity=10_000, budget=10**9):
    """Sections (periods, 10) and impacts (n, 10) of some periods more."""
    rows, impacts = np.zeros((periods, 10)), np.zeros((capacity, 10))
    before = int(state.counters[IMPACTS])
    code = kernel.advance(
        problem, state, scratch(problem), periods, 0.0, budget, rows, np.zeros(0), np.zeros((0, 10)), impacts
    )
    assert code == kernel.DONE
    return rows, impacts[before : int(state.counters[IMPACTS])]


def frequencies(stiffness, mass):
    return np.sqrt(np.maximum(eigh(stiffness, mass)[0], 0.0)) / (2.0 * np.pi)


# the default set


def test_masses_and_stiffnesses_of_the_default_set():
    body = lumped(NOMINAL)
    assert np.diag(body.mass) == pytest.approx([0.317937, 0.0731981, 0.0161036, 0.317937], rel=2e-6)
    k = body.stiffness
    assert [k[0, 0], k[0, 1], k[0, 2], k[0, 3], k[1, 1], k[2, 2]] == pytest.approx(
        [159877.904, -112999.794, -1203.222, 55469.134, 127449.036, 1357.077], rel=5e-7
    )
    assert body.spring == pytest.approx(1.598779e6, rel=1e-6)
    assert (k == k.T).all()


def test_frequencies_of_the_default_set():
    body = lumped(NOMINAL)
    hold = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 1.0, 0], [0, 0, 1.0]])
    held = body.stiffness + np.diag([body.spring, 0.0, 0.0, 0.0])
    assert frequencies(body.stiffness, body.mass) == pytest.approx([26.24, 48.12, 91.20, 245.75], abs=6e-3)
    assert frequencies(held, body.mass) == pytest.approx([45.23, 62.72, 221.32, 379.64], abs=6e-3)
    in_contact = [hold.T @ a @ hold for a in (held, body.mass)]
    assert frequencies(*in_contact) == pytest.approx([60.18, 206.12, 378.52], abs=6e-3)
    assert frequencies(hold.T @ body.stiffness @ hold, in_contact[1]) == pytest.approx([26.55, 91.20, 230.19], abs=6e-3)


def test_linear_amplitudes_of_the_default_set():
    record = MODEL.run({"gap": 1.0}, shaker())
    amplitudes = 0.5e3 * np.ptp(record.displacement.values[:, -400:], axis=1)
    assert amplitudes == pytest.approx([1.500, 2.702, 3.926, 1.500], abs=2e-3)
    assert record.impact_time.size == 0


# laws of physics


@given(e=st.floats(0.0, 1.0), gap=st.floats(2e-4, 1.2e-3))
@example(e=1e-6, gap=0.0007364657305301982)  # rounding grows most there
@settings(max_examples=15, deadline=None)
def test_an_impact_turns_the_relative_velocity_by_e(e, gap):
    """A run that starts at the impact with the velocities that the law gives goes on as the one that came to it."""
    values = {**NOMINAL, "restitution": e, "gap": gap}
    problem = FourDof().problem(values, shaker())
    _, impacts = advance(problem, start(problem, np.zeros(4), np.zeros(4)), 3)
    before, later = impacts[0], impacts[1:]
    assert before[1] == pytest.approx(before[7] - before[8], rel=1e-12)
    assert before[4] - before[3] == pytest.approx(-gap, rel=1e-9)
    after = before[6:].copy()
    after[2] += (1.0 + e) * (before[7] - before[8])  # paper, eq. (2)
    there = FourDof().problem(values, shaker(phase=2.0 * np.pi * 26.24 * before[0]))
    _, again = advance(there, start(there, before[2:6], after), 3)
    expected, found = (hits[hits[:, 1] > 1e-2][:3] for hits in (later, again))
    assert len(expected) == len(found) == 3
    assert found[:, 0] + before[0] == pytest.approx(expected[:, 0], abs=1e-8)  # 1500 draws differ by 6.5e-10 s
    assert found[:, 1] == pytest.approx(expected[:, 1], rel=1e-5)  # and by 1e-6


@given(e=st.floats(0.0, 1.0), seed=st.integers(0, 1000))
@settings(max_examples=25, deadline=None)
def test_energy_stays_between_impacts_without_excitation_and_damping(e, seed):
    rng = np.random.default_rng(seed)
    initial = np.concatenate([rng.uniform(-1e-3, 1e-3, 4), rng.uniform(-0.3, 0.3, 4)])
    initial[2] = initial[1] + abs(initial[2])
    values = {"restitution": e, "damping": 0.0, "gap": 5e-4}
    times = np.linspace(0.0, 0.5, 5000)
    record = MODEL.run(values, Excitation("end", "free decay"), Request(times=times, initial_state=initial))
    assert record.attrs["status"] == "ok"
    body = lumped(NOMINAL)
    stiffness = body.stiffness + np.diag([body.spring, 0.0, 0.0, 0.0])
    q, v = record.displacement.values, record.velocity.values
    energy = 0.5 * np.einsum("it,ij,jt->t", v, body.mass, v) + 0.5 * np.einsum("it,ij,jt->t", q, stiffness, q)
    hits = np.searchsorted(times, record.impact_time.values)
    free = np.ones(len(times) - 1, dtype=bool)
    free[np.clip(hits - 1, 0, len(free) - 1)] = False
    assert np.abs(np.diff(energy))[free].max() < 1e-10 * energy.max()


@pytest.mark.parametrize(("e", "gap"), [(0.05, 1e-3), (0.5, 1e-3), (0.3, 2e-4)])
def test_the_motion_depends_on_the_ratio_of_amplitude_and_gap_only(e, gap):
    one = MODEL.run({"restitution": e, "gap": gap}, shaker(), Request(settle=10, periods=2))
    two = MODEL.run({"restitution": e, "gap": 2 * gap, "amplitude": 2.0}, shaker(), Request(settle=10, periods=2))
    assert two.displacement.values == pytest.approx(2.0 * one.displacement.values, abs=1e-9)


def test_the_map_of_a_period_does_not_know_which_period_it_is():
    problem = FourDof().problem({**NOMINAL, "restitution": 0.5}, shaker())
    state = start(problem, np.zeros(4), np.zeros(4))
    rows, _ = advance(problem, state, 7)
    a, _ = advance(problem, state, 1)
    later = start(problem, rows[-1, :4], rows[-1, 4:8])
    b, _ = advance(problem, later, 1)
    assert a == pytest.approx(b, rel=1e-12)


@pytest.mark.parametrize("e", [0.05, 0.2, 0.5, 0.9])
def test_phase_space_shrinks_by_the_damping_and_grows_by_the_impacts(e):
    """The determinant of the period map is e^(2 N) exp(-2 sum(zeta w) T), whatever the masses."""
    values = {**NOMINAL, "restitution": e}
    period = FourDof().period_map(values, shaker(), ())
    x = period.orbit(period.initial, 301).states[-1]
    scale = np.repeat([1e-3, 0.1], 4)

    def image(x):
        orbit = period.orbit(x, 1)
        return orbit.states[0], len(orbit.impacts)

    _, count = image(x)
    jacobian = np.zeros((8, 8))
    for j in range(8):
        h = np.zeros(8)
        h[j] = 1e-5 * scale[j]
        terms = [(1, 0.75), (2, -0.15), (3, 1.0 / 60.0)]  # central differences of order six
        images = [(image(x + k * h), image(x - k * h), c) for k, c in terms]
        assert {n for a, b, _ in images for n in (a[1], b[1])} == {count}
        jacobian[:, j] = sum(c * (a[0] - b[0]) for a, b, c in images) / 1e-5 / scale
    assert count > 0
    w = 2.0 * np.pi * frequencies(*_stiffness_and_mass())
    expected = e ** (2 * count) * np.exp(-2.0 * NOMINAL["damping"] * w.sum() * PERIOD)
    assert np.linalg.det(jacobian) == pytest.approx(expected, rel=1e-6)


def _stiffness_and_mass():
    free = structure(DRIVES["spring"], lumped(NOMINAL), modal(0.004), 1e-3, 0.05)
    return free.stiffness, free.mass


def test_contact_is_kept_until_its_force_comes_down_to_zero():
    record = MODEL.run({"restitution": 0.2, "gap": 2e-4}, shaker(), Request(periods=1, samples=4000))
    r = 2e-4 + record.displacement.values[2] - record.displacement.values[1]
    assert r.min() > -1e-15
    assert 0.05 < record.attrs["contact_fraction"] < 0.5
    assert np.mean(r < 1e-14) == pytest.approx(record.attrs["contact_fraction"], abs=2e-3)


# fixed step


@pytest.mark.slow
def test_the_fixed_step_converges_with_order_one():
    exact = MODEL.run({"restitution": 0.05}, shaker())
    errors = []
    steps = np.array([500.37, 1000.37, 2000.37, 4000.37, 8000.37])
    for n in steps:
        record = Model(FourDof(mode="fixed_step", steps_per_period=n)).run(
            {"restitution": 0.05}, shaker(), Request(settle=300, periods=8)
        )
        q = record.displacement.values[:, :2400]
        errors.append(np.sqrt(np.mean((q - exact.displacement.values) ** 2)))
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert slope == pytest.approx(-1.0, abs=0.3)


# every drive, every kind of excitation


@pytest.mark.parametrize("drive", DRIVES)
def test_every_drive_gives_a_record(drive):
    kind = DRIVES[drive]
    amplitude = {"force": 0.5, "centre": 0.92e-3}.get(drive, 1.5e-3)
    model = Model(FourDof(drive=drive))
    record = model.run({}, Excitation(kind.place, kind.quantity, frequency=26.51, amplitude=amplitude, phase=0.3))
    records.check(record)
    assert record.attrs["status"] == "ok"
    assert record.section_displacement.shape[1] >= 64
    t = record.time.values
    for body in kind.prescribed:
        assert record.displacement.values[body] == pytest.approx(
            amplitude * np.cos(2 * np.pi * 26.51 * t + 0.3), abs=1e-12
        )
    r = 1e-3 + record.displacement.sel(body="q3") - record.displacement.sel(body="q2")
    assert float(r.min()) > -1e-12


def test_velocity_is_the_rate_of_displacement():
    for drive in ("spring", "centre"):
        kind = DRIVES[drive]
        record = Model(FourDof(drive=drive)).run(
            {"gap": 1.0},
            Excitation(kind.place, kind.quantity, frequency=26.24, amplitude=1e-3),
            Request(periods=1, samples=4000),
        )
        q, v = record.displacement.values, record.velocity.values
        rate = np.gradient(q, record.time.values, axis=1)
        assert rate[:, 1:-1] == pytest.approx(v[:, 1:-1], abs=1e-5 * np.abs(v).max())


def test_time_zero_is_phase_zero_of_the_drive():
    record = MODEL.run({}, shaker(phase=1.0))
    same = MODEL.run({}, shaker())
    n = 400
    shift = 1.0 / (2.0 * np.pi) * n
    moved = np.interp(np.arange(n) + shift, np.arange(2 * n), same.displacement.values[2, : 2 * n])
    assert record.displacement.values[2, :n] == pytest.approx(moved, abs=2e-6)


def test_a_recorded_drive_gives_the_same_as_the_harmonic_it_samples():
    t = np.linspace(0.0, 8 * PERIOD, 8 * 400 + 1)
    x = 1.5e-3 * np.cos(2.0 * np.pi * t / PERIOD)
    recorded = MODEL.run({"restitution": 0.3}, Excitation("end", "displacement", time=t, value=x))
    harmonic = MODEL.run({"restitution": 0.3}, shaker(), Request(settle=0, periods=8))
    assert recorded.displacement.values[:, :-1] == pytest.approx(harmonic.displacement.values, abs=2e-8)
    assert recorded.impact_time.values == pytest.approx(harmonic.impact_time.values, abs=1e-6)


# laws


@excitation_law
def more(t, phase, amplitude, x, p):
    """Change the drive by a share of itself."""
    return p[0] * x


@restitution_law
def by_speed(e, speed, p):
    """Take the coefficient down with the speed."""
    return -p[0] * speed


@pytest.mark.parametrize("drive", ["spring", "rigid", "symmetric", "centre"])
def test_a_law_of_the_excitation_does_what_a_larger_drive_does(drive):
    kind = DRIVES[drive]
    law = BoundLaw("excitation", more.function, np.array([0.1, 0, 0, 0, 0, 0, 0, 0]))
    excitation = Excitation(kind.place, kind.quantity, frequency=26.24, amplitude=0.9e-3)
    values = {**NOMINAL, "gap": 0.5e-3, "restitution": 0.05}
    request = Request(settle=100, periods=2)
    simulator = FourDof(drive=drive)
    by_law = simulator.run(values, excitation, [law], request)
    larger = simulator.run({**values, "amplitude": 1.1}, excitation, [], request)
    assert by_law.impact_time.values == pytest.approx(larger.impact_time.values, abs=1e-7)
    assert by_law.displacement.values == pytest.approx(larger.displacement.values, abs=1e-9)


def test_a_law_of_restitution_is_asked_at_each_impact_and_clipped():
    def run(values, *p):
        numbers = np.zeros(8)
        numbers[: len(p)] = p
        laws = [BoundLaw("restitution", by_speed.function, numbers)] if p else []
        return FourDof().run({**NOMINAL, **values}, shaker(), laws, Request(settle=300, periods=1))

    harder = run({"restitution": 0.15}, 0.2)
    speed = float(harder.impact_speed[0])
    same = run({"restitution": 0.15 - 0.2 * speed})
    assert speed == pytest.approx(float(same.impact_speed[0]), rel=1e-6)
    assert run({"restitution": 0.15}, 1e3).displacement.identical(run({"restitution": 0.0}).displacement)


# contract


class TestConformance(SimulatorSuite):
    excitation = Excitation("end", "displacement", frequency=26.24, amplitude=1.5e-3)

    def make(self):
        return FourDof()


class TestConformanceOfTheFixedStep(TestConformance):
    request = Request(settle=100, periods=2, samples=100)  # grid errors that do not repeat keep it from settling

    def make(self):
        return FourDof(mode="fixed_step")


def test_the_same_values_give_the_same_bits_also_after_pickling():
    a = MODEL.run({"restitution": 0.5}, shaker())
    b = Model(pickle.loads(pickle.dumps(FourDof()))).run({"restitution": 0.5}, shaker())
    assert a.identical(b)


def test_a_fixed_count_of_settling_periods_is_obeyed():
    record = MODEL.run({}, shaker(), Request(settle=17, periods=3))
    assert record.attrs["settled_periods"] == 17
    assert record.section_displacement.shape[1] >= 64


ABSURD = [
    {"gap": float("nan")},
    {"gap": 0.0},
    {"gap": -1e-3},
    {"gap": float("inf")},
    {"restitution": 1.0},
    {"restitution": 0.0},
    {"damping": 0.0},
    {"damping": -0.5},
    {"damping": 5.0},
    {"layer_stiffness": -100.0},
    {"layer_mass": 0.0},
    {"layer_mass": -1.0},
    {"delamination": 2.0},
    {"width": 1e-300},
    {"density": 1e300},
    {"amplitude": 1e12},
    {"amplitude": 0.0},
    {"drive_stiffness": 1e9},
    {"reference_frequency": 0.0},
    {"stiffness_factor": 0.0},
    {"stiffness_factor": -1.0},
]


@pytest.mark.parametrize("values", ABSURD, ids=str)
@pytest.mark.parametrize("mode", ["exact", "fixed_step"])
def test_absurd_values_end_with_a_status(values, mode):
    record = Model(FourDof(mode=mode)).run(values, shaker(), Request(step_budget=2_000_000))
    status = record.attrs["status"]
    assert status in ("ok", "diverged", "step budget")
    if status == "ok":
        assert np.isfinite(record.displacement.values).all()
    else:
        assert record.attrs["reason"]


def test_a_spent_budget_is_a_status():
    record = MODEL.run({"restitution": 0.5}, shaker(), Request(step_budget=1000))
    assert record.attrs["status"] == "step budget"


def test_what_it_cannot_take_is_refused():
    with pytest.raises(CalibError, match="did you mean 'centre'"):
        FourDof(drive="center")
    with pytest.raises(CalibError, match="choose another drive"):
        MODEL.run({}, Excitation("centre", "displacement", frequency=26.24, amplitude=1e-3))
    with pytest.raises(CalibError, match="8 numbers"):
        MODEL.run({}, shaker(), Request(initial_state=np.zeros(4)))
    with pytest.raises(CalibError, match="no period: state its output times"):
        MODEL.run({}, Excitation("end", "free decay"))


@pytest.mark.slow
def test_it_runs_without_the_compiler():
    code = (
        "from calib.simulators.four_dof import FourDof; from calib.modelling.model import Model;"
        "from calib.modelling.simulator import Request;"
        "from calib.records.excitation import Excitation; from calib.effects.quadratic_drag import EFFECT;"
        "x = Excitation('end', 'displacement', frequency=26.24, amplitude=1.5e-3);"
        "values = {'c2': VALUE, 'restitution': 0.3};"
        "r = Model(FourDof(), [EFFECT]).run(values, x, Request(settle=1, periods=1, samples=20));"
        "print(r.impact_time.values.tolist())"
    )
    times = []
    for value, jit in (("0.0", "1"), ("0.0", "0"), ("0.5", "1"), ("0.5", "0")):
        out = subprocess.run(
            [sys.executable, "-c", code.replace("VALUE", value)],
            env={**os.environ, "NUMBA_DISABLE_JIT": jit}, capture_output=True, text=True, check=True, timeout=300,
        )  # fmt: skip
        times.append(eval(out.stdout))
    assert times[0] == pytest.approx(times[1], abs=1e-12)
    assert times[2] == pytest.approx(times[3], abs=1e-12)
    assert times[0] != times[2]


def test_an_undriven_body_costs_no_more_than_a_look_at_the_stop():
    problem = FourDof().problem({**NOMINAL, "amplitude": 0.0}, shaker())
    state = start(problem, np.zeros(4), np.zeros(4))
    advance(problem, state, 10)
    assert state.counters[STEPS] <= 30
