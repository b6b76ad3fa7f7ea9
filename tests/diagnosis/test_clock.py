"""Clocks of recorders: what a wrong rate does to a simulated record."""

import numpy as np
import pytest

from calib.diagnosis.bench import Bench, Run
from calib.diagnosis.clock import clock_slopes
from calib.excitation import Excitation
from calib.model import Model, Request
from calib.objective import Objective, Reference, Term
from calib.plugins import load
from calib.pool import InProcess
from calib.record import make

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
