"""What has to hold before a residual is given a cause."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from calib.diagnosis import gates
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.fit import Fit
from calib.diagnosis.gates import above_noise, noise_known
from calib.diagnosis.noise import RESIDUAL, STATED, Noise
from calib.diagnosis.part import Part

SIZE = 500


def judged(ratio, size=SIZE):
    """The gate on a residual whose standard deviation is so many times its noise."""
    rows, time = (("mass", "displacement"),), np.arange(size) * 1e-3
    noise, ones = (Noise(1e-4, np.zeros(0), STATED),), np.ones((1, size))
    part = Part("decay", rows, time, ones, None, 1, (), noise, ones > 0.0, ones)
    residual = ratio * np.random.default_rng(1).standard_normal(size)
    none = np.zeros((size, 0))
    return above_noise(Evidence((part,)), Fit(None, (), residual, none, (), (), none, np.zeros(size, dtype=int)))


@pytest.mark.parametrize("ratio", [1.0, 0.95, 3.0])
def test_a_residual_about_or_above_its_noise_passes(ratio):
    assert judged(ratio).passed


def test_a_residual_far_below_its_noise_does_not():
    gate = judged(0.4)
    assert not gate.passed
    assert "decay mass displacement" in gate.summary
    assert "the stated uncertainty is too large" in gate.summary


def test_a_few_samples_say_nothing():
    assert judged(0.4, 20).passed


def test_sweeps_of_few_points_without_a_stated_noise_are_told_what_they_need():
    rows, number, ones = (("mass", "in_phase"),), np.arange(25.0), np.ones((1, 25))
    noise = Noise(1e-4, np.zeros(0), RESIDUAL)
    part = Part("low", rows, number, ones, None, 1, (), (noise,), ones > 0.0, ones, sweep=np.zeros(25))
    gate = noise_known(Evidence((part,)))
    assert not gate.passed
    assert gate.summary == "low: a noise level needs at least 32 points of a record of sweeps, or a stated one"
    assert noise_known(Evidence((replace(part, noise=(replace(noise, source=STATED),)),))).passed


def test_uncertainties_that_were_estimated_are_not_called_stated():
    rows, number, ones = (("mass", "in_phase"),), np.arange(25.0), np.ones((1, 25))
    noise, source = Noise(1e-4, np.zeros(0), STATED), "estimated by order tracking"
    part = Part("low", rows, number, ones, None, 1, (), (noise,), ones > 0.0, ones, sweep=np.zeros(25))
    stated, tracked = (noise_known(Evidence((one,))).summary for one in (part, replace(part, sigma_source=source)))
    assert stated == "low mass in_phase: 0.0001 (stated in the record)"
    assert tracked == f"low mass in_phase: 0.0001 ({source})"


class Left:
    """A fit that leaves so much beside the noise, and a finer solver that changes it along a direction of its own."""

    def __init__(self, changed, remainder, correlated=0.0):
        rng = np.random.default_rng(2)
        direction = rng.standard_normal(SIZE)
        self.difference = changed * direction / np.linalg.norm(direction)
        self.residual = rng.standard_normal(SIZE) * np.hypot(1.0, remainder) + correlated * self.difference
        none = np.zeros((SIZE, 0))
        self.point = SimpleNamespace(runs=lambda names, values, effects: [None], simulated={})
        self.fit = Fit(self.point, (), self.residual, none, (), (), none, np.zeros(SIZE, dtype=int))

    def gate(self, monkeypatch):
        view = SimpleNamespace(usable=True)
        monkeypatch.setattr(gates, "_answers", lambda pool, effects, runs: [(effects[0], {"decay": view})])
        evidence = SimpleNamespace(names=["decay"], difference=lambda one, other: self.difference)
        fitter = SimpleNamespace(evidence=evidence, effort=None, model=SimpleNamespace(simulator=None))
        step = SimpleNamespace(name="time_step", parameters=(), refusal=lambda simulator: "")
        return gates.converged(fitter, self.fit, [step], threshold=3.0, margin=0.0)[0]


def test_a_finer_solver_is_judged_by_all_that_the_fit_leaves(monkeypatch):
    assert not Left(changed=12.0, remainder=0.0).gate(monkeypatch).passed
    gate = Left(changed=12.0, remainder=20.0).gate(monkeypatch)
    assert gate.passed
    assert gate.z == pytest.approx(12.0 / 20.0, rel=0.1)


def test_a_misfit_that_the_solver_makes_does_not_hide_it(monkeypatch):
    assert Left(changed=300.0, remainder=0.0, correlated=1.0).gate(monkeypatch).z == pytest.approx(300.0, rel=0.1)
