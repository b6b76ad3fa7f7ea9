"""calib response, as a user types it."""

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

from calib import records
from calib.cli import main
from calib.cli.response import described
from calib.dynamics.harmonic_response import _SeriesSearch
from calib.dynamics.response import FrequencyResponse, Irregular, _LevelSearch
from calib.records.excitation import Excitation
from calib.simulators.oscillator.oscillator import Oscillator

STUDY = """
[study]
name = "stiffening"
seed = 1
budget = 4

[[record]]
name = "shaken"
path = "shaken.nc"

[model]
simulator = "oscillator"
effects = ["cubic_stiffness"]
fixed = { mass = 1, stiffness = 400, k3 = 4e5 }

[windows]
damping = { low = 0.5, high = 2.0 }

[[term]]
feature = "phase_curve"
"""


def calib(*arguments, code=0):
    ended = CliRunner().invoke(main, [str(a) for a in arguments])
    assert ended.exit_code == code, ended.output
    assert "Traceback" not in ended.output
    return ended


@pytest.fixture
def study(tmp_path):
    force = Excitation("mass", "force", frequency=3.0, amplitude=0.6)
    times = np.arange(200) / (100 * force.frequency)
    motion = {channel: np.cos(2.0 * np.pi * 3.0 * times)[None] for channel in ("displacement", "velocity")}
    records.write(records.make(times, Oscillator.bodies, motion, **force.attributes), tmp_path / "shaken.nc")
    (tmp_path / "study.toml").write_text(STUDY)
    return tmp_path


def test_a_response_says_what_is_on_it_and_leaves_file_and_picture(study):
    ended = calib("response", study, "--over", "frequency=2.5:4.5", "--levels", "0.1 N,100%", "--steps", 5,
                  "--set", "damping=1")  # fmt: skip
    assert ended.stderr.splitlines() == ["level 1 of 2: 0.1 N", "level 2 of 2: 0.6 N"]
    said = ended.stdout.splitlines()
    assert said[0:2] == ["level 0.1 N", "  period-1, 2.5 Hz .. 4.5 Hz, stable"]
    assert said[3:5] == ["level 0.6 N", "  period-1, 2.5 Hz .. 4.5 Hz, stable in part"]
    assert [line.split(" at ")[0] for line in said[5:7]] == ["    fold", "    fold"]
    assert said[7].startswith("  largest stable first harmonic of mass: 2")
    out = study / "out"
    assert said[8:] == [f"response: {out / 'response.nc'}", f"picture: {out / 'response_mass.png'}"]
    assert (out / "response_mass.png").read_bytes().startswith(b"\x89PNG")
    with xr.open_dataset(out / "response.nc") as response:
        assert response.attrs["model"] == "oscillator + cubic_stiffness"
        assert sorted(set(response.level.values)) == pytest.approx([0.1, 0.6])
        assert response.frequency.attrs["units"] == "Hz"


def test_a_curve_that_is_not_followed_to_its_end_says_so(study):
    said = calib("response", study, "--over", "frequency=2.5:4.5", "--levels", "0.1 N", "--most", "12").output
    assert "    not followed beyond " in said
    assert "12 points are made; take more with --most" in said
    assert "largest stable first harmonic of mass, of what was followed: " in said


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--over", "damping=1:2"], "--over: a response is over the frequency of the excitation: expected frequency="),
        (["--over", "frequency"], "expected frequency=LOW:HIGH, got 'frequency'"),
        (["--over", "frequency=2:4:log"], "followed on a linear scale"),
        (["--over", "frequency=4:2"], "--over excitation.frequency"),
        (["--over", "frequency=2:4", "--levels", "1 mm"], "--levels"),
        (["--over", "frequency=2mm:4mm"], "expected a quantity that can be given in Hz, got '2mm'"),
        (["--over", "frequency=2:4", "--levels", "inf%"], "--levels: expected finite positive amplitudes"),
        (["--over", "frequency=2:4", "--levels", "-5%"], "positive amplitudes of the excitation, got '-5%'"),
        (["--over", "frequency=2:4", "--levels", "half"], "--levels"),
        (["--over", "frequency=2:4", "--bodies", "layer"], "no body 'layer'"),
    ],
)
def test_a_response_that_makes_no_sense_is_refused_by_the_option_s_name(study, arguments, said):
    assert said in calib("response", study, *arguments, code=1).stderr


def test_no_other_file_is_written_over(study):
    other = study / "shaken.nc"
    before = other.read_bytes()
    assert "is not a file of `calib response`" in calib(
        "response", study, "--over", "frequency=2:4", "-o", other, code=1
    ).stderr  # fmt: skip
    assert other.read_bytes() == before


def test_a_damaged_file_of_an_earlier_run_is_named_with_what_to_do(study):
    damaged = study / "response.nc"
    damaged.write_bytes((study / "shaken.nc").read_bytes()[:3000])
    said = calib("response", study, "--over", "frequency=2:4", "-o", damaged, code=1).stderr
    assert "not a readable netCDF file" in said
    assert "remove it or choose another name" in said
    assert damaged.stat().st_size == 3000


@pytest.fixture
def searched(monkeypatch):
    """Levels that are searched; of those in the second list the search is stopped. No picture is drawn."""
    begun, stopped = [], []

    def wrapped(search):
        def recorded(own):
            begun.append(own.level)
            if own.level in stopped:
                raise KeyboardInterrupt
            search(own)

        return recorded

    for kind, name in ((_LevelSearch, "sweep"), (_SeriesSearch, "search")):
        monkeypatch.setattr(kind, name, wrapped(getattr(kind, name)))
    monkeypatch.setattr("calib.cli.response.bodies_drawn", lambda *given: [])
    return begun, stopped


@pytest.mark.parametrize("method", ["shooting", "harmonic-balance"])
def test_a_response_that_was_stopped_goes_on_from_the_levels_that_are_done(study, searched, method):
    (begun, stopped), whole, path = searched, study / "whole.nc", study / "response.nc"
    command = ["response", study, "--over", "frequency=2.5:3", "--levels", "0.1 N,0.2 N", "--steps", 2, "--most", 3,
               "--set", "damping=1", "--method", method, "-o"]  # fmt: skip
    stopped.append(0.2)
    CliRunner().invoke(main, [str(a) for a in (*command, path)])
    assert not path.exists()
    stopped.clear()
    assert calib(*command, path).stderr.splitlines()[0] == "going on with 1 level of a run that did not end"
    calib(*command, whole)
    assert begun == [0.1, 0.2, 0.2, 0.1, 0.2]
    with xr.open_dataset(whole) as expected, xr.open_dataset(path) as response:
        xr.testing.assert_identical(response, expected)
    assert not list(study.glob("*.levels"))


def test_levels_that_were_followed_otherwise_are_followed_anew(study, searched):
    begun, stopped = searched
    stopped.append(0.2)
    for most in (3, 4, 4):
        command = ["response", study, "--over", "frequency=2.5:3", "--levels", "0.1 N,0.2 N", "--steps", 2]
        CliRunner().invoke(main, [str(a) for a in (*command, "--most", most)])
    assert begun == [0.1, 0.2, 0.1, 0.2, 0.2]


def test_a_level_that_is_given_twice_is_followed_once(study):
    ended = calib("response", study, "--over", "frequency=2.5:3", "--levels", "0.1 N,0.1 N", "--steps", 2, "--most", 3,
                  "--set", "damping=1")  # fmt: skip
    assert ended.stderr.splitlines() == ["level 1 of 1: 0.1 N"]


def test_a_response_by_harmonic_balance_says_what_its_harmonics_leave_out(study):
    ended = calib("response", study, "--over", "frequency=2.5:4.5", "--levels", "100%", "--steps", 5,
                  "--set", "damping=1", "--method", "harmonic-balance")  # fmt: skip
    said = ended.stdout.splitlines()
    assert said[2:4] == ["    fold at 3.8553226 Hz", "    fold at 3.5080271 Hz"]
    [left_out] = [line for line in said if line.startswith("harmonic balance, 7 harmonics: ")]
    assert "changed their state by at most" in left_out
    with xr.open_dataset(study / "out" / "response.nc") as written:
        assert written.attrs["method"] == "harmonic balance"
    refused = calib("response", study, "--over", "frequency=2.5:3", "--isolas", "--method", "harmonic-balance", code=1)
    assert "--isolas: " in refused.stderr


def test_what_is_not_followed_is_said_with_its_reason():
    met = (Irregular(0.1, 2.0, "period-9", "returns after 9 periods"), Irregular(0.1, 3.0, "failed", "diverged"),
           Irregular(0.1, 2.5, "period-9", "returns after 9 periods"))  # fmt: skip
    response = FrequencyResponse(("mass",), (2.0, 4.0), "N", (), met)
    assert list(described(response, ["mass"])) == [
        "not followed at level 0.1 N, 2 Hz .. 2.5 Hz (2 frequencies): period-9",
        "not followed at level 0.1 N, 3 Hz: failed: diverged",
    ]


def test_a_backbone_says_where_it_runs_and_leaves_file_and_picture(study):
    ended = calib("backbone", study, "--over", "frequency=2.8:4.5", "--body", "mass", "--levels", "0.02 N,1 N",
                  "--hold", "4 mm,12 mm", "--out", study / "out")  # fmt: skip
    said = ended.stdout.splitlines()
    assert said[0].startswith("phase resonance of mass: 3.184 Hz at 0.02 N (0.9996 mm) .. 4.464 Hz at 1 N (35.51 mm)")
    assert said[1].startswith("mass held at 4 mm: level 0.08046 N .. 1.583 N, least at 3.")
    assert "stable in part at constant level" in said[2]
    assert (study / "out" / "backbone_mass.png").read_bytes().startswith(b"\x89PNG")
    with xr.open_dataset(study / "out" / "backbone.nc") as written:
        assert written.kind.values.tolist() == ["phase resonance", "constant response", "constant response"]
        assert written.level.attrs["units"] == "N"
    refused = calib("backbone", study, "--over", "frequency=5:6", "--body", "mass", code=1)
    assert "mass has no resonance from 5 to 6 Hz at 0.006 N" in refused.stderr


def test_a_backbone_of_a_free_decay_is_pointed_to_the_picture_of_its_record(study):
    times = np.arange(2000) / 200.0
    size = np.exp(-0.1 * times)
    motion = {
        "displacement": (size * np.cos(20.0 * times))[None],
        "velocity": (-20.0 * size * np.sin(20.0 * times))[None],
    }
    records.write(records.make(times, Oscillator.bodies, motion), study / "shaken.nc")
    told = '[record.excitation]\nplace = "mass"\nquantity = "free decay"\n\n[model]'
    (study / "study.toml").write_text(STUDY.replace("[model]", told).replace("phase_curve", "decay"))
    refused = calib("backbone", study, "--over", "frequency=2.8:4.5", "--body", "mass", code=1)
    assert "expected a record with a harmonic excitation, got free decay" in refused.stderr
    assert f"calib reference show {study}" in refused.stderr
