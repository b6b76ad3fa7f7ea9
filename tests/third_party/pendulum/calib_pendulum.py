"""A small pendulum on a pivot that is shaken sideways: a simulator by a third party, in one file."""

import math

import numpy as np

from calib.errors import CalibError
from calib.modelling.parameter import Parameter
from calib.records import failed, make

G = 9.80665  # m/s^2
SECTION = 64  # periods


class Pendulum:
    """The stationary response of the bob, relative to the room, for small angles.

    x'' + 2 zeta w (x' - y') + w^2 (x - y) = 0 with w^2 = g / length and the pivot's motion y = A cos(2 pi F t).
    """

    name = "pendulum"
    bodies = ("bob",)
    parameters = (
        Parameter("length", "m", 1.0, "length of the pendulum", low=0.0),
        Parameter("damping", "1", 0.05, "damping ratio", low=0.0),
    )
    sites = frozenset()

    def run(self, values, excitation, laws, request):
        """Return the record of the stationary motion, in closed form."""
        if (excitation.place, excitation.quantity) != ("pivot", "base motion") or excitation.recorded:
            raise CalibError(
                "the pendulum takes a harmonic base motion at the pivot, "
                f"got {excitation.quantity} at {excitation.place}"
            )
        if request.step_budget < request.periods * request.samples:
            return failed(self.bodies, "step budget", f"{request.periods * request.samples} samples were asked for")
        w2, zeta = G / values["length"] if values["length"] > 0.0 else math.nan, values["damping"]
        if not (math.isfinite(w2) and zeta > 0.0):
            return failed(self.bodies, "diverged", "no stationary motion: length and damping must be positive")
        drive = 2.0 * math.pi * excitation.frequency
        elastic = w2 + 2j * zeta * math.sqrt(w2) * drive
        response = elastic / (elastic - drive**2) * excitation.amplitude * np.exp(1j * excitation.phase)
        n = request.periods * request.samples
        time = np.arange(n) / request.samples / excitation.frequency
        motion = response * np.exp(1j * drive * time)
        record = make(
            time,
            self.bodies,
            {"displacement": motion.real[None], "velocity": (1j * drive * motion).real[None]},
            frequency=excitation.frequency,
            amplitude=excitation.amplitude,
            place=excitation.place,
            quantity=excitation.quantity,
        )
        once = {"displacement": response.real, "velocity": (1j * drive * response).real}
        sections = {f"section_{c}": (("body", "period"), np.full((1, SECTION), x)) for c, x in once.items()}
        return record.assign(sections)
