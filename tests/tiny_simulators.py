"""Simulators of no physics for the tests of everything around simulators: an echo, and maps in closed form."""

import os
import time

import numpy as np
from dynamics.plain_maps import bistable, henon

from calib import records
from calib.errors import CalibError
from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.parameter import Parameter
from calib.records import failed
from calib.records.excitation import Excitation
from calib.simulators.oscillator import Oscillator

SECTION = 64  # periods
DRIVE = Excitation("base", "base motion", frequency=10.0, amplitude=1e-3)


@force(states=1)
def remembered(t, x, v, p, z, dz):
    """Force of a thing that remembers; `Mapped` has its own way with it."""
    return p[0] * z[0]


MEMORY = Effect("memory", "force", remembered, (Parameter("lag", "s", 0.0, "of memory", null=0.0),), "it remembers")


class Undeclared(Oscillator):
    """An oscillator that does not say which of its parameters are the initial state."""

    initial = {}


class Echo:
    """One body that follows its base with a gain and a second harmonic, and misbehaves on request.

    Parameters
    ----------
    fault : "" | "raises" | "nan" | "hangs" | "dies" | "waits": what it does where the gain lies above `above`
    above : [1]
    gate : path of the file for whose end it waits
    """

    name = "echo"
    bodies = ("mass",)
    sites = frozenset()
    excitations = (("base motion", "base"),)
    parameters = (
        Parameter("gain", "1", 1.0, "displacement of the mass over that of the base", low=0.0),
        Parameter("harmonic", "m", 0.0, "amplitude of the second harmonic"),
    )

    def __init__(self, fault: str = "", above: float = np.inf, gate: str = ""):
        self.fault = fault
        self.above = above
        self.gate = gate

    def run(self, values, excitation, laws, request):
        if values["gain"] > self.above:
            self._misbehave(self.fault)
        n = request.periods * request.samples
        t = np.arange(n) * excitation.period / request.samples
        w = 2.0 * np.pi * excitation.frequency
        a, b = values["gain"] * excitation.amplitude, values["harmonic"]
        x = a * np.cos(w * t) + b * np.cos(2.0 * w * t)
        v = -a * w * np.sin(w * t) - 2.0 * b * w * np.sin(2.0 * w * t)
        if self.fault == "nan" and values["gain"] > self.above:
            x[n // 2] = np.nan
        record = records.make(
            t, self.bodies, {"displacement": x[None], "velocity": v[None]}, frequency=excitation.frequency
        )
        record["section_displacement"] = (("body", "period"), np.full((1, SECTION), a + b))
        record["section_velocity"] = (("body", "period"), np.zeros((1, SECTION)))
        return record

    def _misbehave(self, fault):
        if fault == "raises":
            raise RuntimeError("the echo broke")
        if fault == "hangs":
            time.sleep(3600.0)
        if fault == "dies":
            os._exit(11)
        while fault == "waits" and os.path.exists(self.gate):
            time.sleep(0.02)


class Mute(Echo):
    """An echo that forgets to return its record."""

    def run(self, values, excitation, laws, request):
        super().run(values, excitation, laws, request)


class Sketch(Echo):
    """An echo whose gain comes out too large, with an exact one to confirm it; the faults are those of the exact one.

    Parameters
    ----------
    bias : what is added to the gain  [1]
    faults : arguments of `Echo`
    """

    name = "sketch"

    def __init__(self, bias: float = 0.05, **faults):
        super().__init__()
        self.bias = bias
        self.confirming = Echo(**faults)

    def run(self, values, excitation, laws, request):
        return super().run({**values, "gain": values["gain"] + self.bias}, excitation, laws, request)


class Doubled(Echo):
    """An echo whose motion has two periods where the gain lies above 1, and which fails on request.

    Parameters
    ----------
    fails_above : second harmonic from which it diverges  [m]
    """

    name = "doubled"

    def __init__(self, fails_above: float = np.inf):
        super().__init__()
        self.fails_above = fails_above

    def run(self, values, excitation, laws, request):
        if values["harmonic"] > self.fails_above:
            return failed(self.bodies, "diverged", "too much of the second harmonic")
        record = super().run(values, excitation, laws, request)
        if values["gain"] > 1.0:
            record["section_displacement"] = record["section_displacement"] * (-1.0) ** np.arange(SECTION)
        return record


class Mapped(Echo):
    """An echo with a period map in closed form: Henon's, or a bistable one; its faults are those of the map.

    Parameters
    ----------
    map : "henon" or "bistable"
    faults : "raises" | "hangs" | "dies" | "impossible" | "refuses" | "waits" -> the values of a or push at which the
        map does so
    traps : the same -> the state at which it does so
    gate : path of the file for whose end a map waits
    """

    name = "mapped"
    bodies = ("body",)
    sites = frozenset({"force"})
    parameters = (
        Parameter("a", "1", 0.2, "nonlinearity of Henon's map, times the excitation in units of 10 Hz and 1 mm"),
        Parameter("b", "1", 0.3, "memory of Henon's map", low=-1.0, high=1.0),
        Parameter("push", "N", 0.0, "load of the bistable map"),
        Parameter("period", "s", 0.0, "nothing, under a name that a sweep has itself"),
        *Echo.parameters,
    )

    def __init__(self, map="henon", faults=None, traps=None, gate=""):
        super().__init__(gate=gate)
        self.map = map
        self.faults = faults or {}
        self.traps = traps or {}

    def period_map(self, values, excitation, laws, phase):
        if not excitation.harmonic:
            raise CalibError("the map is of a harmonic excitation")
        for fault, places in self.faults.items():
            if np.isclose([values["a"], values["push"]], np.array(places)[:, None], atol=1e-9).any():
                self._misbehave(fault)
        if self.map == "bistable":
            return self._trapped(bistable(values["push"]))
        map = henon(values["a"] * excitation.frequency / 10.0 * excitation.amplitude / 1e-3, values["b"])
        return _slowed(map) if laws else map

    def _misbehave(self, fault):
        super()._misbehave(fault)
        if fault == "impossible":
            raise ValueError("a mass of 0 kg")
        if fault == "refuses":
            raise CalibError("such a value is not taken")

    def _trapped(self, map):
        plain = map.function

        def function(x):
            for fault, trap in self.traps.items():
                if x.tolist() == list(trap):
                    self._misbehave(fault)
            return plain(x)

        map.function = function
        return map


def _slowed(map):
    """Give a map a state more, as a law with a state of its own does: it remembers where the body was."""
    plain = map.function
    map.function, map.derivative = lambda x: np.array([*plain(x[:2]), x[0]]), None
    map.names, map.units = (*map.names, "memory.0"), (*map.units, "1")
    map.initial, map.scale = np.array([*map.initial, 0.0]), np.ones(3)
    return map
