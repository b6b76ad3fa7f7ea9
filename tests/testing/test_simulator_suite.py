"""The suite of simulators fails where a simulator drops the internal states of force laws."""

import numpy as np
import pytest

from calib import records
from calib.errors import CalibError
from calib.modelling.parameter import Parameter
from calib.records.excitation import Excitation
from calib.testing import SimulatorSuite
from calib.testing import simulator_suite as suite

STEPS = 40  # a period


class Sprung:
    """A mass on a spring and a damper with force laws in plain Python; `keeps` says whether their states are kept."""

    name = "sprung"
    bodies = ("mass",)
    sites = frozenset({"force"})
    parameters = (Parameter("stiffness", "N/m", 4000.0, "of the spring", low=0.0),)

    def __init__(self, keeps=True):
        self.keeps = keeps

    def run(self, values, excitation, laws, request):
        y, step = np.zeros(2 + 4 * len(laws)), excitation.period / STEPS
        omega = 2.0 * np.pi * excitation.frequency
        states = []
        for n in range(STEPS * (20 + request.periods)):
            states.append(y[:2])
            middle = y + 0.5 * step * self.rates(n * step, y, values, excitation, laws, omega)
            y = y + step * self.rates((n + 0.5) * step, middle, values, excitation, laws, omega)
        x, v = np.array(states[-STEPS * request.periods :]).T
        section = np.array(states[::STEPS])[:, :, None]
        return records.make(
            np.arange(x.size) * step, self.bodies, {"displacement": x[None], "velocity": v[None]},
            section={"displacement": section[:, 0].T, "velocity": section[:, 1].T}, frequency=excitation.frequency,
        )  # fmt: skip

    def rates(self, t, y, values, excitation, laws, omega):
        x, v, inner = y[0], y[1], np.zeros((len(laws), 4))
        a = excitation.amplitude * np.cos(omega * t) - values["stiffness"] * x - 5.0 * v
        for law, z, dz in zip(laws, y[2:].reshape(-1, 4), inner, strict=True):
            a += law.function(t, x, v, law.p, z, dz)
        return np.array([v, a, *(self.keeps * inner).ravel()])


class Checked(SimulatorSuite):
    """The suite of a simulator that is made elsewhere."""

    excitation = Excitation("mass", "force", frequency=9.0, amplitude=1.0)

    def __init__(self, simulator):
        self.simulator = simulator

    def make(self):
        return self.simulator


def test_a_simulator_that_integrates_internal_states_passes():
    Checked(Sprung()).test_internal_states_of_a_force_law_are_integrated()


def test_a_simulator_that_drops_internal_states_fails_with_the_remedy():
    with pytest.raises(AssertionError, match="integrate the rates .* or declare law_states = 0"):
        Checked(Sprung(keeps=False)).test_internal_states_of_a_force_law_are_integrated()


def test_a_simulator_that_declares_no_internal_states_passes_and_refuses_the_effect():
    simulator = Sprung(keeps=False)
    simulator.law_states = 0
    Checked(simulator).test_internal_states_of_a_force_law_are_integrated()
    with pytest.raises(CalibError, match="takes no force laws with internal states"):
        Checked(simulator).run(suite.MAXWELL)


def test_a_simulator_that_takes_every_input_for_harmonic_fails_with_the_remedy():
    with pytest.raises(AssertionError, match="a recorded input raises TypeError.*`excitation.harmonic`"):
        Checked(Sprung()).test_a_recorded_input_is_simulated_or_refused()


def test_a_simulator_that_refuses_a_recorded_input_passes():
    class HarmonicSprung(Sprung):
        def run(self, values, excitation, laws, request):
            if not excitation.harmonic:
                raise CalibError("a harmonic force is needed")
            return super().run(values, excitation, laws, request)

    Checked(HarmonicSprung()).test_a_recorded_input_is_simulated_or_refused()
