"""What is wrong with a study is said; what is wrong with a simulator is a trial's status, and the study goes on."""

from collections import Counter

import numpy as np
import pytest
from click.testing import CliRunner
from echo_study import bench, write_study
from undrawn import undrawn

from calib import records
from calib.cli import main
from calib.errors import CalibError
from calib.store import read
from calib.study.result import read as read_result
from calib.study_file import load
from calib.workflows.new import new

PATH = "study.toml:11: record[1].path"


def with_value(record, channel, sample, value):
    record[channel].values[0, sample] = value
    return record


def with_time(record, sample, value):
    time = record.time.values.copy()
    time[sample] = value
    return record.assign_coords(time=("time", time, {"units": "s"}))


def without_unit(record):
    del record["displacement"].attrs["units"]
    return record


def without_place(record):
    del record.attrs["place"]
    return record


def in_volts(record):
    record["displacement"].attrs["units"] = "V"
    return record


FAULTS = {
    "no_number": (lambda r: with_value(r, "displacement", 7, np.nan), PATH, "of body 'mass' is not a number"),
    "infinity": (lambda r: with_value(r, "velocity", 7, np.inf), PATH, "velocity of body 'mass' is not a number"),
    "time_stands": (lambda r: with_time(r, 5, r.time.values[4]), PATH, "time must increase"),
    "time_goes_back": (lambda r: with_time(r, 5, -1.0), PATH, "time must increase"),
    "time_is_no_number": (lambda r: with_time(r, 5, np.nan), PATH, "time holds NaN at sample 5"),
    "no_unit": (without_unit, PATH, "displacement states no unit"),
    "another_unit": (in_volts, PATH, "displacement is expected in 'm' or a unit of its dimension, got 'V'"),
    "transposed": (lambda r: r.transpose("time", "body"), PATH, "transpose it"),
    "no_channel": (lambda r: r.drop_vars(["displacement", "velocity"]), PATH, "no channel"),
    "another_body": (lambda r: r.assign_coords(body=["cart"]), "record[1].bodies", "'cart' is none of simulator"),
    "no_velocity": (lambda r: r.drop_vars(["velocity", "velocity_sigma"]), "study.toml:21: term[1]", "velocity"),
    "no_drive": (without_place, "record[1].excitation", "attribute 'place' is missing"),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_a_bad_record_is_refused_with_the_place_in_the_study_file(tmp_path, fault):
    spoil, place, said = FAULTS[fault]
    path = write_study(tmp_path)
    records.write(spoil(bench()), tmp_path / "bench.nc")
    with pytest.raises(CalibError) as raised:
        load(path)
    assert place in str(raised.value)
    assert said in str(raised.value)


@pytest.mark.parametrize(
    ("unit", "frequency", "expected"),
    [
        ("min", "9 Hz", "excitation.frequency: the record lasts 360 periods of 1.67 samples"),
        ("h", "9 Hz", "samples a period): check the unit of time and the frequency"),
        ("s", "9 kHz", "the record lasts 6000 periods of 0.1 samples"),
        ("s", "9 kHz", "check the unit of time and the frequency; were its time in ms, it would have 100 samples"),
        ("ms", "9 Hz", "the record lasts 0.000665556 s: check the unit of time and the frequency"),
    ],
)
def test_a_wrong_unit_of_time_or_of_the_frequency_is_named(tmp_path, unit, frequency, expected):
    path = new("study", "spring", tmp_path)[0]
    text = path.read_text().replace('"time_s", unit = "s"', f'"time_s", unit = "{unit}"')
    path.write_text(text.replace('frequency = "9 Hz"', f'frequency = "{frequency}"'))
    with pytest.raises(CalibError, match=r"study\.toml:\d+: ") as raised:
        load(path)
    assert expected in str(raised.value)


@pytest.mark.parametrize(
    ("old", "new_text", "expected"),
    [
        ('column = "v_mm_s"', "column = 4", r"study.toml:18: record\[1\].table.channels\[2\].column: .*has 3 columns"),
        ('unit = "mm/s"', 'unit = "mm"', r"study.toml:18: .*channels\[2\].unit: .*got '1 mm'"),
        ('"time_s"', '"time"', r"record\[1\].table.time.column: .*no single column 'time'"),
    ],
)
def test_a_mistake_in_a_column_is_told_at_the_line_of_its_entry(tmp_path, old, new_text, expected):
    path = new("study", "spring", tmp_path)[0]
    path.write_text(path.read_text().replace(old, new_text))
    with pytest.raises(CalibError, match=expected):
        load(path)


def test_a_table_of_a_data_logger_is_the_same_record(tmp_path):
    path = new("study", "spring", tmp_path)[0]
    (before,) = load(path).study.objective.references.values()
    data = next(path.parent.glob("*.csv"))
    logged = "Prüfstand, Messung 3\n" + data.read_text().replace(",", ";").replace(".", ",")
    data.write_bytes(logged.encode("latin-1"))
    table = '[record.table]\nencoding = "latin-1"\ndecimal = ","\nskip = 1\n'
    path.write_text(path.read_text().replace("[record.table]\n", table))
    (after,) = load(path).study.objective.references.values()
    np.testing.assert_array_equal(before.record.displacement, after.record.displacement)


def test_a_column_that_is_two_channels_is_remarked_on(tmp_path):
    path = new("study", "spring", tmp_path)[0]
    path.write_text(path.read_text().replace('"v_mm_s"', '"x_mm"'))
    with pytest.warns(UserWarning, match=r"record\[1\].table.channels: column 'x_mm' is 2 channels"):
        load(path)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.99])
def test_a_truncated_record_is_refused(tmp_path, share):
    path = write_study(tmp_path)
    content = (tmp_path / "bench.nc").read_bytes()
    (tmp_path / "bench.nc").write_bytes(content[: int(share * len(content))])
    with pytest.raises(CalibError, match="not a readable netCDF file") as raised:
        load(path)
    assert PATH in str(raised.value)


def test_a_bad_cell_of_a_table_is_refused_with_its_line(tmp_path):
    (tmp_path / "bench.csv").write_text("t,x\n0.0,1\n0.1,oops\n0.2,3\n")
    table = (
        'path = "bench.csv"\n[record.table]\ntime = { column = "t", unit = "s" }\n'
        'channels = [{ column = "x", body = "mass", channel = "displacement", unit = "mm" }]\n'
        '[record.excitation]\nplace = "base"\nquantity = "base motion"\namplitude = "1 mm"\nfrequency = "10 Hz"\n'
    )
    path = write_study(tmp_path, ('path = "bench.nc"\nnuisance = ["trigger"]\n', table))
    with pytest.raises(CalibError, match=r"study.toml:11: record\[1\].path: .*bench.csv, line 3: .*'oops'"):
        load(path)


def test_an_unknown_quantity_of_the_excitation_is_answered_with_the_known_ones(tmp_path):
    drive = '[record.excitation]\nplace = "base"\nquantity = "base motoin"\namplitude = "1 mm"\nfrequency = "10 Hz"\n'
    path = write_study(tmp_path, ('nuisance = ["trigger"]\n', 'nuisance = ["trigger"]\n' + drive))
    with pytest.raises(CalibError, match=r"record\[1\].excitation: .* got 'base motoin' \(did you mean 'base motion'"):
        load(path)


def test_the_command_line_says_it_without_a_traceback(tmp_path):
    path = write_study(tmp_path, ("low = 0.5, high = 2.0", "low = 2.0, high = 0.5"))
    ended = CliRunner().invoke(main, ["run", str(path)])
    assert ended.exit_code == 1
    assert ended.stderr.startswith(f"calib: {path}:18: windows.gain: the window is the wrong way round")
    assert "Traceback" not in ended.output
    assert not (tmp_path / "out").exists()


@undrawn()
@pytest.mark.parametrize(
    ("fault", "status", "reason"),
    [
        ("raises", "raised", "the echo broke"),
        ("nan", "not finite", "displacement"),
        ("hangs", "timeout", "1 s of wall-clock time"),
        ("dies", "crashed", "exit code 11"),
    ],
)
def test_a_simulator_that_misbehaves_fails_its_trials_and_the_study_goes_on(tmp_path, fault, status, reason):
    option = f'simulator = "tiny_simulators:Echo"\noptions = {{ fault = "{fault}", above = 1.69 }}'
    path = write_study(
        tmp_path, ('simulator = "tiny_simulators:Echo"', option), ('timeout = "20 s"', 'timeout = "1 s"')
    )
    ended = CliRunner().invoke(main, ["run", str(path), "--quiet"])
    assert ended.exit_code == 0, ended.output
    _, trials = read(tmp_path / "out")
    assert Counter(t.status == "ok" for t in trials if t.phase == "screen") == {True: 7, False: 1}
    for trial in trials:
        failed = trial.values["gain"] > 1.69
        assert (trial.status == status) == failed
        assert (reason in trial.reason) == failed
    found = read_result(tmp_path / "out")
    assert found.failed == sum(trial.status != "ok" for trial in trials)
    assert found.values["gain"] == pytest.approx(1.2, rel=0.01)


@pytest.mark.parametrize(
    ("option", "said"),
    [
        ('name = "optuna"\nsampler = "tpee"', "unknown sampler 'tpee'"),
        ('name = "scipy"\nmethod = "simplex"', "unknown method 'simplex'"),
    ],
)
def test_an_option_that_the_optimiser_refuses_costs_no_simulation_and_leaves_no_folder(tmp_path, option, said):
    path = write_study(tmp_path, ('name = "multistart"', option))
    ended = CliRunner().invoke(main, ["run", str(path)])
    assert ended.exit_code == 1
    assert said in ended.stderr
    assert "study.toml" in ended.stderr
    assert not (tmp_path / "out").exists()


def test_a_package_that_a_sampler_lacks_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr("calib.optimisers.optuna.find_spec", lambda name: None)
    path = write_study(tmp_path, ('name = "multistart"', 'name = "optuna"\nsampler = "gp"'))
    ended = CliRunner().invoke(main, ["run", str(path)])
    assert ended.exit_code == 1
    assert "needs the package torch" in ended.stderr


def test_a_study_of_which_every_trial_fails_ends_with_exit_code_4(tmp_path):
    option = 'simulator = "tiny_simulators:Echo"\noptions = { fault = "raises", above = 0.0 }'
    path = write_study(tmp_path, ('simulator = "tiny_simulators:Echo"', option), ("budget = 24", "budget = 12"))
    ended = CliRunner().invoke(main, ["run", str(path)])
    assert ended.exit_code == 4
    assert "none of 12 trials ended ok" in ended.stdout
    assert "failed: 12 (raised), such as: RuntimeError: the echo broke" in ended.stdout
    found = read_result(tmp_path / "out")
    assert (found.status, found.score.total, found.failed) == ("failed", None, 12)
    assert "the echo broke" in (tmp_path / "out" / "report.html").read_text()


def test_a_folder_that_cannot_be_made_ends_with_a_message(tmp_path):
    path = write_study(tmp_path)
    (tmp_path / "file").write_text("")
    ended = CliRunner().invoke(main, ["run", str(path), "--out", str(tmp_path / "file" / "out")])
    assert ended.exit_code == 1
    assert str(tmp_path / "file" / "out") in ended.stderr
    assert "Traceback" not in ended.output


def test_a_message_has_a_sensible_length_whatever_the_file_holds(tmp_path):
    path = write_study(tmp_path, ('feature = "phase_curve"', f'feature = "phase_curve"\nbodies = ["{100_000 * "a"}"]'))
    with pytest.raises(CalibError) as raised:
        load(path)
    assert len(str(raised.value)) < 10_000
    path.write_text(f"record = {list(range(1000))}\n")
    with pytest.raises(CalibError, match=r"has 100\d mistakes:\n(.*\n){50}\.\.\. and 95\d more$"):
        load(path)


def test_control_characters_in_a_message_are_escaped():
    assert str(CalibError("body 'a\x1b[2J'\x00\x9b, line\n2\t3")) == "body 'a\\x1b[2J'\\x00\\x9b, line\n2\t3"
