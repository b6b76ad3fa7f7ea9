"""Real FMUs of a mass on a spring before a stop, built from C, of both versions and both interfaces."""

import contextlib
import json
import math
import re
import subprocess
import sys
import zipfile
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from child_environment import environment
from impact_fmu.build import description
from impact_fmu.faults import SHORT, status_with
from impact_fmu.peer import DRIVE, VALUES, moved, peer

from calib.errors import CalibError
from calib.execution.pools.local import LocalPool
from calib.modelling.model import Model
from calib.modelling.simulator import Request
from calib.records import CHANNELS
from calib.records.excitation import Excitation
from calib.simulators.fmu import Fmu
from calib.simulators.oscillator import Oscillator
from calib.testing import SimulatorSuite

PARAMETERS = ["mass", "damping", "gap", "stop_stiffness", "spring.stiffness"]
OUTPUTS = {"mass": {"displacement": "x", "velocity": "v"}}
KINDS = [(version, interface) for version in ("2.0", "3.0") for interface in ("CoSimulation", "ModelExchange")]
REQUEST = Request(periods=2, samples=100, settle=10)
VALUES_OF_KICK = {"damping": 20.0, "gap": 1.0}  # far from the stop
DECAY = Request(times=np.linspace(0.0, 0.2, 81))
FAULTS = {"fault": {"unit": "1"}}  # the parameter is without a unit


class TestOfVersion2(SimulatorSuite):
    excitation = DRIVE
    values = VALUES
    request = REQUEST
    kind = KINDS[0]

    @pytest.fixture(autouse=True)
    def _made(self, fmu):
        self.made = fmu(*self.kind)

    def make(self):
        return self.made


class TestOfVersion3(TestOfVersion2):
    kind = KINDS[2]


@pytest.mark.slow
class TestModelExchangeOfVersion2(TestOfVersion2):
    kind = KINDS[1]


@pytest.mark.slow
class TestModelExchangeOfVersion3(TestOfVersion2):
    kind = KINDS[3]


@pytest.mark.parametrize("kind", KINDS)
def test_the_motion_is_that_of_the_equation(fmu, kind):
    request = Request(periods=3, samples=50, settle=0)
    record = Model(fmu(*kind, section=3)).run(VALUES, DRIVE, request)
    expected = peer(record.time.values)
    for channel, motion in zip(("displacement", "velocity"), expected, strict=True):
        np.testing.assert_allclose(record[channel].values[0], motion, atol=3e-4 * np.abs(motion).max())


@pytest.mark.parametrize("kind", KINDS)
def test_a_recorded_input_gives_the_motion_of_the_harmonic_that_it_samples(fmu, kind):
    time = np.arange(0.0, 0.3, 1e-3)
    recorded = Excitation("base", "base motion", time=time, value=moved(time)[0])
    record = Model(fmu(*kind)).run(VALUES, recorded, Request(times=time[20:200]))
    expected = peer(np.append(0.0, time[20:200]))[:, 1:]
    assert record.attrs["status"] == "ok"
    np.testing.assert_allclose(record.displacement.values[0], expected[0], atol=5e-4 * np.abs(expected[0]).max())


@pytest.mark.parametrize("kind", KINDS)
def test_a_free_decay_begins_at_the_initial_state(fmu, kind):
    parameters = {"damping": {}, "x0": {"variable": "x_start", "nominal": "2 mm"}}
    simulator = fmu(*kind, parameters=parameters, input=None, initial={"x0": "mass.displacement"})
    record = Model(simulator).run({"damping": 20.0}, Excitation("mass", "free decay"), DECAY)
    base = (lambda t: (0.0, 0.0), VALUES | {"gap": 1e-3})
    expected = peer(DECAY.times, (2e-3, 0.0), *base)
    np.testing.assert_allclose(record.displacement.values[0], expected[0], atol=1e-6)
    assert simulator.initial == {"x0": ("mass", "displacement")}


def test_a_motion_settles_where_the_study_does_not_say_how_long(fmu):
    simulator = fmu(section=6)
    record = Model(simulator).run(VALUES, DRIVE, Request(periods=2, samples=40))
    section = record.section_displacement.values[0]
    assert section.shape == (6,)
    assert np.ptp(section) < 1e-4 * np.ptp(record.displacement.values)


def test_the_time_step_can_be_refined(fmu):
    coarse = fmu(step="5 ms", section=3)
    request = Request(periods=3, samples=25, settle=0)
    times = np.arange(75) / (9.0 * 25)
    errors = [
        np.abs(Model(s).run(VALUES, DRIVE, request).displacement.values[0] - peer(times)[0]).max()
        for s in (coarse, coarse.finer("time_step", 4.0))
    ]
    assert errors[1] < 0.2 * errors[0], "the input is held over a step by its value in the middle: of second order"


def test_communication_steps_are_multiples_of_the_internal_step(fmu):
    simulator = fmu("3.0", "CoSimulation", 'fixedInternalStepSize="0.0007"', section=3)
    assert simulator.numerics == frozenset()
    record = Model(simulator).run(VALUES, DRIVE, Request(periods=3, samples=30, settle=0))
    expected = peer(record.time.values)
    np.testing.assert_allclose(record.displacement.values[0], expected[0], atol=5e-3 * np.abs(expected[0]).max())


def test_of_both_interfaces_co_simulation_is_taken_unless_one_is_stated(fmu):
    both = "CoSimulation ModelExchange"
    request = Request(periods=2, samples=20, settle=0, step_budget=30)
    assert "communication steps" in Model(fmu("2.0", both)).run(VALUES, DRIVE, request).attrs["reason"]
    stated = Model(fmu("2.0", both, interface="model exchange")).run(VALUES, DRIVE, request)
    assert "steps of the solver" in stated.attrs["reason"]


@pytest.mark.parametrize("solver", ["DOP853", "Radau", "BDF"])
def test_a_model_exchange_takes_other_solvers(fmu, solver):
    simulator = fmu("2.0", "ModelExchange", solver=solver, section=1)
    record = Model(simulator).run(VALUES, DRIVE, Request(periods=1, samples=25, settle=0))
    expected = peer(record.time.values)[0]
    np.testing.assert_allclose(record.displacement.values[0], expected, atol=1e-3 * np.abs(expected).max())


@pytest.mark.parametrize("kind", KINDS[1::2])
def test_impacts_of_a_model_exchange_are_those_of_an_oscillator_with_a_rigid_stop(fmu, kind):
    parameters = ["spring.stiffness", "damping", "gap", "restitution"]
    values = {"damping": 20.0, "gap": 4e-4, "restitution": 0.6}
    request = Request(periods=4, samples=50, settle=0)
    record = Model(fmu(*kind, parameters=parameters, section=4)).run(values, DRIVE, request)
    other = Model(Oscillator(stop=True)).run(values | {"stiffness": 4000.0}, DRIVE, request)
    assert other.sizes["impact"] >= 3
    np.testing.assert_allclose(record.displacement.values, other.displacement.values, atol=2e-7)


@pytest.mark.parametrize("kind", KINDS[1::2])
def test_events_that_a_model_exchange_announces_are_met(fmu, kind):
    at, request = 0.03, Request(times=np.linspace(0.0, 0.1, 101))
    simulator = fmu(*kind, parameters=["damping", "kick_time", "gap"], input=None)
    record = Model(simulator).run(VALUES_OF_KICK | {"kick_time": at}, Excitation("mass", "free decay"), request)
    still = request.times <= at
    assert not record.displacement.values[0, still].any()
    expected = peer(request.times[still.sum() - 1 :] - at, (0.0, 0.1), lambda t: (0.0, 0.0), VALUES | VALUES_OF_KICK)
    np.testing.assert_allclose(record.displacement.values[0, ~still], expected[0, 1:], atol=2e-7)


# --- units


def test_parameters_have_the_units_and_start_values_of_the_fmu_in_si(fmu):
    known = {p.name: (p.unit, p.nominal) for p in fmu().parameters}
    assert known["gap"] == ("m", pytest.approx(1e-3)), "the FMU has it in mm"
    assert known["stiffness"] == ("N/m", 4000.0)
    assert known["damping"] == ("N s/m", 8.0), "N.s/m in Modelica's notation"
    assert known["mass"] == ("kg", 1.0)


def test_channels_of_other_quantities_keep_the_unit_of_the_fmu(fmu):
    outputs = {"mass": {"displacement": "x", "velocity": "v", "acceleration": "der(v)"}}
    record = Model(fmu(outputs=outputs, section=1)).run(VALUES, DRIVE, Request(periods=1, samples=20, settle=0))
    assert record.acceleration.attrs["units"] == "m/s^2"
    assert {c: record[c].attrs["units"] for c in ("displacement", "velocity")} == {
        c: CHANNELS[c] for c in ("displacement", "velocity")
    }


# --- failures

FAILURES = {
    1: ("fmu error", r"DoStep returned error \(the spring has broken\)", r"Derivatives returned error"),
    2: ("fmu discard", "DoStep returned discard .the step is too long", "Derivatives returned discard"),
    5: ("diverged", "an output is no finite number", "no finite number"),
    6: ("fmu terminated", "it terminated", "it terminated"),
    7: ("fmu fatal", "DoStep returned fatal", "Derivatives returned fatal"),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("fault", FAILURES)
def test_what_the_fmu_reports_is_a_status_with_its_reason(fmu, kind, fault):
    model = Model(fmu(*kind, parameters=FAULTS | {"damping": {}}, section=1))
    record = model.run({"fault": float(fault)}, DRIVE, SHORT)
    status, *patterns = FAILURES[fault]
    assert record.attrs["status"] == status
    assert re.search(patterns[kind[1] == "ModelExchange"], record.attrs["reason"]), record.attrs
    assert model.run({"fault": 0.0}, DRIVE, SHORT).attrs["status"] == "ok", "the next run has an instance of its own"


def test_a_value_that_the_fmu_refuses_is_a_status(fmu):
    record = Model(fmu()).run({"mass": -1.0}, DRIVE, REQUEST)
    assert record.attrs["status"] == "fmu error"
    assert "the mass must be positive" in record.attrs["reason"]


def test_a_crash_or_a_hang_of_the_fmu_costs_that_run_alone(fmu):
    run = partial(status_with, Model(fmu(parameters=FAULTS, section=1)))
    with LocalPool(run, timeout=2.0, startup=30.0) as pool:
        results = dict(pool.map([0.0, 4.0, 0.0, 3.0, 0.0]))
    assert [results[i] for i in (0, 2, 4)] == ["ok"] * 3
    assert results[1].status == "crashed"
    assert "SIGSEGV" in results[1].reason
    assert results[3].status == "timeout"


# --- what is refused

REFUSED = [
    ({"parameters": ["stifness"]}, r"parameters\.stifness: .* has no parameter 'stifness'"),
    ({"parameters": ["Gap"]}, "did you mean 'gap'"),
    ({"parameters": ["base"]}, "has 'base' as input that cannot be set, not as parameter"),
    ({"parameters": ["fault"]}, "gives 'fault' no unit; state it"),
    ({"parameters": {"gap": {"unit": "m"}}}, "gives 'gap' in 'mm', the option states 'm'"),
    ({"parameters": {"gap": {"units": "mm"}}}, "unknown key 'units' .did you mean 'unit'"),
    ({"parameters": "gap"}, "expected a list of names or a table of tables"),
    ({"parameters": {"gap": 1.0}}, "expected the name of a variable, or a table"),
    ({"parameters": {"gap@one": {"variable": "gap"}}}, "binds a value to a record"),
    ({"outputs": {"mass": {"displacement": "y"}}}, r"outputs\.mass\.displacement: .* has no variable 'y'"),
    (
        {"outputs": {"mass": {"displacement": "v"}}},
        "expected a variable in m or a unit of its dimension, got one in m/s",
    ),
    ({"outputs": {}}, "expected bodies with their channels"),
    ({"outputs": {"a": {"displacement": "x"}, "b": {"velocity": "v"}}}, "all bodies have the same channels"),
    ({"input": {"quantity": "force", "place": "mass", "displacement": "base"}}, "a force sets force, no displacement"),
    ({"input": {"quantity": "force", "place": "mass", "force": "base"}}, "expected a variable in N"),
    ({"input": {"quantity": "forces", "place": "mass"}}, "did you mean 'force'"),
    ({"input": {"quantity": "force"}}, r"input\.place"),
    ({"input": {"quantity": "base motion", "place": "base"}}, "name the variable that the base motion sets"),
    ({"input": {"quantity": "base motion", "place": "base", "displacement": "x"}}, "has no input|not as input"),
    ({"interface": "model exchange"}, "offers co-simulation, got 'model exchange'"),
    ({"solver": "rk45"}, "did you mean 'RK45'"),
    ({"step": "0 s"}, "step: expected a time above 0 s"),
    ({"section": 0}, "section: expected a positive number"),
    ({"tolerance": "small"}, "tolerance: expected a positive number"),
    ({"initial": {"gap": "mass.acceleration"}}, r"initial\.gap: expected one of mass\.displacement"),
    ({"initial": {"gaps": "mass.displacement"}}, "did you mean 'gap'"),
]


@pytest.mark.parametrize(("options", "message"), REFUSED)
def test_options_that_do_not_fit_the_fmu_are_refused(fmu, options, message):
    with pytest.raises(CalibError, match=message):
        fmu(**options)


STRANGE = [5, -1, 1.5, True, math.nan, "", "x", [], {}, [[1]], [{}], {"a": 1}, {"a": {"b": []}}, {"a": {"b": {"c": 1}}}]
STATED = ["path", "parameters", "outputs", "input", "interface", "step", "tolerance", "solver", "section", "initial"]


@pytest.mark.parametrize("option", STATED)
def test_an_option_of_whatever_kind_is_taken_or_refused(fmu_file, option):
    path = fmu_file()
    for value in STRANGE:
        given = {"path": path.name, "parameters": PARAMETERS, "outputs": OUTPUTS, option: value}
        with contextlib.suppress(CalibError):
            Model(Fmu(**given).placed(path.parent, path.parent, None))


def test_without_an_input_only_free_decays_are_simulated(fmu):
    with pytest.raises(CalibError, match="not driven by base motion at 'base'; it takes free decay at 'mass'"):
        Model(fmu(input=None)).run(VALUES, DRIVE, REQUEST)


def test_the_acceleration_of_a_recorded_motion_needs_a_cutoff(fmu_file):
    text = re.sub(r'("base_rate"[^>]*><Real unit="m/s)"', r'\g<1>2"', description("2.0", ["CoSimulation"]))
    path = fmu_file().with_name("accelerated.fmu")
    with zipfile.ZipFile(fmu_file()) as old, zipfile.ZipFile(path, "w") as new:
        for member in old.namelist():
            new.writestr(member, text if member == "modelDescription.xml" else old.read(member))
    driven = {"quantity": "base motion", "place": "base", "acceleration": "base_rate"}
    simulator = Fmu(str(path), parameters=PARAMETERS, outputs=OUTPUTS, input=driven)
    time = np.arange(0.0, 0.3, 1e-3)
    recorded = Excitation("base", "base motion", time=time, value=moved(time)[0])
    with pytest.raises(CalibError, match="never silently: state the low-pass"):
        Model(simulator).run({}, recorded, Request(times=time))
    assert Model(simulator).run({}, replace(recorded, cutoff=100.0), Request(times=time)).attrs["status"] == "ok"


@pytest.mark.slow
def test_nothing_of_fmpy_is_imported_before_an_fmu_is_read():
    script = (
        "import sys, calib.cli, calib.simulators.fmu\n"
        "print([name for name in ('fmpy', 'umbridge', 'aiohttp') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, env=environment(), check=True)
    assert json.loads(done.stdout.replace("'", '"')) == []


def test_a_missing_extra_is_named(fmu, monkeypatch):
    monkeypatch.setitem(sys.modules, "fmpy", None)
    with pytest.raises(CalibError, match=r'pip install "calib\[fmu\]"'):
        fmu()
