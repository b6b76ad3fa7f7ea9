"""The commands of calib, as a user types them."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import pytest
import xarray as xr
from child_environment import environment
from click.testing import CliRunner
from echo_study import write_study
from printed import cells
from undrawn import undrawn

from calib import records
from calib.cli import main
from calib.cli.tables import _measured
from calib.plugins import load_all
from calib.store import read
from calib.workflows.calibrate import UNFINISHED

# a process in the background of a script begins deaf to Ctrl-C, and so do its children
HEEDING = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
AGAIN = '[[record]]\nname = "again"\npath = "bench.nc"\nnuisance = ["trigger"]\nuse = "holdout"\n'
HOLDOUT = ("[model]\n", f"{AGAIN}\n[model]\n")


def calib(*arguments, code=0):
    ended = CliRunner().invoke(main, [str(a) for a in arguments])
    assert ended.exit_code == code, ended.output
    return ended


def process(*arguments, **options):
    return subprocess.Popen(
        [sys.executable, "-c", f"{HEEDING}from calib.cli import main; main()", *map(str, arguments)],
        env=environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options,
    )  # fmt: skip


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("finished")
    path = write_study(folder, HOLDOUT)
    return path, calib("run", path)


# --- help


def test_help_imports_nothing_heavy():
    heavy = {"numpy", "numba", "optuna", "rich", "pydantic"}
    code = f"import sys; from calib.cli import main; print(sorted({heavy} & set(sys.modules)))"
    assert subprocess.check_output([sys.executable, "-c", code], text=True).strip() == "[]"


@pytest.mark.parametrize("command", sorted(main.commands))
def test_every_command_explains_itself(command):
    said = calib(command, "--help").stdout.splitlines()
    assert said[0].startswith(f"Usage: main {command} ")
    assert said[2].startswith("  ")  # a sentence on what it does
    assert said[2].strip()[0].isupper()
    assert {line.split()[0] for line in said if line.startswith("  -")} >= {"-h,"}


def test_wrong_usage_is_exit_code_2():
    calib("run", code=2)
    calib("rum", code=2)


# --- run


def test_a_run_says_what_it_found(finished):
    path, ended = finished
    found = json.loads((path.parent / "out" / "result.json").read_text())
    gain, harmonic, term, total, again = cells(ended.stdout)
    errors = {name: 2.0 * error for name, error in found["confidence"]["standard_error"].items()}
    assert gain[:4] == ["gain", *_measured(found["values"]["gain"], errors["gain"], "1"), "0.5 .. 2"]
    millimetres = _measured(found["values"]["harmonic"], errors["harmonic"], "m")
    assert harmonic[:4] == ["harmonic", *millimetres, "-1 mm .. 1 mm"]
    assert millimetres[0].endswith(" mm")
    assert (term[0], total[::2], again[::3]) == ("phase_curve", ["total", "period-1"], ["again", "period-1"])
    assert float(term[1]) == float(total[1]) == pytest.approx(found["score"]["total"], rel=1e-3)
    assert float(again[1]) == pytest.approx(found["holdout"]["again"]["misfit"], rel=1e-3)
    agreement, counted, files = ended.stdout.splitlines()[-3:]
    starts = found["agreement"]
    assert agreement.startswith(f"{starts['agree']} of {starts['starts']} starts")
    assert counted.startswith("trials: 24, of which 0 failed; ")
    assert files == f"files:  {path.parent / 'out'}/ (report.html, result.json, best.nc, trials.jsonl)"
    assert ended.stderr.splitlines()[-1].startswith(f"report: 24/24 trials  best {total[1]} (period-1)")


def test_a_run_leaves_its_files(finished):
    out = finished[0].parent / "out"
    assert {"trials.jsonl", "optuna.log", "best.nc", "result.json", "report.html", "records"} <= set(os.listdir(out))


@pytest.mark.parametrize(("name", "truth"), [("gain", 1.2), ("harmonic", 2e-4)])
def test_a_run_finds_the_truth_within_its_intervals(finished, name, truth):
    low, high = json.loads((finished[0].parent / "out" / "result.json").read_text())["intervals"][name]
    assert low <= truth <= high
    assert high - low < 0.02 * truth


def test_a_run_scores_the_record_held_out_that_is_the_same_like_the_calibrated_one(finished):
    found = json.loads((finished[0].parent / "out" / "result.json").read_text())
    assert found["holdout"]["again"]["score"] == pytest.approx(found["score"]["total"], rel=1e-6)
    assert found["motion"]["kind"] == "period-1"


@undrawn()
def test_quiet_says_nothing(tmp_path):
    ended = calib("run", write_study(tmp_path), "--quiet")
    assert (ended.stdout, ended.stderr) == ("", "")


@undrawn()
def test_json_alone_is_on_stdout_and_a_finished_study_run_again_makes_no_trial_and_finds_the_same(tmp_path):
    path = write_study(tmp_path)
    first = json.loads(calib("run", path, "--json").stdout)
    assert first == json.loads((tmp_path / "out" / "result.json").read_text())
    ledger = (tmp_path / "out" / "trials.jsonl").read_bytes()
    second = json.loads(calib("run", path, "--json").stdout)
    assert (tmp_path / "out" / "trials.jsonl").read_bytes() == ledger
    assert {**first, "seconds": 0} == {**second, "seconds": 0}


@undrawn()
def test_two_jobs_find_what_one_finds(tmp_path):
    path = write_study(tmp_path)
    one = json.loads(calib("run", path, "--json", "--out", tmp_path / "one").stdout)
    two = json.loads(calib("run", path, "--json", "--out", tmp_path / "two", "--jobs", 2).stdout)
    assert {**one, "seconds": 0} == {**two, "seconds": 0}


@undrawn()
def test_a_changed_study_is_refused_and_says_what_changed(tmp_path):
    calib("run", write_study(tmp_path), "--budget", 10)
    path = write_study(tmp_path, ("high = 2.0", "high = 3.0"))
    ended = calib("run", path, code=1)
    [_, changed, remedy] = ended.stderr.partition("calib: ")[2].splitlines()
    assert changed == "  windows.gain.high: 2.0 -> 3.0"
    assert "--fresh" in remedy
    calib("run", path, "--fresh", "--budget", 10)


@undrawn()
def test_the_budget_may_grow(tmp_path):
    path = write_study(tmp_path)
    calib("run", path, "--budget", 12)
    assert json.loads(calib("run", path, "--budget", 20, "--json").stdout)["trials"] == 20


@pytest.mark.slow
@undrawn()
def test_ctrl_c_keeps_the_trials_and_says_how_to_go_on(tmp_path):
    endless = ("budget = 24", "budget = 100000"), ('name = "multistart"', 'name = "optuna"\nsampler = "random"')
    path = write_study(tmp_path, *endless)
    run = process("run", path)
    try:
        ledger, deadline = tmp_path / "out" / "trials.jsonl", time.monotonic() + 120.0
        while not (ledger.exists() and ledger.read_bytes().count(b"\n") > 4):
            assert time.monotonic() < deadline, "no trial within two minutes"
            time.sleep(0.05)
        assert json.loads(calib("status", path, "--json").stdout)["state"] == "running"
        run.send_signal(signal.SIGINT)
        _, said = run.communicate(timeout=60)
    finally:
        run.kill()
    assert run.returncode == 3, said
    assert f"calib run {path}" in said
    assert "Traceback" not in said
    assert len(read(tmp_path / "out")[1]) >= 3
    assert json.loads(calib("status", path, "--json").stdout)["state"] == "unfinished"


@pytest.mark.slow
@undrawn()
def test_a_full_disk_ends_with_a_message_and_the_ledger_intact(tmp_path):
    path = write_study(tmp_path)
    calib("run", path, "--budget", 12)
    before = read(tmp_path / "out")[1]
    limit = (tmp_path / "out" / "trials.jsonl").stat().st_size // 512 + 2  # blocks: a few lines more and no further
    code = (
        f"import resource, signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN); "
        f"resource.setrlimit(resource.RLIMIT_FSIZE, ({limit * 512}, {limit * 512})); "
        "from calib.cli import main; main()"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code, "run", str(path)],
        env=environment(),
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 1, ended.stderr
    assert "Traceback" not in ended.stderr
    assert str(tmp_path / "out") in ended.stderr
    assert read(tmp_path / "out")[1][: len(before)] == before
    calib("run", path)


@pytest.mark.slow
@undrawn()
def test_a_read_only_folder_ends_with_a_message_and_the_ledger_intact(tmp_path):
    as_user = [] if os.geteuid() else ["setpriv", "--inh-caps=-all", "--bounding-set=-all"]  # root may write anywhere
    if as_user and not shutil.which("setpriv"):
        pytest.skip("needs setpriv to give up the rights of root")
    path = write_study(tmp_path)
    calib("run", path, "--budget", 12, "--quiet")
    out = tmp_path / "out"
    before = (out / "trials.jsonl").read_bytes()
    for file in (*out.rglob("*"), out):
        file.chmod(0o555 if file.is_dir() else 0o444)
    code = "from calib.cli import main; main()"
    try:
        ended = subprocess.run(
            [*as_user, sys.executable, "-c", code, "run", str(path)],
            env=environment(),
            capture_output=True,
            text=True,
            check=False,
        )
    finally:
        for file in (out, *out.rglob("*")):
            file.chmod(0o755 if file.is_dir() else 0o644)
    assert ended.returncode == 1, ended.stderr
    assert f"cannot write {out}" in ended.stderr
    assert "Traceback" not in ended.stderr
    assert (out / "trials.jsonl").read_bytes() == before


# --- status


def test_status_of_a_finished_study(finished):
    said = json.loads(calib("status", finished[0], "--json").stdout)
    result = json.loads((finished[0].parent / "out" / "result.json").read_text())
    assert (said["state"], said["trials"], said["best"]["kind"]) == ("finished", result["trials"], "period-1")
    standing, best, *values = calib("status", finished[0]).stdout.splitlines()
    assert standing == "echo: finished, 24 of 24 trials"
    assert best.endswith(f"(period-1) at trial {result['best_trial']}")
    assert [value.split()[0] for value in values[:2]] == ["gain", "harmonic"]


def test_status_where_nothing_was_run(tmp_path):
    said = calib("status", write_study(tmp_path), code=1)
    assert said.stdout == ""
    assert said.stderr == f"calib: {tmp_path / 'out'}: no study was run here (no trials.jsonl with a header)\n"


def test_no_report_is_written_of_another_study_than_was_run(tmp_path, finished):
    shutil.copytree(finished[0].parent, tmp_path, dirs_exist_ok=True)
    path = write_study(tmp_path, HOLDOUT, ("low = 0.5,", "low = 0.6,"))
    before = (tmp_path / "out" / "report.html").read_bytes()
    assert "windows.gain.low: 0.5 -> 0.6" in calib("report", path, code=1).stderr
    assert (tmp_path / "out" / "report.html").read_bytes() == before


@undrawn()
@pytest.mark.parametrize("left", ["", '{"format": 1, "id": "fa'])
def test_a_run_killed_before_its_header_was_written_begins(tmp_path, left):
    path = write_study(tmp_path)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "trials.jsonl").write_text(left)
    calib("run", path, "--quiet", "--budget", 10)
    assert len(read(tmp_path / "out")[1]) == 10


# --- simulate


def test_simulate_writes_a_record_and_a_picture(tmp_path):
    path = write_study(tmp_path)
    ended = calib("simulate", path, "--set", "gain=1.5", "--set", "harmonic=0.1 mm", "-o", tmp_path / "new" / "loop.nc")
    record = records.read(tmp_path / "new" / "loop.nc")
    assert json.loads(record.attrs["values"]) == {"gain": 1.5, "harmonic": 1e-4}
    assert (tmp_path / "new" / "loop.png").read_bytes().startswith(b"\x89PNG")
    assert "period-1" in ended.stdout
    assert "displacement of mass: amplitude" in ended.stdout


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("gian=1", "--set: unknown parameter 'gian' (did you mean 'gain'?); the model has gain, harmonic"),
        ("gain", "--set: expected NAME=VALUE, got 'gain'"),
        ("harmonic=1 s", "--set harmonic: expected a quantity that can be given in m, got '1 s'"),
        ("gain=much", "--set gain: cannot read 'much' as a number with a unit"),
        ("gain=-1", "--set gain: expected a value in [0, inf] 1, got -1"),
    ],
)
def test_a_bad_setting_is_named(tmp_path, setting, said):
    ended = calib("simulate", write_study(tmp_path), "--set", setting, "-o", tmp_path / "loop.nc", code=1)
    assert ended.stderr.startswith(f"calib: {said}")
    assert not (tmp_path / "loop.nc").exists()


def test_a_simulation_that_fails_says_why(tmp_path):
    path = write_study(tmp_path, ("[windows]", 'options = { fault = "raises", above = 1.0 }\n[windows]'))
    ended = calib("simulate", path, "--set", "gain=1.5", "-o", tmp_path / "loop.nc", code=4)
    outcome, reason = ended.stdout.splitlines()
    assert outcome == f"{tmp_path / 'loop.nc'}: raised"
    assert reason.startswith("reason: RuntimeError: the echo broke (")
    assert "tiny_simulators.py, line " in reason
    assert xr.load_dataset(tmp_path / "loop.nc").attrs["status"] == "raised"


def test_a_record_that_the_study_lacks_is_named(tmp_path):
    ended = calib("simulate", write_study(tmp_path), "--record", "bensch", "-o", tmp_path / "loop.nc", code=1)
    assert ended.stderr == "calib: no record 'bensch' (did you mean 'bench'?); the study has bench\n"


# --- report, dashboard, list


def test_the_report_is_written_anew(finished):
    page = finished[0].parent / "out" / "report.html"
    before = page.read_text()
    page.unlink()
    assert str(page) in calib("report", finished[0]).stdout
    assert len(page.read_text()) == pytest.approx(len(before), rel=0.01)


def test_an_unfinished_study_can_be_reported(finished, tmp_path):
    path = write_study(tmp_path, HOLDOUT)
    out = tmp_path / "out"
    out.mkdir()
    lines = (finished[0].parent / "out" / "trials.jsonl").read_text().splitlines(keepends=True)
    (out / "trials.jsonl").write_text("".join(lines[:10]) + lines[10][:20])
    (out / "residuals.f64").write_bytes((finished[0].parent / "out" / "residuals.f64").read_bytes())
    calib("report", path)
    assert len(read(out)[1]) == 9  # the torn line is none
    page = " ".join(re.sub(r"<[^>]+>", " ", (out / "report.html").read_text()).split())
    best = min(read(out)[1], key=lambda trial: trial.cost)
    assert f"Best simulation at a distance of {best.cost:.3g} from the measurement" in page
    assert UNFINISHED in page


@pytest.mark.slow
def test_the_dashboard_can_be_read_and_not_written(finished):
    served = process("dashboard", finished[0], "--port", 0)
    try:
        address = served.stdout.readline().split()[0]
        assert address.startswith("http://127.0.0.1:")
        assert b"<html" in urlopen(address, timeout=30).read().lower()
        with pytest.raises(HTTPError, match="405"):
            urlopen(Request(address, data=b"{}", method="POST"), timeout=30)
    finally:
        served.send_signal(signal.SIGINT)
        _, said = served.communicate(timeout=30)
    assert "Traceback" not in said


def test_list_shows_what_a_study_may_name():
    said, group = {}, ""
    for line in calib("list").stdout.splitlines():
        group = group if line.startswith(" ") else line.strip()
        if re.match(r"   \w", line):
            said.setdefault(group, []).append(line.split()[0])
    families = list(dict.fromkeys(title.partition(":")[0] for title in said))
    assert families == ["simulators", "effects", "features", "optimisers", "readers"]
    for family in families:
        listed = [name for title, names in said.items() if title.partition(":")[0] == family for name in names]
        assert sorted(listed) == sorted(load_all(f"calib.{family}"))
    assert said["effects: friction"] == ["bouc_wen", "coulomb_friction", "iwan", "presliding", "stribeck"]


@pytest.mark.parametrize(
    ("name", "row"),
    [
        ("four_dof", ["restitution", "1", "0.05", "[0, 1]", "Newton's coefficient of restitution, beam and layer"]),
        ("gap_offset", ["dg", "m", "0", "(-inf, inf)", "change of the gap, positive where it is wider"]),
    ],
)
def test_list_says_more_about_one(name, row):
    assert cells(calib("list", name).stdout)[0] == row


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("phase_curve", "options: channels = ('displacement', 'velocity'), periods = 1"),
        ("multistart", "options: screen = None"),
    ],
)
def test_list_shows_the_options_of_what_has_no_parameters(name, line):
    assert line in calib("list", name).stdout.splitlines()


def test_list_as_json_names_the_parameters_with_their_units():
    assert "four_dof" in json.loads(calib("list", "--json").stdout)["simulators"]
    four_dof = json.loads(calib("list", "four_dof", "--json").stdout)
    assert next(p for p in four_dof["parameters"] if p["name"] == "gap")["unit"] == "m"


def test_the_records_of_a_study_file_are_shown_as_they_are_read(tmp_path):
    calib("new", "study", "bench", "--folder", tmp_path)
    shown = calib("reference", "show", tmp_path / "bench").stdout
    assert "record 'measured'" in shown
    assert "excitation: force at the mass, 9 Hz, amplitude 1 N" in shown
    assert "kind of motion: period-1" in shown
    assert (tmp_path / "bench" / "study.measured.png").is_file()


def test_a_bare_table_is_shown_by_way_of_a_study_file(tmp_path):
    (tmp_path / "lab.csv").write_text("t,x\n0,1\n1,2\n")
    refused = calib("reference", "show", tmp_path / "lab.csv", code=1).stderr
    assert "lab.csv is a table" in refused
    assert "calib reference show NAME/study.toml" in refused


def test_an_effect_or_a_simulator_of_one_s_own_is_listed_by_its_module(tmp_path, monkeypatch):
    calib("new", "effect", "own_listed_effect", "--folder", tmp_path)
    calib("new", "simulator", "own_listed_simulator", "--folder", tmp_path)
    monkeypatch.chdir(tmp_path)
    assert "equation" in calib("list", "own_listed_effect:EFFECT").stdout
    assert "stiffness" in calib("list", "own_listed_simulator:OwnListedSimulator").stdout
    assert "there is no module 'no_such_thing' in" in calib("list", "no_such_thing:EFFECT", code=1).stderr


def test_list_of_an_unknown_name():
    said = calib("list", "fourdof", code=1).stderr
    assert said.startswith("calib: nothing is called 'fourdof' (did you mean 'four_dof'?)")


def test_the_schema_is_json():
    schema = json.loads(calib("list", "--schema").stdout)
    assert set(schema["properties"]) >= {"study", "record", "model", "windows", "term", "optimiser", "diagnosis"}
    assert set(schema["required"]) <= set(schema["properties"])


# --- tables


@pytest.mark.parametrize(
    ("value", "error", "unit", "texts"),
    [
        (0.99982, 4.6e-4, "1", ("0.99982", "0.00046")),
        (1.0484e-3, 1.2e-6, "m", ("1.0484 mm", "0.0012 mm")),
        (1.25e6, 3e4, "N/m", ("1250000 N/m", "30000 N/m")),
        (39886935.4, 351519.2, "1/m", ("39890000 1/m", "350000 1/m")),
        (5.278e-6, 7.7e-8, "kg", ("5.278e-06 kg", "7.7e-08 kg")),
        (0.5, None, "1", ("0.5", "-")),
        (2.1413e-7, None, "s", ("0.21413 us", "-")),
        (2.1413e-7, 1.2e-9, "s", ("0.2141 us", "0.0012 us")),
    ],
)
def test_a_value_has_the_digits_of_its_error(value, error, unit, texts):
    assert _measured(value, error, unit) == texts


def test_a_misspelt_command_is_answered_with_the_nearest():
    ended = CliRunner().invoke(main, ["calibrat"])
    assert ended.exit_code == 2
    assert "there is no command 'calibrat'" in ended.stderr
    ended = CliRunner().invoke(main, ["diagnos", "studies/minimal"])
    assert "did you mean 'diagnose'?" in ended.stderr


@pytest.mark.parametrize("command", ["run", "diagnose", "sweep", "rehearse"])
def test_the_number_of_processes_has_a_short_name(command):
    assert "-j, --jobs" in calib(command, "--help").stdout
    said = calib(command, "study.toml", "-j", "none", code=2).stderr
    assert "Invalid value for '--jobs' / '-j': 'none' is not a valid integer" in said
