"""A straight line, measured once with noise: the smallest problem that fits and suspects are tested on."""

from types import SimpleNamespace

import numpy as np

from calib.modelling.parameter import Parameter, Window

TIME = np.linspace(0.0, 4.0, 400)
WINDOWS = {"height": Window(0.0, 100.0), "rate": Window(0.01, 5.0)}
MODEL = SimpleNamespace(parameters={name: Parameter(name, "1", 1.0, "") for name in WINDOWS})
TRUE = {"height": 40.0, "rate": 0.7}
START = {"height": 30.0, "rate": 0.5}


def straight(values):
    return values["height"] + values["rate"] * 10.0 * TIME


class Evidence:
    """One record of one channel with noise of unit standard deviation."""

    names, parts = ("record",), (SimpleNamespace(name="record", is_swept=False),)

    def __init__(self, measured):
        self.measured = measured

    def residual(self, seen):
        return self.measured - seen["record"].rows[0]

    def difference(self, one, other):
        return other["record"].rows[0] - one["record"].rows[0]

    def tangents(self, seen):
        return np.zeros((self.measured.size, 0))

    def initial_moves(self, seen, residual):
        return {}

    def rows(self):
        return np.zeros(self.measured.size, dtype=int)
