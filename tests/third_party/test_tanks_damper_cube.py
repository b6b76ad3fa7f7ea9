"""The third-party simulators of the measured studies obey their own physics, and take laws."""

import pickle

import numpy as np
import pytest
from third_party.cascaded_tanks import (
    LOWER_OVERFLOW,
    OUTLET_HEAD,
    OVERFLOW,
    PUMP_THRESHOLD,
    SENSOR_CURVATURE,
    CascadedTanks,
)
from third_party.cube_on_table import CubeOnTable
from third_party.directional_drag import DIRECTIONAL_DRAG
from third_party.friction_damper import FrictionDamper

from calib.errors import CalibError
from calib.modelling.effect import Effect
from calib.modelling.model import Model
from calib.modelling.parameter import Parameter
from calib.modelling.simulator import Request
from calib.plugins import load
from calib.records import OK, check
from calib.records.excitation import Excitation
from calib.simulators.oscillator import Oscillator
from calib.testing import EffectSuite
from calib.testing.simulator_suite import PROBES

TIME = np.linspace(0.0, 1.0, 149)
SWING = np.sin(2 * np.pi * 2.0 * TIME)
DRIVEN = {
    CascadedTanks: Excitation("pump", "force", time=100.0 * TIME, value=2.0 + SWING),
    FrictionDamper: Excitation("device", "displacement", time=TIME, value=0.02 * SWING, cutoff=20.0),
    CubeOnTable: Excitation("table", "base motion", time=TIME, value=0.01 * SWING),
}
cases = pytest.mark.parametrize("made", DRIVEN)


def run(made, *effects, request=None, excitation=None, **values):
    return Model(made(), effects).run(values, excitation or DRIVEN[made], request)


@cases
def test_the_record_keeps_the_schema_and_repeats_to_the_bit(made):
    record = check(run(made))
    assert record.attrs["status"] == OK
    assert tuple(record.body.values) == made.bodies
    assert run(made).identical(record)
    again = Model(pickle.loads(pickle.dumps(made()))).run({}, DRIVEN[made])
    assert again.identical(record)


@cases
@pytest.mark.parametrize("site", ["force", "gap", "restitution"])
def test_a_law_acts_at_each_site(made, site):
    if site not in made.sites:
        return
    law, size = PROBES[site]
    probe = Effect("probe", site, law, (Parameter("probe_size", "1", 0.0, "size", null=0.0),), meaning="a probe")
    plain, null, present = run(made), run(made, probe), run(made, probe, probe_size=size)
    assert all(np.array_equal(plain[c], null[c]) for c in plain.data_vars)
    assert any(not np.array_equal(plain[c], present[c]) for c in ("displacement", "force") if c in plain)


@cases
def test_what_it_cannot_do_is_said(made):
    with pytest.raises(CalibError, match="nowhere"):
        run(made, excitation=Excitation("nowhere", "force", time=TIME, value=SWING))
    assert run(made, request=Request(step_budget=1)).attrs["status"] == "step budget"
    names = [parameter.name for parameter in made.parameters]
    assert names
    statuses = {name: run(made, **{name: np.nan}).attrs["status"] for name in names}
    assert statuses == dict.fromkeys(names, "impossible value")


class TestOverflow(EffectSuite):
    effect = OVERFLOW
    present = {"spill_rate": 0.5, "brim": 4.0}
    excitation = DRIVEN[CascadedTanks]
    values: dict[str, float] = {}

    def make(self):
        return CascadedTanks()


class TestLowerOverflow(TestOverflow):
    effect = LOWER_OVERFLOW
    present = {"lower_spill_rate": 0.5, "lower_brim": 4.0}


class TestOutletHead(TestOverflow):
    effect = OUTLET_HEAD
    present = {"outlet_head": 2.0}


class TestPumpThreshold(TestOverflow):
    effect = PUMP_THRESHOLD
    present = {"pump_threshold": 1.5}


class TestSensorCurvature(TestOverflow):
    effect = SENSOR_CURVATURE
    present = {"curvature": 0.5}


class TestDirectionalDrag(EffectSuite):
    effect = DIRECTIONAL_DRAG
    present = {"drag_difference": 0.2}
    excitation = Excitation("mass", "force", time=TIME, value=SWING)
    values: dict[str, float] = {}

    def make(self):
        return Oscillator()


def test_a_lower_outlet_is_that_much_higher_a_level():
    still = Excitation("pump", "force", time=np.arange(0.0, 40.0, 4.0), value=np.zeros(10))
    shared = {"initial_upper": 0.0, "outflow_lower": 0.05}
    low = run(CascadedTanks, OUTLET_HEAD, excitation=still, initial_lower=4.0, outlet_head=2.0, **shared)
    plain = run(CascadedTanks, excitation=still, initial_lower=6.0, **shared)
    np.testing.assert_allclose(low.displacement.sel(body="lower") + 2.0, plain.displacement.sel(body="lower"))


def test_a_pump_below_its_threshold_lifts_nothing():
    weak = Excitation("pump", "force", time=np.arange(0.0, 40.0, 4.0), value=np.full(10, 0.9))
    record = run(CascadedTanks, PUMP_THRESHOLD, excitation=weak, initial_upper=0.0, pump_threshold=1.0)
    assert (record.displacement.sel(body="upper") == 0.0).all()


def test_a_tank_empties_as_torricelli_says():
    still = Excitation("pump", "force", time=np.arange(0.0, 80.0, 4.0), value=np.zeros(20))
    record = run(CascadedTanks, excitation=still, initial_upper=9.0, outflow_upper=0.05)
    root = np.maximum(3.0 - 0.025 * record.time.values, 0.0)
    np.testing.assert_allclose(record.displacement.sel(body="upper"), root**2, atol=1e-6)


def test_what_leaves_the_tanks_was_in_them():
    record = run(CascadedTanks, outflow_upper=0.02, outflow_lower=0.0, pump=0.0)
    whole = record.displacement.sum("body")
    np.testing.assert_allclose(whole, whole[0], rtol=1e-9)


def test_nothing_of_the_spill_is_lost_where_all_of_it_falls_into_the_lower_tank():
    closed = {"outflow_upper": 0.02, "outflow_lower": 0.0, "pump": 0.0}
    record = run(CascadedTanks, OVERFLOW, **closed, spill_rate=0.1, brim=2.0, spill_share=1.0)
    whole = record.displacement.sum("body")
    np.testing.assert_allclose(whole, whole[0], rtol=1e-9)


def test_the_damper_takes_its_slip_force_and_springs_back_with_its_stiffness():
    record = run(FrictionDamper, stiffness=2e6, slip_forward=1e4, slip_backward=8e3)
    force, x = record.force.values[0], record.displacement.values[0]
    assert force.max() == pytest.approx(1e4)
    assert force.min() == pytest.approx(-8e3)
    elastic = (force[1:] < 1e4) & (force[1:] > -8e3) & (force[:-1] < 1e4) & (force[:-1] > -8e3)
    np.testing.assert_allclose(np.diff(force)[elastic], 2e6 * np.diff(x)[elastic], atol=1e-6)


def test_play_is_a_plateau_without_force_of_twice_its_half_width():
    effect = load("calib.effects", "gap_offset")
    record = run(FrictionDamper, effect, stiffness=2e6, dg=0.003)
    x, inside = record.displacement.values[0], record.force.values[0] == 0.0
    falling = inside & (np.gradient(x) < 0.0) & (record.time.values < 0.5)
    assert np.ptp(x[falling]) == pytest.approx(0.006, abs=0.002)


def test_a_cube_on_a_still_table_rebounds_by_its_coefficient():
    still = Excitation("table", "base motion", time=TIME, value=np.full(TIME.size, 0.05))
    record = run(CubeOnTable, excitation=still, restitution=0.5, initial_height=0.55, gravity=9.81)
    first = np.sqrt(2 * 0.5 / 9.81)
    assert record.impact_time.values[0] == pytest.approx(first, abs=1e-6)
    np.testing.assert_allclose(record.impact_speed[:4], 9.81 * first * 0.5 ** np.arange(4), rtol=1e-4)
    assert record.displacement.values.min() >= 0.05 - 1e-12


def test_a_cube_at_rest_goes_with_the_table():
    record = run(CubeOnTable, restitution=0.0, initial_height=0.0, initial_velocity=0.01 * 4 * np.pi)
    np.testing.assert_allclose(record.displacement[0], 0.01 * SWING, atol=1e-6)  # at most 1.6 m/s^2: it never lifts


def test_a_law_that_bears_its_weight_keeps_the_cube_in_the_air():
    lift = Effect("probe", "force", PROBES["force"][0], (Parameter("probe_size", "1", 0.0, "size", null=0.0),), "probe")
    record = run(CubeOnTable, lift, initial_height=10.0, gravity=9.81, probe_size=9.81)
    np.testing.assert_allclose(record.displacement, 10.0, rtol=1e-12)
