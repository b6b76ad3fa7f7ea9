"""Models of UM-Bridge on a real server in a process of its own."""

import contextlib
import math
import sys
import threading
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, HTTPServer

import numpy as np
import pytest
import umbridge_server as server
from written_page import page_content

from calib import records
from calib.errors import CalibError
from calib.modelling.model import Model
from calib.modelling.simulator import Request
from calib.records.excitation import Excitation
from calib.simulators.umbridge import UmBridge
from calib.testing import SimulatorSuite
from calib.workflows.calibrate import calibrate, rebuild

DRIVE = Excitation("mass", "force", frequency=9.0, amplitude=2.0)
VALUES = {"stiffness": 4100.0, "damping": 6.0}
OPTIONS = {
    "model": "forced",
    "parameters": {"stiffness": "4 kN/m", "damping": "5 N s/m"},
    "inputs": [["stiffness", "damping", 0], ["excitation.frequency", "excitation.amplitude"]],
    "outputs": {"mass": {"displacement": 0, "velocity": 1}},
    "excitation": {"quantity": "force", "place": "mass"},
    "config": {"periods": "request.periods", "samples": "request.samples"},
    "wait": 0.0,
}
SAMPLED = {
    "model": "sampled",
    "parameters": {"stiffness": "4000 N/m", "damping": "5 N s/m"},
    "inputs": [["stiffness", "damping"], "request.times", "excitation.value"],
    "outputs": {
        "mass": {"displacement": {"output": 0, "first": 0, "unit": "mm"}, "velocity": {"output": 0, "first": 60}}
    },
    "excitation": {"quantity": "force", "place": "mass"},
    "wait": 0.0,
}
STEPPING = {
    "model": "stepping",
    "parameters": {"stiffness": "4000 N/m", "damping": "5 N s/m"},
    "inputs": [["stiffness", "damping"]],
    "outputs": {"mass": {"displacement": 1}},
    "excitation": {"quantity": "force", "place": "mass", "built_in": True},
    "wait": 0.0,
}
REQUEST = Request(periods=2, samples=100)
RECORDED = np.arange(60) / 540.0  # s


@pytest.fixture(scope="module")
def url():
    with server.serving() as (address, _):
        yield address


@pytest.fixture
def make(url):
    """Make the simulator with some options changed."""
    return lambda **options: UmBridge(**({"url": url} | OPTIONS | options))


class TestConformance(SimulatorSuite):
    excitation = DRIVE
    values = VALUES
    request = REQUEST

    @pytest.fixture(autouse=True)
    def _made(self, make):
        self.made = make()

    def make(self):
        return self.made


def test_the_motion_is_that_of_the_model(make):
    record = Model(make()).run(VALUES, DRIVE, REQUEST)
    x, v = server.motion(4100.0, 6.0, 9.0, 2.0, record.time.values)
    np.testing.assert_allclose(record.displacement.values[0], x, rtol=1e-9)
    np.testing.assert_allclose(record.velocity.values[0], v, rtol=1e-9)


def test_parameters_keep_their_si_units_and_are_sent_in_those_stated(make):
    known = {p.name: (p.unit, p.nominal) for p in make().parameters}
    assert known == {"stiffness": ("N/m", 4000.0), "damping": ("N s/m", 5.0)}


def test_a_recorded_input_goes_as_vectors_and_channels_come_in_one(url):
    drive = Excitation("mass", "force", time=RECORDED, value=2.0 * np.cos(2.0 * np.pi * 9.0 * RECORDED))
    record = Model(UmBridge(url, **SAMPLED)).run(VALUES, drive, Request(times=RECORDED))
    x, v = server.motion(4100.0, 6.0, 9.0, 2.0, RECORDED)
    np.testing.assert_allclose(record.displacement.values[0], x, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(record.velocity.values[0], v, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("times", [{"output": 0, "unit": "ms"}, {"step": 1.0 / 540.0}])
def test_an_answer_at_times_of_its_own_is_interpolated(url, times):
    simulator = UmBridge(url, **STEPPING, times=times)
    record = Model(simulator).run(VALUES, DRIVE, Request(periods=1, samples=30))
    x, _ = server.motion(4100.0, 6.0, 9.0, 2.0, record.time.values)
    np.testing.assert_allclose(record.displacement.values[0], x, atol=3e-3 * np.abs(x).max())
    assert record.section_displacement.shape == (1, 1)


# --- failures


@pytest.mark.parametrize(
    ("fault", "status", "reason"),
    [
        (server.RAISES, "http error", "HTTP status 500"),
        (server.NOT_A_NUMBER, "diverged", "output vector 0 holds a number that is not finite"),
        (server.SHORT, "wrong size", "output vector 0 has 6399 samples, expected 6400"),
        (server.SLEEPS, "server timeout", "Evaluate took longer than 0.5 s"),
    ],
)
def test_what_goes_wrong_on_the_server_is_a_status_with_its_reason(make, fault, status, reason):
    simulator = make(inputs=[["stiffness", "damping", fault], OPTIONS["inputs"][1]], timeout="0.5 s")
    record = Model(simulator).run(VALUES, DRIVE, REQUEST)
    assert record.attrs["status"] == status
    assert reason in record.attrs["reason"]


def test_an_output_that_is_not_there_is_a_status(make):
    record = Model(make(outputs={"mass": {"displacement": 0, "velocity": 7}})).run(VALUES, DRIVE, REQUEST)
    assert (record.attrs["status"], record.attrs["reason"]) == (
        "wrong size", "the answer has 2 output vectors, none with index 7",
    )  # fmt: skip


def test_an_answer_that_is_too_short_is_a_status(url):
    record = Model(UmBridge(url, **STEPPING, times={"step": 1.0 / 540.0})).run(VALUES, DRIVE, REQUEST)
    assert record.attrs["status"] == "wrong size"
    assert "not 2 whole periods" in record.attrs["reason"]


def test_a_model_that_the_server_no_longer_has_is_a_status(make):
    simulator = make()
    simulator._client = replace(simulator._client, model="gone")
    record = Model(simulator).run(VALUES, DRIVE, REQUEST)
    assert record.attrs["status"] == "model error"
    assert "ModelNotFound" in record.attrs["reason"]


def test_a_server_that_is_away_is_a_status_and_one_that_comes_back_is_waited_for():
    port = server.free_port()
    with server.serving(port) as (address, process):
        options = {"url": address} | OPTIONS
        impatient, patient = UmBridge(**options), UmBridge(**options | {"wait": "60 s"})
        process.kill()
        process.wait(30)
    record = Model(impatient).run(VALUES, DRIVE, REQUEST)
    assert record.attrs["status"] == "no server"
    assert "cannot be reached" in record.attrs["reason"]
    with pytest.raises(CalibError, match="no answer from the UM-Bridge server .* start it, or mend the URL"):
        UmBridge(**options)
    with server.started(port) as process:  # answers after some seconds
        try:
            assert Model(patient).run(VALUES, DRIVE, REQUEST).attrs["status"] == "ok"
        finally:
            process.kill()


# --- a study

STUDY = """\
[study]
name = "umbridge"
seed = 1
budget = 40
screen = 12
timeout = "2 min"
periods = 2
samples = 50

[[record]]
name = "bench"
path = "bench.nc"

[model]
simulator = "umbridge"

[model.options]
url = "URL"
model = "forced"
parameters = { stiffness = "4 kN/m", damping = "5 N s/m" }
inputs = [["stiffness", "damping", 0], ["excitation.frequency", "excitation.amplitude"]]
outputs = { mass = { displacement = 0, velocity = 1 } }
excitation = { quantity = "force", place = "mass" }
config = { periods = "request.periods", samples = "request.samples" }
wait = "60 s"

[windows]
stiffness = { low = "3.5 kN/m", high = "5 kN/m" }
damping = { low = 2, high = 20 }

[[term]]
feature = "phase_curve"

[optimiser]
name = "multistart"
"""


def test_true_values_are_found_though_the_server_dies_on_the_way(tmp_path):
    time_, rng = np.arange(200) / (9.0 * 50), np.random.default_rng(0)
    channels = {}
    for name, values in zip(records.STATE, server.motion(4100.0, 6.0, 9.0, 2.0, time_), strict=True):
        sigma = 0.01 * values.std()
        channels |= {name: (values + sigma * rng.standard_normal(200))[None], f"{name}_sigma": np.array([sigma])}
    attrs = {"frequency": 9.0, "amplitude": 2.0, "place": "mass", "quantity": "force"}
    records.write(records.make(time_, ["mass"], channels, **attrs), tmp_path / "bench.nc")
    port = server.free_port()
    (tmp_path / "study.toml").write_text(STUDY.replace("URL", f"http://127.0.0.1:{port}"))
    with server.serving(port, evaluations=9) as (_, process):
        again = threading.Thread(target=restart, args=(process, port, done := threading.Event()))
        again.start()
        try:
            found = calibrate(tmp_path / "study.toml", quiet=True)
        finally:
            done.set()
            again.join()
    assert process.returncode == 1, "it has died"
    assert found.failed == 0
    assert found.values == {"stiffness": pytest.approx(4100.0, rel=0.01), "damping": pytest.approx(6.0, rel=0.05)}
    before = page_content(tmp_path / "out" / "report.html")
    assert page_content(rebuild(tmp_path / "study.toml")) == before, "without a server"


def restart(process, port, done):
    """Start a server where one has died, until all is done."""
    process.wait()
    with server.started(port) as other:
        done.wait(120)
        other.kill()


# --- what is refused

REFUSED = [
    ({"url": "file:///etc/passwd"}, "url: expected one such as 'http://localhost:4242'"),
    ({"url": "ftp://localhost"}, "url: expected one such as"),
    ({"url": "http://"}, "url: expected one such as"),
    ({"url": "http://a:b@localhost:4242"}, "a user name or password would be written into the results"),
    ({"model": "force"}, "has no model 'force' .did you mean 'forced'.*it has forced, sampled"),
    ({"model": "mute"}, "'mute' at .* cannot be evaluated"),
    ({"parameters": ["stiffness"]}, "parameters: expected nominal values"),
    ({"parameters": {"stiffness": "4 kilo"}}, "stiffness"),
    ({"parameters": {"stiffness": "4 kN/m", "damping": "x"}}, "damping"),
    ({"parameters": {"stiffness": "4 kN/m", "damping": True}}, "damping"),
    ({"parameters": {"stiffness": "4 kN/m", "request.times": 1}}, "this name has a meaning of its own"),
    ({"inputs": "stiffness"}, "inputs: expected the input vectors"),
    ({"inputs": [["stifness", "damping"]]}, r"inputs\[0\]: expected a number or one of .*did you mean 'stiffness'"),
    ({"inputs": [["stiffness", "damping"], "request.time"]}, "did you mean 'request.times'"),
    ({"inputs": [["stiffness", 1.0, 0.0], [9.0, 1.0]]}, "the parameter 'damping' stands in no block"),
    ({"inputs": [["stiffness", "damping"]], "config": None}, "excitation: neither inputs nor config tell the model"),
    ({"outputs": {"mass": {"displacement": -1}}}, "expected an index from 0 on, got -1"),
    ({"outputs": {"mass": {"displacement": {"output": 0, "unit": "N"}}}}, r"outputs\.mass\.displacement\.unit"),
    ({"outputs": {"mass": {"strain": 0}}}, "state the unit"),
    ({"outputs": {"mass": {}}}, "all bodies have the same channels"),
    ({"excitation": {"quantity": "forces", "place": "mass"}}, "did you mean 'force'"),
    ({"excitation": {"quantity": "force"}}, r"excitation\.place"),
    ({"excitation": {"quantity": "force", "place": "mass", "builtin": True}}, "unknown key 'builtin'"),
    ({"times": "stated"}, "times: expected"),
    ({"times": {"step": "0 s"}}, r"times\.step: expected a time above 0 s"),
    ({"section": 0}, "section: expected a whole number"),
    ({"timeout": "0 s"}, "timeout: expected a time above 0 s"),
]


@pytest.mark.parametrize(("options", "message"), REFUSED)
def test_options_that_make_no_sense_are_refused(make, options, message):
    with pytest.raises(CalibError, match=message):
        make(**options)


STRANGE = [5, -1, 1.5, True, math.nan, "", "x", [], {}, [[1]], [{}], {"a": 1}, {"a": {"b": []}}, {"a": {"b": {"c": 1}}}]


@pytest.mark.parametrize("option", ["url", *OPTIONS, "times", "section", "timeout"])
def test_an_option_of_whatever_kind_is_taken_or_refused(make, option):
    for value in STRANGE:
        with contextlib.suppress(CalibError):
            make(**{option: value})


def test_sizes_that_are_not_those_of_the_model_are_refused(url):
    with pytest.raises(CalibError, match="'stepping' takes 1 vectors of 2 numbers, got 1 of 3"):
        UmBridge(url, **STEPPING | {"inputs": [["stiffness", "damping", 1.0]]})


def test_what_a_record_does_not_have_is_named(make):
    decay = Excitation("mass", "free decay")
    with pytest.raises(CalibError, match=r"is told excitation\.frequency, excitation\.amplitude, which this"):
        Model(make()).run(VALUES, decay, Request(times=np.arange(3.0)))


def test_a_server_of_something_else_is_named():
    class Other(BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(302 if self.path.startswith("/away") else 200)
            self.send_header("Location", "/")
            self.end_headers()
            self.wfile.write(b"<html>hello")

        def log_message(self, *_):
            pass

    with HTTPServer(("127.0.0.1", 0), Other) as web:
        thread = threading.Thread(target=web.serve_forever)
        thread.start()
        try:
            place = f"http://127.0.0.1:{web.server_port}"
            with pytest.raises(CalibError, match="is answered with what is no JSON object: <html>hello"):
                UmBridge(**{"url": place} | OPTIONS)
            with pytest.raises(CalibError, match="HTTP status 302"):
                UmBridge(**{"url": f"{place}/away"} | OPTIONS)
        finally:
            web.shutdown()
            thread.join()


def test_a_missing_extra_is_named(make, monkeypatch):
    monkeypatch.setitem(sys.modules, "requests", None)
    with pytest.raises(CalibError, match=r'pip install "calib\[umbridge\]"'):
        make()
