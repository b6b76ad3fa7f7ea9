"""A study from Python: the same checks and the same results as from a study file."""

import re
import subprocess
import sys

import echo_study
import numpy as np
import pytest
from child_environment import environment
from echo_study import TRUTH
from tiny_simulators import MEMORY, Echo, Mute
from undrawn import undrawn

import calib
from calib.effects.channel_gain import EFFECT
from calib.study import result
from calib.study.progress import Progress
from calib.workflows.calibrate import calibrate
from calib.workflows.document import reference_of

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


def said_by(code):
    """What an interactive session prints that is given this code."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment())
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.fixture(scope="module")
def calibrated():
    return study().run(quiet=True)


@undrawn()
def test_it_finds_what_the_study_file_finds(calibrated, tmp_path):
    said = calibrate(echo_study.write_study(tmp_path), quiet=True)
    assert calibrated.values == pytest.approx(said.values, rel=1e-9)
    assert calibrated.values == pytest.approx(TRUTH, rel=0.02)
    assert calibrated.kind == "period-1"
    for name, truth in TRUTH.items():
        low, high = calibrated.intervals[name]
        assert low < truth < high


def test_a_result_shows_itself(calibrated, tmp_path):
    page = calibrated._repr_html_()
    low, high = re.search(r"<td>gain</td><td>1\.[12]\d*</td><td>(1\.[12]\d*) to (1\.[12]\d*)</td>", page).groups()
    assert float(low) < float(high)  # digits enough to tell the ends apart
    assert "data:image/png;base64," in page
    assert calibrated.plot()._repr_png_().startswith(b"\x89PNG")
    assert calibrated.plot("bench").save(tmp_path / "curves.svg").read_text().startswith("<?xml")
    assert "bench" in calibrated.report(tmp_path / "page.html").read_text()
    assert calibrated.simulated().displacement.sizes["body"] == 1
    with pytest.raises(calib.CalibError, match="no record 'bnch' .*did you mean 'bench'"):
        calibrated.plot("bnch")


@undrawn()
def test_of_several_records_all_are_drawn_unless_one_is_named():
    both = study(records=[record(name="first"), record(name="second", velocity=None, sigma=None)], budget=10)
    found = both.run(quiet=True)
    parts = found.plot().figure.subfigs
    assert [part.get_suptitle() for part in parts] == ["first", "second"]
    assert [part.axes[0].get_xlabel().partition(" ")[0] for part in parts] == ["Displacement", "Time"]
    assert [len(found.plot(name).figure.subfigs) for name in ("first", "second")] == [1, 1]
    assert found.plot()._repr_png_().startswith(b"\x89PNG")


@undrawn()
def test_numbers_in_mm_that_state_no_unit_are_remarked_on(calibrated):
    bare = study(records=[record(name="bench", units={"time": "ms"}, sigma=None)], budget=10).run(quiet=True)
    [remark] = [text for text in bare.summary.remarks if "unit" in text]
    assert re.match(r"in bench the measured displacement of mass is \d+ times as large as", remark), remark
    assert remark.endswith("check its unit; numbers without a unit are taken as m")
    assert "taken as m" in bare._repr_html_()
    assert not any("unit" in text for text in calibrated.summary.remarks)


def test_what_python_holds_prints_as_a_few_lines(calibrated):
    assert str(study()).splitlines()[1:] == [
        "  model: tiny_simulators:Echo",
        "  records: bench",
        "  searched: gain from 0.5 to 2.0, harmonic from -1 mm to 1 mm",
    ]
    assert repr(record(name="bench")).splitlines() == [
        "record 'bench' (calibrate): displacement [m], velocity [m/s] of mass",
        "  400 samples from 0 s to 0.399 s; base motion at 'base', 10 Hz",
    ]
    headline, *parameters = str(calibrated).splitlines()
    assert re.fullmatch(r"calibration of 'echo': period-1, score 0\.\d+", headline)
    assert re.fullmatch(r"  gain = 1\.\d+ \(95 % interval: 1\.\d+ to 1\.\d+\)", parameters[0])
    assert len(parameters) == 2
    assert repr(calibrated.plot()).startswith("plot of ")


def test_candidates_of_a_diagnosis_are_checked_as_in_a_study_file(calibrated):
    with pytest.raises(
        calib.CalibError, match=r"^candidates\[1\]: unknown effect 'chanel_gain' \(did you mean 'channel_g"
    ):
        calibrated.diagnose(candidates=["chanel_gain"])
    with pytest.raises(calib.CalibError, match=r"^candidates\[1\]\.bodie: unknown key \(did you mean 'bodies'\?\)"):
        calibrated.diagnose(candidates={"name": "channel_gain", "bodie": ["mass"]})


@undrawn()
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


@pytest.mark.slow
@undrawn()
def test_with_a_folder_it_is_the_study_of_the_command_line_and_is_gone_on_with(tmp_path):
    found = study(budget=12).run(tmp_path / "here", quiet=True)
    assert found.folder == tmp_path / "here" / "out"
    assert result.read(found.folder).trials == 12
    before = (found.folder / "trials.jsonl").read_text()
    assert study(budget=16).run(tmp_path / "here", quiet=True).summary.trials == 16
    assert (found.folder / "trials.jsonl").read_text().startswith(before)
    assert calibrate(tmp_path / "here", quiet=True).trials == 16


def test_a_study_is_read_as_it_was_saved(tmp_path):
    saved = study(diagnosis={"candidates": ["channel_gain"]}, fixed={}, effects=["channel_gain"])
    again = calib.Study.read(saved.save(tmp_path))
    assert again.document == saved.document
    moved = calib.Study.read(again.save(tmp_path / "elsewhere" / "other.toml"))
    assert moved.document == saved.document


@undrawn()
def test_a_search_that_is_stopped_keeps_what_there_is(monkeypatch):
    def stop(self, trial, top, count):
        if count == 10:
            raise KeyboardInterrupt

    monkeypatch.setattr(Progress, "trial", stop)
    found = study().run(quiet=True)
    assert found.summary.stopped == "not finished"
    assert 0.5 <= found.values["gain"] <= 2.0
    assert found.intervals == {}


def test_an_effect_is_given_as_the_thing_itself(tmp_path):
    assert study(effects=[EFFECT, "plot_scale"]).document["model"]["effects"] == ["channel_gain", "plot_scale"]
    with pytest.raises(calib.CalibError, match="model.effects.*'memory'.*takes no force laws"):
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
        ({"records": []}, r"^record: expected at least 1 entry, got none$"),
        ({"windowz": {}}, "unknown keyword 'windowz'"),
        ({"options": {"gate": object()}}, r"model\.options\.gate: expected a number, a text"),
        ({"windows": [0.5, 2.0]}, "windows: expected a mapping"),
        ({"windows": {}}, "windows: expected a mapping with at least one parameter, .* got {}"),
        (
            {"simulator": Echo()},
            "simulator: got an instance of Echo; pass the class, Echo, and its arguments as options",
        ),
        ({"effects": [3.0]}, "got 3.0"),
        ({"options": {"falt": ""}}, r"^model\.options\.falt: unknown option of '.*Echo' \(did you mean 'fault'"),
    ],
)
def test_a_mistake_is_said_with_its_key(mistake, said):
    with pytest.raises(calib.CalibError, match=said):
        study(**mistake)


def test_several_mistakes_are_said_at_once_and_no_file_is_named():
    with pytest.raises(calib.CalibError) as refused:
        study(windows={"gian": (0.5, 2.0)}, simulator="nowhere:Echo2", budget=0, seed=-1)
    first, *others = str(refused.value).splitlines()
    assert first == "the study has 3 mistakes:"
    assert [line.partition(":")[0] for line in others] == ["study.seed", "study.budget", "model.simulator"]
    with pytest.raises(calib.CalibError, match="^model.simulator: .*there is no module 'nowhere' in Python's path$"):
        study(simulator="nowhere:Echo2")


def test_saving_what_only_this_session_defines_warns(tmp_path, monkeypatch):
    mine = type("Mine", (Echo,), {"__module__": "__main__"})
    monkeypatch.setattr(sys.modules["__main__"], "Mine", mine, raising=False)
    made = study(simulator=mine)
    with pytest.warns(UserWarning, match="refers to 'Mine' of this script .* which `calib run` cannot import: move it"):
        made.save(tmp_path)


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
        ({"excitation": {**DRIVE, "unit": "mm"}}, "excitation: unit is that of `values`"),
        ({"excitation": {"place": "base", "quantity": "base motion"}}, "needs frequency"),
        ({"channels": {"displacement": {"mass": np.zeros(400)}}}, "displacement is an argument of its own"),
        ({"displacement": np.zeros(400)}, "displacement: expected a mapping such as"),
        ({"units": "mm"}, "units: expected a mapping"),
        ({"name": 1}, "name: expected a text"),
        ({"sigma": {"displacment": 1.0}}, "sigma: there is no channel 'displacment'"),
        ({"displacement": {"mass": ["a"] * 400}}, "displacement of 'mass': expected an array of numbers"),
        ({"displacement": {}, "velocity": {}}, "a record needs a channel"),
        ({"channels": {"acceleration": {"mass": np.zeros(400)}}}, "units of acceleration: expected an SI unit"),
        (
            {"velocity": {"base": np.zeros(400)}},
            "displacement: no array for body 'base', which another channel has; .* each of mass, base",
        ),
        ({"time": BENCH.time.values[::-1]}, "time must increase"),
    ],
)  # fmt: skip
def test_a_mistake_in_a_record_is_said(mistake, said):
    with pytest.raises(calib.CalibError, match=said):
        record(**mistake)


def test_a_body_that_the_simulator_has_not_got_is_refused():
    with pytest.raises(calib.CalibError, match=r"record\[1\]\.bodies: the record's body 'Mass' is none of") as refused:
        study(records=[record(displacement={"Mass": np.zeros(400)}, velocity={"Mass": np.zeros(400)})])
    assert "(did you mean 'mass'?)" in str(refused.value)
    assert "bodies={'Mass': 'simulator body'} in calib.Record" in str(refused.value)


def test_a_recorded_input_and_further_channels_come_through():
    force = np.sin(BENCH.time.values)
    made = record(
        excitation={"place": "mass", "quantity": "force", "values": 1e3 * force, "unit": "mN"},
        channels={"strain": {"mass": force}},
        units={"time": "ms", "displacement": "mm", "strain": "1"},
    ).dataset
    np.testing.assert_allclose(made.excitation.values, force)
    assert made.strain.attrs["units"] == "1"


class Runless:
    name, bodies, sites = "runless", ("mass",), frozenset()
    parameters = Echo.parameters


class Bare(Echo):
    parameters = property(lambda self: self.nothing)


class Short(Echo):
    def run(self, values, excitation):
        return super().run(values, excitation, (), None)


@pytest.mark.parametrize(
    ("simulator", "message"),
    [
        (
            Runless,
            r"model\.simulator: simulator Runless lacks run, the method run\(values, excitation, laws, request\)",
        ),
        (Bare, r"model\.simulator: simulator Bare lacks parameters, a tuple of calib.Parameter, such as "),
        (Short, r"simulator Short: expected run\(values, excitation, laws, request\), got run\(values, excitation\)"),
    ],
)
def test_a_simulator_that_lacks_a_part_of_its_contract_is_refused_before_any_trial(simulator, message):
    with pytest.raises(calib.CalibError, match=message):
        study(simulator=simulator)


@undrawn()
def test_a_study_of_which_every_trial_fails_warns_with_the_reason():
    with pytest.warns(UserWarning, match="none of 4 trials ended ok .*Mute.run returned None; expected a record"):
        found = study(simulator=Mute, budget=4, study={"screen": 2}).run(quiet=True)
    assert not found.values
    assert found.summary.failures[0].status == "no record"


def test_importing_calib_imports_nothing_heavy():
    code = "import sys, calib; dir(calib); print(sorted({'numpy', 'xarray', 'numba', 'matplotlib'} & set(sys.modules)))"
    assert said_by(code) == "[]"


def test_an_unknown_name_is_answered_with_those_there_are():
    with pytest.raises(AttributeError, match="Study"):
        _ = calib.Stduy


@pytest.mark.slow
def test_simulator_and_effect_of_an_interactive_session_run_in_its_process():
    code = (
        "import warnings, echo_study, calib; from calib.modelling.laws import sensor\n"
        "from tiny_simulators import Echo\n"
        "class Mine(Echo): pass\n"
        "@sensor\n"
        "def scaled(record, p): return record.assign(displacement=record.displacement * (1.0 + p['more']))\n"
        "MORE = calib.Effect('more', 'sensor', scaled, (calib.Parameter('more', '1', 0.0, 'x', null=0.0),), 'x')\n"
        "with warnings.catch_warnings(record=True) as told:\n"
        "    warnings.simplefilter('always')\n"
        "    study = calib.Study(Mine, [calib.Record(echo_study.bench(), 'bench')], {'gain': (0.5, 2.0)},\n"
        "                        effects=[MORE], budget=8, jobs=2)\n"
        "    found = study.run(quiet=True)\n"
        "assert any('defined in this session' in str(w.message) for w in told), told\n"
        "model = study.document['model']\n"
        "print(model['simulator'], *model['effects'], round(found.values['gain'], 1))\n"
    )
    assert said_by(code) == "__main__:Mine __main__:MORE 1.2"


@pytest.fixture(scope="module")
@undrawn()
def applied():
    """A study whose record has an offset that its model lacks, diagnosed, and the cause applied."""
    shifted = record(name="bench", displacement={"mass": 1e3 * BENCH.displacement.values[0] + 0.3})
    said = study(records=[shifted]).run(quiet=True).diagnose(candidates=["channel_offset"], quiet=True)
    return said, said.apply()


@undrawn()
def test_a_cause_is_applied_and_calibrated(applied):
    said, extended = applied
    assert (said.verdict, said.causes) == ("one_of", [])  # one steady tone cannot test a prediction
    assert said.summary.classes == (("channel_offset",),)
    assert "channel_offset" in said._repr_html_()
    assert str(said).startswith("diagnosis of 'echo': one_of: channel_offset\n")
    found = extended.run(quiet=True)
    assert found.values["offset_displacement"] == pytest.approx(0.3e-3, rel=0.05)
    assert found.values["gain"] == pytest.approx(TRUTH["gain"], rel=0.02)


def test_an_applied_study_outlives_what_it_came_from(applied, tmp_path):
    said, extended = applied
    folder = said.calibration.folder.parent
    path = extended.save(tmp_path)
    again = calib.Study.read(path)
    assert again.document == extended.document
    assert str(folder) not in path.read_text()


@undrawn()
def test_a_folder_of_another_study_is_left_as_it_is(tmp_path):
    study(budget=10).run(tmp_path, quiet=True)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    with pytest.raises(calib.CalibError, match=r"is another study: it differs in windows\.gain\.low"):
        study(windows={**WINDOWS, "gain": (0.6, 2.0, "log")}).run(tmp_path, quiet=True)
    with pytest.raises(calib.CalibError, match="is another record"):
        study(records=[record(name="bench", time=2e3 * BENCH.time.values)]).save(tmp_path / "second.toml")
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before
    other = study(windows={**WINDOWS, "gain": (0.6, 2.0, "log")}, budget=10).run(tmp_path, fresh=True, quiet=True)
    assert other.summary.windows["gain"].low == 0.6


@pytest.mark.parametrize("content", [b"name = [", b"\xff"])
def test_a_file_that_is_no_study_is_left_as_it_is(content, tmp_path):
    (tmp_path / "study.toml").write_bytes(content)
    with pytest.raises(calib.CalibError, match=r"study\.toml is no study .*; choose another folder, or overwrite it"):
        study(budget=10).save(tmp_path)
    assert (tmp_path / "study.toml").read_bytes() == content


@undrawn()
def test_a_study_with_a_module_beside_it_takes_it_along(tmp_path):
    text = "from tiny_simulators import Echo\n\n\nclass Own(Echo):\n    name = 'own'\n"
    (tmp_path / "echo_of_a_study.py").write_text(text)
    path = echo_study.write_study(tmp_path, ("tiny_simulators:Echo", "echo_of_a_study:Own"))
    there = calib.Study.read(path).save(tmp_path / "elsewhere")
    assert (there.parent / "echo_of_a_study.py").read_text() == text
    assert calib.Study.read(path).run(budget=10, quiet=True).kind == "period-1"


def test_a_path_in_the_data_folder_is_read_from_anywhere(tmp_path, monkeypatch):
    monkeypatch.setenv("CALIB_DATA", str(tmp_path))
    path = echo_study.write_study(tmp_path, ("bench.nc", "${CALIB_DATA}/bench.nc"))
    read = calib.Study.read(path)
    monkeypatch.delenv("CALIB_DATA")
    read.check()
    assert read.document["record"][0]["path"] == str(tmp_path / "bench.nc")


def test_numbers_of_numpy_and_missing_options_are_taken():
    made = study(
        budget=np.int64(24), windows={"gain": np.array([0.5, 2.0]), "harmonic": (np.float32(-1e-3), "1 mm")},
        seed=np.int32(1), options={"gate": ""}, optimiser={"name": "multistart"}, terms="phase_curve",
    ).document  # fmt: skip
    assert made["study"]["budget"] == 24
    assert made["windows"]["gain"] == {"low": 0.5, "high": 2.0}
    assert made["term"] == [{"feature": "phase_curve"}]
    drive = {**DRIVE, "frequency": np.int64(10), "amplitude": np.float32(1e-3)}
    assert record(excitation=drive).dataset.attrs["frequency"] == 10.0


def test_samples_that_are_masked_or_no_real_numbers_are_refused():
    masked = np.ma.masked_values(np.where(np.arange(400) == 7, 999.0, 0.0), 999.0)
    with pytest.raises(calib.CalibError, match="not a number at sample 7"):
        record(displacement={"mass": masked})
    with pytest.raises(calib.CalibError, match="time: expected real numbers, got a duration"):
        record(time=np.arange(400).astype("timedelta64[ms]"))


def test_an_effect_of_a_module_is_known_by_that_module():
    assert reference_of(MEMORY, "calib.effects") == "tiny_simulators:MEMORY"


@pytest.mark.parametrize(("name", "given"), [("budget", 0), ("jobs", 0), ("budget", -3), ("jobs", 1.5)])
def test_a_budget_or_jobs_that_count_nothing_are_refused(name, given):
    with pytest.raises(calib.CalibError, match=f"^{name}: expected a whole number from 1 on, got {given}$"):
        study().run(**{name: given}, quiet=True)
    with pytest.raises(calib.CalibError, match=f"{name}.*got {given}"):
        study(**{name: given}).run(quiet=True)
