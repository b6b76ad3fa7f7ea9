"""What every simulator has to fulfil, as tests that its author subclasses.

::

    class TestPendulum(SimulatorSuite):
        excitation = Excitation("pivot", "base motion", frequency=1.0, amplitude=0.01)

        def make(self) -> Simulator:
            return Pendulum()

The suite needs pytest: `calib[testing]`.
"""

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from calib.errors import CalibError
from calib.modelling.effect import Effect, interfaces_of, places_of
from calib.modelling.laws import STATES, contact, force, gap, restitution
from calib.modelling.laws import excitation as excitation_law
from calib.modelling.model import Model
from calib.modelling.orbit import PeriodMap, SampledMap
from calib.modelling.parameter import Parameter
from calib.modelling.simulator import Request, Simulator
from calib.records import MIN_SECTION_PERIODS, OK, STATE, channels, check
from calib.records.excitation import Excitation


@force
def steady_force(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return a constant force per unit mass [m/s^2]."""
    return p[0]


@force(states=1)
def maxwell_element(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the force of a spring in series with a damper, per unit mass [m/s^2]; z[0] is the spring's length [m]."""
    dz[0] = v - z[0] / p[1]
    return -p[0] * z[0]


@gap
def wider(place: float, p: np.ndarray) -> float:
    """Return a constant change of the gap [m]."""
    return p[0]


@contact
def cushion(place: float, clearance: float, rate: float, pressure: float, p: np.ndarray) -> float:
    """Return a pressure between sides that are nearer than 0.1 mm [Pa]."""
    return p[0] if clearance < 1e-4 else 0.0


@restitution
def livelier(e: float, speed: float, p: np.ndarray) -> float:
    """Return a constant change of the coefficient of restitution [1]."""
    return p[0]


@excitation_law
def second_harmonic(t: float, phase: float, amplitude: float, x: float, p: np.ndarray) -> float:
    """Return a second harmonic of the drive [its unit]; p[0] is its share of the amplitude."""
    return p[0] * amplitude * math.cos(2.0 * phase)


PROBES = {
    "force": (steady_force, 1.0),
    "gap": (wider, 5e-5),
    "contact": (cushion, 100.0),
    "restitution": (livelier, 0.05),
    "excitation": (second_harmonic, 0.05),
}  # law and a size that shows
MAXWELL = Effect(
    "maxwell_element",
    "force",
    maxwell_element,
    (
        Parameter("maxwell_stiffness", "1/s^2", 0.0, "stiffness of the spring per unit mass", null=0.0),
        Parameter("maxwell_time", "s", 0.1, "time in which the spring relaxes"),
    ),
    meaning="a spring in series with a damper",
)
MAXWELL_STIFFNESS = 1.0  # 1/s^2, that shows
RECORDED_PERIODS, RECORDED_SAMPLES = 4, 100  # of the harmonic as a recorded input; samples a period


class SimulatorSuite:
    """Subclass it, say how the simulator is made and driven, and pytest does the rest.

    Set `excitation` to a harmonic one and, where the default is not enough, `values` (name -> SI) to a motion in which
    every site has an effect: with impacts, where the simulator takes laws at `gap`, `contact` or `restitution`.
    """

    excitation: Excitation
    values: dict[str, float] = {}
    request = Request(periods=2, samples=100)

    def make(self) -> Simulator:
        """Return the simulator."""
        raise NotImplementedError("a subclass of SimulatorSuite says how its simulator is made")

    def run(
        self, *effects: Effect, request: Request | None = None, excitation: Excitation | None = None, **values: float
    ) -> xr.Dataset:
        """Return the record of the suite's motion with some things changed."""
        model = Model(self.make(), effects)
        return model.run({**self.values, **values}, excitation or self.excitation, request or self.request)

    def test_the_record_keeps_the_schema(self) -> None:
        record = check(self.run())
        assert record.attrs["status"] == OK
        assert tuple(record.body.values) == tuple(self.make().bodies)

    def test_the_record_holds_whole_periods_from_phase_zero(self) -> None:
        record = self.run()
        step = self.excitation.as_harmonic.period / self.request.samples
        expected = step * np.arange(self.request.periods * self.request.samples)
        np.testing.assert_allclose(record.time.values, expected, rtol=0, atol=1e-9 * step * expected.size)

    def test_the_same_values_give_the_same_bits(self) -> None:
        assert self.run().identical(self.run())

    def test_a_pickled_simulator_gives_the_same_bits(self) -> None:
        other = pickle.loads(pickle.dumps(self.make()))
        assert Model(other).run(self.values, self.excitation, self.request).identical(self.run())

    def test_velocity_is_the_rate_of_displacement(self) -> None:
        record = self.run()
        x, v = record["displacement"].values, record["velocity"].values
        step = np.diff(x, axis=1)
        error = np.abs(step - 0.5 * (v[:, 1:] + v[:, :-1]) * np.diff(record.time.values))
        # the median, since an impact between two samples is a jump that the trapezium rule cannot follow
        assert (np.median(error, axis=1) <= 0.01 * np.median(np.abs(step), axis=1)).all()

    def test_the_section_holds_the_last_64_periods(self) -> None:
        record = self.run()
        for channel in STATE:
            section = record[f"section_{channel}"]
            assert section.dims == ("body", "period")
            assert section.sizes["period"] >= MIN_SECTION_PERIODS

    # --- the period map, where the simulator offers one

    def period_map(self, phase: float = 0.0, **values: float) -> PeriodMap:
        """Return the map at the suite's values with some changed, or skip where the simulator refuses to give one."""
        try:
            return Model(self.make()).period_map({**self.values, **values}, self.excitation, phase)
        except CalibError as refusal:
            pytest.skip(str(refusal))

    def test_the_map_describes_its_state(self) -> None:
        map = self.period_map()
        size = len(map.names)
        assert len(set(map.names)) == size
        assert len(map.units) == size
        assert map.initial.shape == map.scale.shape == (size,)
        assert (map.scale > 0.0).all()
        assert tuple(map.bodies) == tuple(self.make().bodies)
        assert map.period == pytest.approx(self.excitation.period, rel=1e-12)

    def test_the_map_s_orbit_is_the_motion_of_the_record(self) -> None:
        map, record = self.period_map(), self.run(request=replace(self.request, settle=40))
        orbit = map.orbit(map.initial, 40)
        for channel in STATE:
            start = record[channel].isel(time=0).values
            size = np.abs(record[channel].values).max()
            np.testing.assert_allclose(getattr(orbit, channel)[:, -1], start, atol=1e-6 * size)

    def test_the_map_s_samples_are_the_motion_of_the_record(self) -> None:
        map = self.period_map()
        if not isinstance(map, SampledMap):
            pytest.skip("the map does not tell the motion between its sections")
        record = self.run(request=replace(self.request, settle=40))
        periods, samples = self.request.periods, self.request.samples
        displacement = map.motion(map.orbit(map.initial, 40).states[-1], periods, samples)
        size = np.abs(record.displacement.values).max()
        np.testing.assert_allclose(displacement, record.displacement.values, atol=1e-6 * size)

    def test_the_map_in_two_calls_is_the_map_in_one(self) -> None:
        map = self.period_map()
        whole = map.orbit(map.initial, 6).states
        halves = map.orbit(map.orbit(map.initial, 3).states[-1], 3).states
        np.testing.assert_allclose(halves / map.scale, whole[3:] / map.scale, atol=1e-6)
        np.testing.assert_array_equal(map.orbit(map.initial, 6).states, whole)

    def test_the_map_s_impacts_lie_in_its_periods(self) -> None:
        map = self.period_map()
        impacts = map.orbit(map.initial, 20).impacts
        assert impacts.shape[1:] == (3,)
        assert ((impacts[:, 0] >= 0) & (impacts[:, 0] < 20) & (impacts[:, 0] % 1.0 == 0.0)).all()
        assert ((impacts[:, 1] >= 0.0) & (impacts[:, 1] < 1.0)).all()
        assert (impacts[:, 2] >= 0.0).all()
        assert map.impacting or not len(impacts)
        assert map.impacting or not len(map.near_misses(map.initial))

    def test_the_map_s_derivative_is_that_of_its_orbit(self) -> None:
        map = self.period_map()
        state = map.orbit(map.initial, 10).states[-1]
        size, step = len(state), 1e-5
        carried = map.tangent(state, np.eye(size), 1)
        if carried is None:
            pytest.skip("the map does not know its derivative")
        ends = [(map.orbit(state + step * map.scale * u, 1), map.orbit(state - step * map.scale * u, 1))
                for u in np.eye(size)]  # fmt: skip
        expected = np.array([(a.states[0] - b.states[0]) / (2.0 * step * map.scale) for a, b in ends]).T
        derivative = carried.vectors @ carried.growth[0]
        np.testing.assert_allclose(derivative, expected, atol=1e-4 * np.abs(expected).max())

    def test_a_section_at_another_phase_is_of_the_same_motion(self) -> None:
        map = self.period_map(0.25)
        record = self.run(request=replace(self.request, settle=400))
        orbit = map.orbit(map.initial, 400)
        if (np.abs(orbit.states[-1] - orbit.states[-2]) > 1e-7 * map.scale).any():
            pytest.skip("the motion of the suite is not of period 1, so an instant of it does not recur in each period")
        at = record.isel(time=self.request.samples // 4)
        size = np.abs(record.displacement.values).max()
        np.testing.assert_allclose(orbit.displacement[:, -1], at.displacement.values, atol=1e-4 * size)

    def test_values_without_a_motion_are_a_value_error(self) -> None:
        for parameter in self.make().parameters:
            refusal = None
            try:
                map = self.period_map(**{parameter.name: math.nan})
            except ValueError as error:
                refusal = str(error)
            if refusal is None:  # the parameter has no say in this motion
                assert map.orbit(map.initial, 1).status == OK, parameter.name
            else:
                assert parameter.name in refusal

    # --- the initial state, where the simulator says which of its parameters it is

    def test_the_initial_state_is_declared_by_parameters_bodies_and_channels_that_are_there(self) -> None:
        initial = getattr(self.make(), "initial", {})
        if not initial:
            pytest.skip("the simulator declares no parameters of the initial state")
        present = channels(self.run())
        for name, (body, channel) in initial.items():
            assert name in {p.name for p in self.make().parameters}
            assert body in self.make().bodies
            assert channel in present

    # --- the interfaces, where the simulator says what a force law sees there

    def test_an_interface_is_declared_by_a_parameter_and_bodies_that_are_there(self) -> None:
        simulator = self.make()
        for port, interface in interfaces_of(simulator).items():
            assert port in places_of(simulator)["interface"]
            assert interface.gap in {parameter.name for parameter in simulator.parameters}
            assert set(interface.factors) <= set(simulator.bodies)

    # --- the confirming simulator, where there is one

    def confirming(self) -> Simulator:
        """Return the simulator that confirms what the suite's finds, or skip where there is none."""
        other = getattr(self.make(), "confirming", None)
        if other is None:
            pytest.skip("the simulator is confirmed by no other")
        return other

    def test_the_confirming_simulator_has_the_same_parameters_bodies_and_sites(self) -> None:
        mine, other = self.make(), self.confirming()
        assert set(other.parameters) == set(mine.parameters)
        assert set(other.bodies) == set(mine.bodies)
        assert set(other.sites) == set(mine.sites)

    def test_the_confirming_simulator_pickles(self) -> None:
        other = pickle.loads(pickle.dumps(self.confirming()))
        assert Model(other).parameters == Model(self.make()).parameters

    def test_the_confirming_simulator_takes_the_excitation(self) -> None:
        takes = getattr(self.confirming(), "excitations", None)
        if takes is None:
            pytest.skip("it does not say which excitations it takes")
        assert (self.excitation.quantity, self.excitation.place) in takes

    # --- all simulators

    def test_every_parameter_says_what_it_is(self) -> None:
        for p in self.make().parameters:
            assert p.unit, f"{p.name} has no unit ('1' for a pure number)"
            assert p.meaning, f"{p.name} has no meaning"
            assert p.low <= p.nominal <= p.high, f"{p.name}: nominal value {p.nominal} outside [{p.low}, {p.high}]"

    def test_a_value_that_is_no_number_is_a_status(self) -> None:
        for parameter in self.make().parameters:
            values = {**self.values, parameter.name: math.nan}
            record = Model(self.make()).run(values, self.excitation, self.request)
            if record.attrs["status"] == OK:  # the parameter has no say in this motion
                check(record, parameter.name)
            else:
                assert record.attrs["reason"], parameter.name

    def test_a_spent_budget_is_a_status(self) -> None:
        record = self.run(request=replace(self.request, step_budget=1))
        assert record.attrs["status"] == "step budget"
        assert record.attrs["reason"]

    def test_an_excitation_it_cannot_take_is_refused(self) -> None:
        with pytest.raises(CalibError, match="nowhere"):
            self.run(excitation=replace(self.excitation, place="nowhere"))

    def test_a_recorded_input_is_simulated_or_refused(self) -> None:
        harmonic = self.excitation.as_harmonic
        time = harmonic.period / RECORDED_SAMPLES * np.arange(RECORDED_PERIODS * RECORDED_SAMPLES)
        value = harmonic.amplitude * np.cos(2.0 * np.pi * harmonic.frequency * time + harmonic.phase)
        recorded = replace(self.excitation, frequency=None, amplitude=None, phase=0.0, time=time, value=value)
        try:
            record = self.run(excitation=recorded, request=replace(self.request, times=time))
        except CalibError:
            return
        except Exception as error:
            raise AssertionError(
                f"a recorded input raises {error!r}; integrate `excitation.as_samples`, or raise a CalibError where "
                "`excitation.harmonic` is False"
            ) from error
        assert record.attrs["status"] != OK or record.sizes["time"] == time.size

    @pytest.mark.parametrize("site", PROBES)
    def test_a_law_acts_at_each_site(self, site: str) -> None:
        if site not in self.make().sites:
            pytest.skip(f"the simulator takes no laws at {site!r}")
        law, size = PROBES[site]
        probe = Effect("probe", site, law, (Parameter("probe_size", "1", 0.0, "size", null=0.0),), meaning="a probe")
        plain, null, present = self.run(), self.run(probe), self.run(probe, probe_size=size)
        for channel in channels(plain):
            np.testing.assert_array_equal(null[channel].values, plain[channel].values)
        assert present.attrs["status"] == OK
        assert any((present[c].values != plain[c].values).any() for c in channels(plain))

    def test_internal_states_of_a_force_law_are_integrated(self) -> None:
        simulator = self.make()
        if "force" not in simulator.sites:
            pytest.skip("the simulator takes no laws at 'force'")
        if not getattr(simulator, "law_states", STATES):
            with pytest.raises(CalibError, match="no force laws with internal states"):
                self.run(MAXWELL)
            return
        plain, present = self.run(), self.run(MAXWELL, maxwell_stiffness=MAXWELL_STIFFNESS)
        assert present.attrs["status"] == OK
        assert any((present[c].values != plain[c].values).any() for c in channels(plain)), (
            "a force law with an internal state leaves the record as it was: integrate the rates that laws write to dz "
            "beside the simulator's own state (docs/reference/contracts.md), or declare law_states = 0"
        )
