"""What every effect has to fulfil, as tests that its author subclasses.

::

    class TestAirDrag(EffectSuite):
        effect = EFFECT
        present = {"c2": 0.5}

The suite needs pytest: `calib[testing]`.
"""

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from calib.modelling.effect import Effect
from calib.modelling.model import Model
from calib.modelling.simulator import Request, Simulator
from calib.plugins import load
from calib.records import channels
from calib.records.excitation import Excitation
from calib.records.response import is_response, make_response, parts_of


class EffectSuite:
    """Subclass it, name the effect and values at which it is `present`, and pytest does the rest.

    The effect is tried on the simulator `four_dof` in a motion with impacts, unless `make` gives another one (with its
    own `excitation` and `values`); one that is explicit in time is tried in a motion that begins, one of the site
    "response" on `response`. An effect of the noise is looked for in no record, and one that is not differentiable at
    its null need not fade in proportion.
    """

    effect: Effect
    present: dict[str, float]
    excitation = Excitation("end", "displacement", frequency=26.24, amplitude=1.5e-3)
    values: dict[str, float] = {"restitution": 0.05}
    request = Request(periods=1, samples=200)
    response = make_response(
        np.array([9.0, 10.0, 11.0]), ["mass"], np.array([[1.0, -1.0j, -1.0]]) * 1e-3, 2.0, "N", place="mass",
        quantity="force", higher={2: np.array([[0.3j, -0.2, 0.1]]) * 1e-3},
    )  # fmt: skip
    least = 1e-6  # change of a channel over its range that the present effect makes at least  [1]

    def make(self) -> Simulator:
        """Return the simulator on which the effect is tried."""
        return load("calib.simulators", "four_dof")()

    def run(self, *effects: Effect, **values: float) -> xr.Dataset:
        """Return the record with some effects, of the site "response" the response."""
        model, own = Model(self.make(), effects), {**self.values, **values}
        if self.effect.site == "response":
            return model.measured_response(self.response, own)
        request = replace(self.request, settle=0) if self.effect.transient else self.request
        return model.run(own, self.excitation, request)

    def largest_change(self, **values: float) -> float:
        """Return the largest change of any channel against the model without the effect, in units of its range [1]."""
        plain, with_it = self.run(), self.run(self.effect, **values)
        compared = parts_of(plain) if is_response(plain) else channels(plain)
        return max(float(np.abs(with_it[c] - plain[c]).max() / np.ptp(plain[c].values)) for c in compared)

    def test_it_is_absent_at_its_null_value(self) -> None:
        plain, null = self.run(), self.run(self.effect, **self.effect.null)
        assert list(null.data_vars) == list(plain.data_vars)
        for name in plain.data_vars:
            np.testing.assert_array_equal(null[name].values, plain[name].values)

    def test_it_shows_where_it_is_present(self) -> None:
        change = self.largest_change(**self.present)
        assert change == 0.0 if self.effect.noise else change > self.least

    def test_it_fades_towards_its_null_value(self) -> None:
        if not self.effect.differentiable:
            pytest.skip("it is not differentiable at its null")
        near = dict(self.present)
        for name, null in self.effect.null.items():
            near[name] = null + 1e-3 * (near[name] - null)
        assert self.largest_change(**near) < 0.1 * self.largest_change(**self.present)

    def test_it_says_what_it_is(self) -> None:
        assert self.effect.meaning
        for parameter in self.effect.parameters:
            assert parameter.unit
            assert parameter.meaning
            assert math.isfinite(parameter.nominal) or parameter.nominal == parameter.null
        assert self.effect.equation

    def test_it_survives_a_pickle(self) -> None:
        assert pickle.loads(pickle.dumps(self.effect)) == self.effect
