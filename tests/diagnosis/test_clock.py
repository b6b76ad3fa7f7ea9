"""Clocks of recorders: what a wrong rate does to a simulated record."""

import numpy as np
import pytest

from calib.diagnosis.bench import Bench, Run
from calib.diagnosis.clock import CLOCK_RATE_STD, clock_slopes, time_derivative
from calib.diagnosis.fit import Fit
from calib.diagnosis.noise import STATED, Noise
from calib.diagnosis.part import Part
from calib.execution.pool import InProcess
from calib.modelling.model import Model
from calib.modelling.simulator import Request
from calib.objective import Objective, Reference, Term
from calib.plugins import load
from calib.records import make
from calib.records.excitation import Excitation

MODEL = Model(load("calib.simulators", "oscillator")())
VALUES = {**MODEL.nominal, "mass": 1.0, "damping": 2.0, "stiffness": 4000.0, "initial_displacement": 1e-3}
TRUE = np.arange(600) / 400.0  # s
RATE = 50e-6  # by which the recorder's clock is slow: it stamps t / (1 + RATE)
ROWS = [("mass", "displacement"), ("mass", "velocity")]


def sampled(kind, times):
    """Excitation of a record whose samples were taken at TRUE, with the instants that its clock gave them  [s]."""
    if kind == "recorded":
        return Excitation("mass", "force", time=times, value=np.sin(2.0 * np.pi * (5.0 * TRUE + 4.0 * TRUE**2)))
    if kind == "steady tone":
        return Excitation("mass", "force", frequency=9.0, amplitude=1.0)
    return Excitation("mass", "free decay")


def bench(excitation, times):
    displacement = np.sin(60.0 * times)[None]  # what it holds plays no part
    record = make(times, ["mass"], {"displacement": displacement, "velocity": displacement.copy()}, status="ok")
    reference = Reference("one", record, "calibrate", excitation=excitation, request=Request(times=times))
    return Bench(MODEL, Objective({"one": reference}, [Term(load("calib.features", "time_history")())]), {"one": ROWS})


@pytest.mark.parametrize("kind", ["recorded", "free decay"])
def test_a_slow_clock_does_to_a_record_what_its_slope_says(kind):
    stamped = TRUE / (1.0 + RATE)
    made, right = bench(sampled(kind, stamped), stamped), bench(sampled(kind, TRUE), TRUE)
    seen, truth = made(Run("one", VALUES)), right(Run("one", VALUES))
    with InProcess(made) as pool:
        slope = clock_slopes(pool, made, {"one": seen}, VALUES)["one"]
    wrong = truth.rows - seen.rows
    assert np.abs(wrong).max() > 1e-5 * np.abs(truth.rows).max()
    assert np.linalg.norm(wrong - RATE * slope) < 0.03 * np.linalg.norm(wrong)


def test_an_input_that_the_same_clock_sampled_hides_less_than_a_clock_alone():
    made = bench(sampled("recorded", TRUE), TRUE)
    seen = made(Run("one", VALUES))
    with InProcess(made) as pool:
        slope = clock_slopes(pool, made, {"one": seen}, VALUES)["one"]
    alone = np.gradient(seen.rows, TRUE, axis=1) * TRUE
    assert np.linalg.norm(slope[0]) < 0.7 * np.linalg.norm(alone[0])


def test_the_clock_beside_a_steady_tone_is_a_nuisance_and_has_no_slope():
    made = bench(sampled("steady tone", TRUE), TRUE)
    seen = made(Run("one", VALUES))
    with InProcess(made) as pool:
        assert clock_slopes(pool, made, {"one": seen}, VALUES) == {}


@pytest.mark.parametrize("level", [1.0, 60.0])
@pytest.mark.parametrize("share", [0.0, 0.3])
def test_an_error_of_the_model_hides_the_clock_and_is_not_made_larger_by_it(level, share):
    """The errors of a size whose signature is mostly that of the clock, against those that draws show.

    level : of what the model leaves, over the stated noise; share : of the signature that is none of the clock's
    """
    time = np.arange(2000) / 100.0
    clock = 6e4 * time * np.cos(40.0 * time)  # a standard deviation of the rate changes the record by some 1000
    alone = np.abs(time - 10.0) * np.sin(23.0 * time)
    column = clock / np.linalg.norm(clock) + share * alone / np.linalg.norm(alone)
    ones, noise = np.ones((1, time.size)), (Noise(1.0, np.zeros(0), STATED),)
    rng, found, errors = np.random.default_rng(5), [], []
    for _ in range(100):
        measured = level * rng.standard_normal(time.size) + CLOCK_RATE_STD * rng.standard_normal() * clock
        part = Part("decay", ROWS[:1], time, measured[None], None, 1, (), noise, ones > 0.0, ones, clock[None])
        for _ in range(2):  # by the noise as it is stated, then beside what is left
            signature, residual = part.white(column[None]), part.white(measured[None])
            size = signature @ residual / (signature @ signature)
            fit = Fit(
                None, (), residual - size * signature, signature[:, None], ("size",), (), np.zeros((time.size, 0)),
                np.zeros(time.size, dtype=int),
            )  # fmt: skip
            part = part.with_remainder(fit.residual)
        found.append(size)
        errors.append(fit.error(["size"])[0])
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(np.std(found), rel=0.25)
    assert np.mean(np.abs(found) < 2.0 * np.array(errors)) >= 0.88


@pytest.mark.parametrize("deviation", [0.0, 1.0, 1.7])
def test_a_clock_that_an_error_of_the_model_hid_counts_again_once_that_is_explained(deviation):
    time = np.arange(2000) / 100.0
    clock = 6e4 * time * np.cos(40.0 * time)
    ones, noise = np.ones((1, time.size)), (Noise(1.0, np.zeros(0), STATED),)
    left = np.random.default_rng(1).standard_normal(time.size) + deviation * CLOCK_RATE_STD * clock
    part = Part("decay", ROWS[:1], time, left[None], None, 1, (), noise, ones > 0.0, ones, clock[None], 1e8)
    assert part.clock_share < 0.1
    again = part.with_remainder(part.white(left[None]))
    assert again.clock_share > 0.99
    assert np.sum(again.white(left[None]) ** 2) < time.size + 3.0 * np.sqrt(2.0 * time.size)


@pytest.mark.parametrize(("per_period", "left"), [(4, 0.35), (8, 0.04), (20, 0.002)])
def test_the_derivative_over_time_is_that_of_the_motion(per_period, left):
    time = np.arange(40 * per_period) / per_period
    phase = 2.0 * np.pi * time
    found = time_derivative(time, np.sin(phase)[None])[0]
    exact = 2.0 * np.pi * np.cos(phase)
    assert np.sqrt(np.mean((found - exact) ** 2)) < left * np.sqrt(np.mean(exact**2))
