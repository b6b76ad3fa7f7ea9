"""A study from Python: the same checks and the same results as from a study file."""

import re
import subprocess
import sys

import echo_study
import numpy as np
import pytest
from child_environment import environment
from echo_study import TRUTH
from tiny_simulators import Echo

import calib
from calib.study import result
from calib.workflows.calibrate import calibrate

BENCH = echo_study.bench()
DRIVE = {"place": "base", "quantity": "base motion", "frequency": "10 Hz", "amplitude": "1 mm"}
WINDOWS = {"gain": (0.5, 2.0, "log"), "harmonic": ("-1 mm", "1 mm")}


def record(**more):
    """The record of `echo_study`, from bare arrays in other units."""
    return calib.Record.from_arrays(
        **{
            "time": 1e3 * BENCH.time.values,
            "displacement": {"mass": 1e3 * BENCH.displacement.values[0]},
            "velocity": {"mass": BENCH.velocity.values[0]},
            "units": {"time": "ms", "displacement": "mm"},
            "excitation": DRIVE,
            "sigma": {"displacement": "20 um", "velocity": 2e-5 * 20.0 * np.pi},
            "nuisance": ["trigger"],
            **more,
        }
    )


def study(**more):
    return calib.Study(
        **{
            "simulator": Echo, "records": [record(name="bench")], "windows": WINDOWS, "seed": 1, "budget": 24,
            "jobs": 1, "timeout": "20 s", "name": "echo", "study": {"screen": 8}, **more,
        }
    )  # fmt: skip


@pytest.fixture(scope="module")
def calibrated():
    return study().run(quiet=True)


def test_it_finds_what_the_study_file_finds(calibrated, tmp_path):
    said = calibrate(echo_study.write_study(tmp_path), quiet=True)
    assert calibrated.values == pytest.approx(said["values"], rel=1e-9)
    assert calibrated.values == pytest.approx(TRUTH, rel=0.02)
    assert calibrated.kind == "period-1"
    for name, truth in TRUTH.items():
        low, high = calibrated.intervals[name]
        assert low < truth < high


def test_a_result_shows_itself(calibrated, tmp_path):
    page = calibrated._repr_html_()
    assert re.search(r"<td>gain</td><td>1\.[12]\d*</td><td>1\.[12]\d* to 1\.[12]\d*</td>", page)
    assert "data:image/png;base64," in page
    assert calibrated.plot()._repr_png_().startswith(b"\x89PNG")
    assert calibrated.plot("bench").save(tmp_path / "curves.svg").read_text().startswith("<?xml")
    assert "bench" in calibrated.report(tmp_path / "page.html").read_text()
    assert calibrated.simulated().displacement.sizes["body"] == 1
    with pytest.raises(calib.CalibError, match="no record 'bnch' .*did you mean 'bench'"):
        calibrated.plot("bnch")


def test_without_a_folder_nothing_is_left():
    found = study(budget=10).run(quiet=True)
    folder = found.folder
    assert folder.is_dir()
    del found
    assert not folder.exists()


def test_a_study_that_cannot_be_run_leaves_nothing_behind(monkeypatch, tmp_path):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with pytest.raises(calib.CalibError, match="leaves nothing"):
        study().run(budget=8, quiet=True)
    assert list(tmp_path.iterdir()) == []


def test_with_a_folder_it_is_the_study_of_the_command_line_and_is_gone_on_with(tmp_path):
    found = study(budget=12).run(tmp_path / "here", quiet=True)
    assert found.folder == tmp_path / "here" / "out"
    assert result.read(found.folder)["trials"] == 12
    before = (found.folder / "trials.jsonl").read_text()
    assert study(budget=16).run(tmp_path / "here", quiet=True).summary["trials"] == 16
    assert (found.folder / "trials.jsonl").read_text().startswith(before)
    assert calibrate(tmp_path / "here", quiet=True)["trials"] == 16


def test_a_study_is_read_as_it_was_saved(tmp_path):
    saved = study(diagnosis={"candidates": ["channel_gain"]}, fixed={}, effects=["channel_gain"])
    again = calib.Study.read(saved.save(tmp_path))
    document = saved.document
    document["record"][0]["path"] = str(tmp_path / "measured" / "bench.nc")
    assert again.document == document
    moved = calib.Study.read(again.save(tmp_path / "elsewhere" / "other.toml"))
    assert moved.document == document


def test_a_search_that_is_stopped_keeps_what_there_is(monkeypatch):
    from calib.study.progress import Progress

    def stop(self, trial, top, count):
        if count == 10:
            raise KeyboardInterrupt

    monkeypatch.setattr(Progress, "trial", stop)
    found = study().run(quiet=True)
    assert found.summary["stopped"] == "not finished"
    assert 0.5 <= found.values["gain"] <= 2.0
    assert found.intervals == {}


def test_an_effect_is_given_as_the_thing_itself(tmp_path):
    from tiny_simulators import MEMORY

    from calib.effects.channel_gain import EFFECT

    assert study(effects=[EFFECT, "plot_scale"]).document["model"]["effects"] == ["channel_gain", "plot_scale"]
    with pytest.raises(calib.CalibError, match="model.effects.*'memory'.*takes laws at"):
        study(effects=[MEMORY])


@pytest.mark.parametrize(
    ("mistake", "said"),
    [
        ({"windows": {"gian": (0.5, 2.0)}}, r"^windows\.gian: unknown parameter 'gian' \(did you mean 'gain'\?\)"),
        ({"windows": {"gain": 1.0}}, r"^windows\.gain: expected \(low, high\)"),
        ({"windows": {"gain": ("1 m", "2 m")}}, r"^windows\.gain: .*'1 m'"),
        ({"budget": -3}, r"^study\.budget: .*got -3"),
        ({"simulator": "fuor_dof"}, r"^model\.simulator: unknown simulator 'fuor_dof' \(did you mean 'four_dof'"),
        ({"terms": ["phase_curv"]}, r"^term\[1\]\.feature: unknown feature 'phase_curv' \(did you mean 'phase_cu"),
        ({"records": [1.0]}, "records: expected calib.Record, got float"),
        ({"records": []}, r"record: .*at least 1"),
        ({"windowz": {}}, "unknown keyword 'windowz'"),
        ({"effects": [3.0]}, "got float"),
        ({"options": {"falt": ""}}, r"^model\.options\.falt: unknown option of '.*Echo' \(did you mean 'fault'"),
    ],
)
def test_a_mistake_is_said_with_its_key(mistake, said):
    with pytest.raises(calib.CalibError, match=said):
        study(**mistake)


@pytest.mark.parametrize(
    ("mistake", "said"),
    [
        ({"displacement": {"mass": np.zeros((1, 400))}}, r"of 'mass': expected an array \(400,\).*\(1, 400\)"),
        ({"units": {"displacement": "mm/s"}}, r"units of displacement: .*mm/s"),
        ({"units": {"velocty": "mm/s"}}, "units: there is no channel 'velocty'"),
        ({"excitation": {**DRIVE, "frequency": "14"}}, "excitation: frequency: '14' has no unit"),
        ({"excitation": {**DRIVE, "frequenzy": 14.0}}, "excitation: unknown key 'frequenzy'"),
        ({"excitation": {"place": "base"}}, "excitation: 'quantity' is missing"),
        ({"excitation": "14 Hz"}, "excitation: expected a mapping"),
        ({"sigma": {"displacment": 1.0}}, "sigma: there is no channel 'displacment'"),
        ({"displacement": {"mass": ["a"] * 400}}, "displacement of 'mass': expected an array of numbers"),
        ({"displacement": {}, "velocity": {}}, "a record needs a channel"),
        ({"channels": {"acceleration": {"mass": np.zeros(400)}}}, "units of acceleration: expected an SI unit"),
        ({"time": BENCH.time.values[::-1]}, "time must increase"),
    ],
)  # fmt: skip
def test_a_mistake_in_a_record_is_said(mistake, said):
    with pytest.raises(calib.CalibError, match=said):
        record(**mistake)


def test_a_body_that_the_simulator_has_not_got_is_refused():
    with pytest.raises(calib.CalibError, match=r"record\[1\]\.bodies: the record's body 'beam' is none of"):
        study(records=[record(displacement={"beam": np.zeros(400)}, velocity={"beam": np.zeros(400)})])


def test_a_recorded_input_and_further_channels_come_through():
    force = np.sin(BENCH.time.values)
    made = record(
        excitation={"place": "mass", "quantity": "force", "values": 1e3 * force, "unit": "mN"},
        channels={"strain": {"mass": force}},
        units={"time": "ms", "displacement": "mm", "strain": "1"},
    ).dataset
    np.testing.assert_allclose(made.excitation.values, force)
    assert made.strain.attrs["units"] == "1"


def test_importing_calib_imports_nothing_heavy():
    code = "import sys, calib; dir(calib); print(sorted({'numpy', 'xarray', 'numba', 'matplotlib'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment(), check=True)
    assert done.stdout.strip() == "[]"


def test_an_unknown_name_is_answered_with_those_there_are():
    with pytest.raises(AttributeError, match="Study"):
        _ = calib.Stduy


def test_a_simulator_of_an_interactive_session_runs_in_its_process():
    code = (
        "import warnings, echo_study, calib; from tiny_simulators import Echo\n"
        "class Mine(Echo): pass\n"
        "record = calib.Record(echo_study.bench(), 'bench')\n"
        "study = calib.Study(Mine, [record], {'gain': (0.5, 2.0)}, budget=8, jobs=2)\n"
        "with warnings.catch_warnings(record=True) as told:\n"
        "    warnings.simplefilter('always')\n"
        "    found = study.run(quiet=True)\n"
        "assert any('defined in this session' in str(w.message) for w in told), told\n"
        "print(round(found.values['gain'], 1))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment())
    assert done.stdout.strip() == "1.2", done.stderr
