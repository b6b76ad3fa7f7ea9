"""What every simulator has to fulfil, as tests that its author subclasses.

::

    class TestPendulum(SimulatorSuite):
        excitation = Excitation("pivot", "base motion", frequency=1.0, amplitude=0.01)

        def make(self):
            return Pendulum()

The suite needs pytest.
"""

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest

from calib.effect import Effect
from calib.errors import CalibError
from calib.excitation import Excitation
from calib.laws import excitation as excitation_law
from calib.laws import force, gap, restitution
from calib.model import Model, Request
from calib.parameter import Parameter
from calib.record import OK, SECTION, STATE, channels, check


@force
def steady_force(t, x, v, p, z, dz):
    """Return a constant force per unit mass [m/s^2]."""
    return p[0]


@gap
def wider(place, p):
    """Return a constant change of the gap [m]."""
    return p[0]


@restitution
def livelier(e, speed, p):
    """Return a constant change of the coefficient of restitution [1]."""
    return p[0]


@excitation_law
def second_harmonic(t, phase, amplitude, x, p):
    """Return a second harmonic of the drive [its unit]; p[0] is its share of the amplitude."""
    return p[0] * amplitude * math.cos(2.0 * phase)


PROBES = {"force": (steady_force, 1.0), "gap": (wider, 5e-5), "restitution": (livelier, 0.05),
          "excitation": (second_harmonic, 0.05)}  # law and a size that shows


class SimulatorSuite:
    """Subclass it, say how the simulator is made and driven, and pytest does the rest.

    Set `excitation` to a harmonic one and, where the default is not enough, `values` (name -> SI) to a motion in which
    every site has an effect: with impacts, where the simulator takes laws at `gap` or `restitution`.
    """

    excitation: Excitation
    values: dict[str, float] = {}
    request = Request(periods=2, samples=100)

    def make(self):
        """Return the simulator."""
        raise NotImplementedError("a subclass of SimulatorSuite says how its simulator is made")

    def run(self, *effects, request=None, excitation=None, **values):
        """Return the record of the suite's motion with some things changed."""
        model = Model(self.make(), effects)
        return model.run({**self.values, **values}, excitation or self.excitation, request or self.request)

    def test_the_record_keeps_the_schema(self):
        record = check(self.run())
        assert record.attrs["status"] == OK
        assert tuple(record.body.values) == tuple(self.make().bodies)

    def test_the_record_holds_whole_periods_from_phase_zero(self):
        record = self.run()
        step = 1.0 / self.excitation.frequency / self.request.samples
        expected = step * np.arange(self.request.periods * self.request.samples)
        np.testing.assert_allclose(record.time.values, expected, rtol=0, atol=1e-9 * step * expected.size)

    def test_the_same_values_give_the_same_bits(self):
        assert self.run().identical(self.run())

    def test_a_pickled_simulator_gives_the_same_bits(self):
        other = pickle.loads(pickle.dumps(self.make()))
        assert Model(other).run(self.values, self.excitation, self.request).identical(self.run())

    def test_velocity_is_the_rate_of_displacement(self):
        record = self.run()
        x, v = record["displacement"].values, record["velocity"].values
        step = np.diff(x, axis=1)
        error = np.abs(step - 0.5 * (v[:, 1:] + v[:, :-1]) * np.diff(record.time.values))
        # the median, since an impact between two samples is a jump that the trapezium rule cannot follow
        assert (np.median(error, axis=1) <= 0.01 * np.median(np.abs(step), axis=1)).all()

    def test_the_section_holds_the_last_64_periods(self):
        record = self.run()
        for channel in STATE:
            section = record[f"section_{channel}"]
            assert section.dims == ("body", "period")
            assert section.sizes["period"] >= SECTION

    def test_every_parameter_says_what_it_is(self):
        for p in self.make().parameters:
            assert p.unit, f"{p.name} has no unit ('1' for a pure number)"
            assert p.meaning, f"{p.name} has no meaning"
            assert p.low <= p.nominal <= p.high, f"{p.name}: nominal value {p.nominal} outside [{p.low}, {p.high}]"

    def test_a_value_that_is_no_number_is_a_status(self):
        for parameter in self.make().parameters:
            record = self.run(**{parameter.name: math.nan})
            if record.attrs["status"] == OK:  # the parameter has no say in this motion
                check(record, parameter.name)
            else:
                assert record.attrs["reason"], parameter.name

    def test_a_spent_budget_is_a_status(self):
        record = self.run(request=replace(self.request, step_budget=1))
        assert record.attrs["status"] == "step budget"
        assert record.attrs["reason"]

    def test_an_excitation_it_cannot_take_is_refused(self):
        with pytest.raises(CalibError, match="nowhere"):
            self.run(excitation=replace(self.excitation, place="nowhere"))

    @pytest.mark.parametrize("site", PROBES)
    def test_a_law_acts_at_each_site(self, site):
        if site not in self.make().sites:
            pytest.skip(f"the simulator takes no laws at {site!r}")
        law, size = PROBES[site]
        probe = Effect("probe", site, law, (Parameter("probe_size", "1", 0.0, "size", null=0.0),), meaning="a probe")
        plain, null, present = self.run(), self.run(probe), self.run(probe, probe_size=size)
        for channel in channels(plain):
            np.testing.assert_array_equal(null[channel].values, plain[channel].values)
        assert present.attrs["status"] == OK
        assert any((present[c].values != plain[c].values).any() for c in channels(plain))
