"""A simulator of no physics for the tests of everything around simulators: an echo of its excitation."""

import os
import time

import numpy as np

from calib import record as records
from calib.parameter import Parameter

SECTION = 64  # periods


class Echo:
    """One body that follows its base with a gain and a second harmonic, and misbehaves on request.

    Parameters
    ----------
    fault : "" | "raises" | "nan" | "hangs" | "dies": what it does where the gain lies above `above`
    above : [1]
    """

    name = "echo"
    bodies = ("mass",)
    sites = frozenset()
    excitations = (("base motion", "base"),)
    parameters = (
        Parameter("gain", "1", 1.0, "displacement of the mass over that of the base", low=0.0),
        Parameter("harmonic", "m", 0.0, "amplitude of the second harmonic"),
    )

    def __init__(self, fault: str = "", above: float = np.inf):
        self.fault = fault
        self.above = above

    def run(self, values, excitation, laws, request):
        if values["gain"] > self.above:
            self._misbehave()
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

    def _misbehave(self):
        if self.fault == "raises":
            raise RuntimeError("the echo broke")
        if self.fault == "hangs":
            time.sleep(3600.0)
        if self.fault == "dies":
            os._exit(11)
