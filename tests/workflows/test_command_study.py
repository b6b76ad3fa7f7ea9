"""A program of a stranger, calibrated from a study file alone."""

import json
import os
import random
import re
import signal
import subprocess
import sys
import time
from contextlib import suppress

import pytest
import tomlkit
from bouncer import OPTIONS, lay_out
from child_environment import environment
from click.testing import CliRunner
from echo_study import write_study
from kills import KILLS
from marked_processes import MARK, new_mark, survivors
from undrawn import undrawn
from written_page import page_content

import calib
from calib.cli import main
from calib.errors import CalibError, CodeChanged
from calib.execution.guardian import descendants
from calib.modelling.model import Model
from calib.modelling.simulator import Request
from calib.records import write
from calib.records.excitation import Excitation
from calib.simulators.command import Command
from calib.store import read
from calib.store.code import code_change
from calib.study import choice
from calib.study_file import load
from calib.workflows.calibrate import calibrate, rebuild
from calib.workflows.dry_run import check_simulator_runs, dry_run_study

TRUTH = {"gap": 0.8e-3, "restitution": 0.45}
DRIVE = Excitation("mass", "force", frequency=20.0, amplitude=30.0)
KEYS = {"periods": 3, "samples": 60, "settle": 20}


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    """Record of the program at the true values."""
    folder = lay_out(tmp_path_factory.mktemp("truth"))
    record = Model(Command(**OPTIONS, folder=str(folder))).run(TRUTH, DRIVE, Request(**KEYS))
    for name in ("model", "values", "command", "inputs", "rung"):
        del record.attrs[name]
    write(record, folder / "truth.nc")
    return folder / "truth.nc"


def lay_out_study(folder, truth, budget=24, study=None, **options):
    """Write a study of the program into a folder; return the path of its file."""
    lay_out(folder)
    document = {
        "study": {"name": "bouncer", "seed": 1, "budget": budget, "timeout": "5 s", **KEYS, **(study or {})},
        "record": [{"name": "bench", "path": str(truth)}],
        "model": {"simulator": "command", "options": {**OPTIONS, **options}},
        "windows": {"gap": {"low": "0.5 mm", "high": "1.5 mm"}, "restitution": {"low": 0.2, "high": 0.9}},
        "term": [{"feature": "phase_curve"}],
    }
    (folder / "study.toml").write_text(tomlkit.dumps(document))
    return folder / "study.toml"


@undrawn()
def run(path, **more):
    return calibrate(path, quiet=True, **more)


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory, truth):
    """Study file of the program, and what its calibration has found."""
    path = lay_out_study(tmp_path_factory.mktemp("calibrated"), truth, study={"jobs": 2})
    return path, calibrate(path, quiet=True)


def test_the_true_values_are_found(calibrated):
    path, result = calibrated
    assert result.values == pytest.approx(TRUTH, rel=1e-3)
    assert result.motion.kind == "period-1"
    assert result.failed == 0
    runs = path.parent / "out" / "runs"
    assert [path.name for path in runs.iterdir() if any(path.iterdir())] == ["dry-run"]


@pytest.mark.slow
@pytest.mark.parametrize("named", [False, True])
def test_fifty_runs_of_a_slow_program_are_searched_by_emulators(tmp_path, truth, monkeypatch, capsys, named):
    path = lay_out_study(tmp_path, truth, 50)
    if named:
        path.write_text(path.read_text() + '\n[optimiser]\nname = "surrogate"\n')
    else:
        monkeypatch.setattr(choice, "MIN_COSTLY_SECONDS", 0.0)  # every program is slow
    with undrawn():
        result = calibrate(path)
    assert result.values == pytest.approx(TRUTH, rel=1e-3)
    assert result.trials <= 50
    said = ["emulators search" in text for text in ("; ".join(result.remarks), capsys.readouterr().err)]
    assert said == [not named, not named]
    stored = json.loads((path.parent / "out" / "result.json").read_text())
    assert stored["remarks"] == list(result.remarks)


def test_a_report_needs_neither_program_nor_templates(calibrated, tmp_path):
    path = calibrated[0]
    before = page_content(path.parent / "out" / "report.html")
    assert "Calibration of bouncer (command) against 1 record" in before
    taken = [file for file in path.parent.iterdir() if not file.is_dir() and file != path]
    assert {file.name for file in taken} == {"bouncer", "deck.in.j2"}
    for file in taken:
        file.rename(tmp_path / file.name)
    assert page_content(rebuild(path)) == before


def test_a_dry_run_shows_what_was_run_and_read(tmp_path, truth):
    path = lay_out_study(tmp_path, truth)
    answer = CliRunner().invoke(main, ["run", str(path), "--dry-run"])
    assert answer.exit_code == 0, answer.output
    text = " ".join(answer.output.replace("│", " ").split())
    for part in (
        "deck.in: 3 lines",
        "its output was read",
        "column x",
        "displacement of mass [mm]",
        "3 periods of 0.05",
    ):
        assert part in text
    deck = str(tmp_path / "out/runs/dry-run/deck.in")
    assert deck in answer.output.replace("│", "").replace("\n", "").replace(" ", "")
    assert re.search(r"displacement of mass amplitude [\d.]+ mm; measured [\d.]+ mm, a factor of [01]\.\d+ ", text)
    assert not (tmp_path / "out" / "trials.jsonl").exists()
    assert (tmp_path / "out" / "runs" / "dry-run" / "deck.in").read_text().startswith("10000.0 20.0 0.001 0.6\n")


def test_a_dry_run_in_a_wrong_unit_says_to_check_it(tmp_path, truth):
    read = {**OPTIONS["read"], "bodies": {"mass": {"displacement": "x", "velocity": "v"}}}
    answer = CliRunner().invoke(main, ["run", str(lay_out_study(tmp_path, truth, read=read)), "--dry-run"])
    text = " ".join(answer.output.replace("│", " ").split())
    assert re.search(
        r"displacement of mass amplitude [\d.]+ m; measured [\d.]+ mm, a factor of 1.*: check the units", text
    )


def test_a_dry_run_of_a_wrong_reader_shows_the_columns_there_are(tmp_path, truth):
    read = {**OPTIONS["read"], "bodies": {"mass": {"displacement": {"column": "y", "unit": "mm"}}}}
    path = lay_out_study(tmp_path, truth, read=read)
    answer = CliRunner().invoke(main, ["run", str(path), "--dry-run"])
    assert answer.exit_code == 4
    assert "no column 'y'" in " ".join(answer.output.replace("│", " ").split())
    with pytest.raises(CalibError, match="the first run, of record 'bench' .* no column 'y'"):
        run(path)
    assert CliRunner().invoke(main, ["run", str(path)]).exit_code == answer.exit_code
    assert not (tmp_path / "out" / "trials.jsonl").exists()


def test_a_dry_run_of_another_simulator_shows_its_record(tmp_path):
    answer = CliRunner().invoke(main, ["run", str(write_study(tmp_path)), "--dry-run"])
    assert answer.exit_code == 0, answer.output
    assert "kind of motion" in answer.output


def test_a_search_that_goes_on_makes_no_second_dry_run(tmp_path, truth):
    path = counted(lay_out_study(tmp_path, truth), tmp_path)
    stages = []
    for _ in range(2):
        check_simulator_runs(load(path), stages.append)
    assert stages == ["dry run"]
    assert (tmp_path / "count").read_text().count("x") == 1
    check_simulator_runs(load(lay_again(path, cores=2)), stages.append)
    assert stages == ["dry run"] * 2


def counted(path, folder, **options):
    """Let the program of a study count its runs in the file `count`."""
    (folder / "count.sh").write_text(f'#!/bin/sh\necho x >> {folder}/count; exec {folder}/bouncer "$@"\n')
    (folder / "count.sh").chmod(0o755)
    return lay_again(path, run=["./count.sh deck.in"], **options)


def lay_again(path, **options):
    """Change options of a study."""
    document = tomlkit.parse(path.read_text())
    document["model"]["options"].update(options)
    path.write_text(tomlkit.dumps(document))
    return path


@pytest.mark.slow
def test_a_new_ledger_is_answered_from_the_cache_and_the_best_point_is_not(tmp_path, truth):
    path = counted(lay_out_study(tmp_path, truth, budget=3), tmp_path)
    first = run(path)
    before = (tmp_path / "count").read_text().count("x")
    again = run(path, fresh=True)
    assert (tmp_path / "count").read_text().count("x") == before + 1
    assert (again.values, again.score.total) == (first.values, first.score.total)
    assert [trial.simulations for trial in read(tmp_path / "out")[1]] == [0] * 3
    assert any("3 of 3 trials were answered from the cache" in remark for remark in again.remarks)
    assert any("count.sh is a script: programs that it calls" in remark for remark in again.remarks)


REPLACED = """#!/bin/sh
# the fourth run puts another program in the place of this one
echo x >> {folder}/count
if [ $(wc -l < {folder}/count) = 4 ]; then mv {folder}/other {folder}/count.sh; fi
exec {folder}/bouncer "$@"
"""


@pytest.mark.slow
def test_a_program_that_is_replaced_during_a_search_ends_it_and_its_trials_are_kept(tmp_path, truth):
    path = lay_out_study(tmp_path, truth, budget=6)
    program = tmp_path / "count.sh"
    program.write_text(REPLACED.format(folder=tmp_path))
    program.chmod(0o755)
    (tmp_path / "other").write_text(program.read_text().replace("exec", "sleep 0; exec"))
    (tmp_path / "other").chmod(0o755)
    lay_again(path, run=["./count.sh deck.in"])
    with pytest.raises(CodeChanged, match=r"program count.sh: .*count.sh has changed since the study was read"):
        run(path)
    assert [trial.status for trial in read(tmp_path / "out")[1]] == ["ok"] * 2, "one of three runs was the dry run"
    assert len(list((tmp_path / "out/cache").glob("*.nc"))) == 3
    with pytest.warns(UserWarning, match="the code of program count.sh has changed"):
        assert run(path).trials == 6
    assert {trial.segment for trial in read(tmp_path / "out")[1]} == {0, 1}


def test_a_file_that_changes_is_another_code(tmp_path, truth):
    path = lay_out_study(tmp_path, truth)
    before = load(path).study.code
    assert sorted(before) == ["file deck.in.j2", "program bouncer"]
    template = tmp_path / "deck.in.j2"
    template.write_text(template.read_text().replace("{{ damping }}", "{{ damping * 1.5 }}"))
    after = load(path).study.code
    assert [name for name in before if before[name] != after[name]] == ["file deck.in.j2"]
    assert "the code of file deck.in.j2 has changed" in code_change(before, after, 4)


def test_a_reader_of_a_module_belongs_to_the_code(tmp_path, truth):
    (tmp_path / "bouncer_reader.py").write_text(READER)
    path = lay_out_study(tmp_path, truth, read={**OPTIONS["read"], "reader": "bouncer_reader:table"})
    file = load(path)
    assert sorted(file.study.code) == ["bouncer_reader", "file deck.in.j2", "program bouncer"]
    reference = file.reference()
    record = file.study.model.run({}, reference.excitation, reference.request)
    assert record.attrs["status"] == "ok", record.attrs["reason"]


READER = """
import numpy as np

def table(path):
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    return rows[:, 0], {"x": rows[:, 1], "v": rows[:, 2]}
"""


def test_what_has_no_influence_on_records_is_no_part_of_the_definition(tmp_path, truth):
    path = lay_out_study(tmp_path, truth)
    before = load(path).study.header.definition
    assert load(lay_again(path, keep="all", cache=False)).study.header.definition == before
    assert load(lay_again(path, cores=2)).study.header.definition != before


def test_mistakes_in_a_template_stand_beside_the_line_of_the_study(tmp_path, truth):
    path = lay_out_study(tmp_path, truth)
    (tmp_path / "deck.in.j2").write_text("{{ gap }} {{ restitution }}\n{{ stifness }} {{ damping }}\n")
    with pytest.raises(
        CalibError, match=r"study.toml:\d+: model.options: deck.in.j2:2: unknown placeholder 'stifness'"
    ):
        load(path)
    (tmp_path / "deck.in.j2").write_text(
        "{{ gap }} {{ stiffness }} {{ damping }} {{ restitution }} {{ excitation.time }}"
    )
    with pytest.raises(CalibError, match=r"study.toml:\d+: record.*excitation: deck.in.j2:1: undefined: .*'time'"):
        load(path)


@pytest.mark.parametrize(
    ("template", "excitation", "reason"),
    [
        ("30", {"amplitude": "40 N"}, "record.2..excitation.amplitude: the amplitude of 40 N of this record and the "
         "amplitude of 30 N of 'bench' are simulated alike: no template names excitation.amplitude: write it"),
        ("{{ excitation.amplitude }} {# excitation.phase #}", {"phase": "90 deg"},
         "record.2..excitation.phase: the phase of 90 deg has no influence .* no template names excitation.phase"),
        ("{{ excitation.amplitude }}", {"frequency": "21 Hz"}, ""),
        ("{% set e = excitation %}{{ e.amplitude }}", {"amplitude": "40 N", "phase": "90 deg"}, ""),
    ],
)  # fmt: skip
def test_excitations_that_no_template_tells_apart_are_refused(tmp_path, truth, template, excitation, reason):
    path = lay_out_study(tmp_path, truth)
    (tmp_path / "deck.in.j2").write_text(
        f"{{{{ gap }}}} {{{{ stiffness + damping + restitution }}}} {{{{ excitation.frequency }}}} {template}\n"
    )
    document = tomlkit.parse(path.read_text())
    drive = {"quantity": "force", "place": "mass", "frequency": "20 Hz", "amplitude": "30 N", **excitation}
    document["record"].append({"name": "loud", "path": str(truth), "use": "holdout", "excitation": drive})
    path.write_text(tomlkit.dumps(document))
    if not reason:
        load(path)
        return
    with pytest.raises(CalibError, match=reason):
        load(path)


def test_values_that_no_template_takes_are_mistakes_of_the_options_or_of_the_window(tmp_path, truth):
    path = lay_out_study(tmp_path, truth)
    deck = (
        "{{ gap | unit('mm') | fortran('F4.2') }} {{ restitution }}\n{{ stiffness | fortran('FIELD') }} {{ damping }}\n"
    )
    (tmp_path / "deck.in.j2").write_text(deck.replace("FIELD", "F6.3"))
    with pytest.raises(CalibError, match=r"study.toml:\d+: model.options: deck.in.j2:2: 10000.0 does not fit F6.3"):
        load(path)
    (tmp_path / "deck.in.j2").write_text(deck.replace("FIELD", "F9.1"))
    load(path)
    document = tomlkit.parse(path.read_text())
    document["windows"]["gap"]["high"] = "15 mm"
    path.write_text(tomlkit.dumps(document))
    with pytest.raises(CalibError, match=r"windows.gap.high: at gap = 15 mm: deck.in.j2:1: 15.0 does not fit F4.2"):
        load(path)


@undrawn()
def test_a_study_in_python_finds_its_files_in_the_working_folder(tmp_path, truth, monkeypatch):
    monkeypatch.chdir(lay_out(tmp_path / "here"))
    study = calib.Study(
        "command",
        [calib.Record.from_file(truth, name="bench")],
        {"gap": ("0.5 mm", "1.5 mm"), "restitution": (0.2, 0.9)},
        options=OPTIONS, budget=3, jobs=1, study=KEYS,
    )  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert study.run(quiet=True).summary.trials == 3


HANGING = """#!/bin/sh
# beyond a gap of 1.2 mm the solver hangs with a family of its own, below 0.7 mm it crashes
gap=$(awk '{ print $3; exit }' deck.in)
if awk "BEGIN { exit !($gap > 0.0012) }"; then setsid sh -c 'setsid sleep 600 & sleep 600' & sleep 600; fi
if awk "BEGIN { exit !($gap < 0.0007) }"; then echo matrix is singular; kill -SEGV $$; fi
exec ../../../bouncer deck.in
"""


def hanging_study(folder, truth, **study):
    path = lay_out_study(folder, truth, study={"timeout": "4 s", "jobs": 2, **study})
    (folder / "hanging.sh").write_text(HANGING.replace("../../../bouncer", str(folder / "bouncer")))
    (folder / "hanging.sh").chmod(0o755)
    return lay_again(path, run=["./hanging.sh"])


@pytest.mark.slow
def test_runs_that_hang_or_crash_say_why_and_leave_nothing(tmp_path, truth, monkeypatch):
    mark = new_mark()
    monkeypatch.setenv(MARK, mark)
    path = hanging_study(tmp_path, truth, budget=9, screen=8)
    result = subprocess.run(
        [sys.executable, "-m", "calib", "run", str(path), "--json", "--quiet"], env={**environment(), MARK: mark},
        stdout=subprocess.PIPE, check=True,
    )  # fmt: skip
    assert json.loads(result.stdout)["trials"] == 9
    assert not survivors(mark)
    trials = read(tmp_path / "out")[1]
    hung = [trial for trial in trials if trial.values["gap"] > 1.2e-3]
    crashed = [trial for trial in trials if trial.values["gap"] < 0.7e-3]
    assert hung
    assert crashed
    assert {trial.status for trial in hung} == {"timeout"}
    assert {trial.status for trial in crashed} == {"program failed"}
    assert all("its log ends: matrix is singular" in trial.reason for trial in crashed)
    assert not running(path)
    assert len(list((tmp_path / "out/runs").glob("failed-*"))) >= len(hung) + len(crashed)


@pytest.mark.slow
def test_what_a_killed_run_has_left_is_swept_by_the_next(tmp_path, truth):
    path, mark = hanging_study(tmp_path, truth, budget=9, screen=8), new_mark()
    killed(path, mark, random.Random(1), signal.SIGKILL, of=("run",))
    assert not survivors(mark)
    assert running(path)
    other = tmp_path / "out/runs/active/elsewhere-1-1-0123456789ab"
    other.mkdir(parents=True)
    dry_run_study(path)
    assert running(path) == [other], "that of another machine is left alone"


def killed(path, mark, rng, number, of=("run", "run", "worker")):
    """Start a run in a session of its own; kill it, one of its workers or a whole group while a program runs."""
    parent = subprocess.Popen(
        [sys.executable, "-m", "calib", "run", str(path), "--quiet"], env={**environment(), MARK: mark},
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip
    active, before = path.parent / "out/runs/active", set(running(path))
    limit = time.monotonic() + 60.0
    while set(running(path)) <= before:
        assert time.monotonic() < limit, active
        time.sleep(0.02)
    time.sleep(rng.uniform(0.0, 1.5))
    victim = next(iter(workers(parent.pid)), parent.pid) if rng.choice(of) == "worker" else parent.pid
    with suppress(ProcessLookupError):  # a worker may just have ended
        rng.choice([os.kill, os.killpg])(victim, number)
    if victim != parent.pid:  # a run outlives a worker
        time.sleep(0.5)
        os.kill(parent.pid, signal.SIGKILL)
    parent.wait()


def running(path):
    """Folders in which a program of a study runs, or ran when its `calib` was killed."""
    return list((path.parent / "out/runs").glob("active/*"))


def workers(parent):
    """Leaders of the process groups below a process that are not its own."""
    leaders = []
    for pid in descendants(parent):
        with suppress(ProcessLookupError):
            leaders += [pid] if os.getpgid(pid) == pid else []
    return leaders


@pytest.mark.slow
def test_nothing_is_left_after_kills_at_random(tmp_path, truth):
    path, rng = hanging_study(tmp_path, truth, budget=2000, screen=64), random.Random(0)
    for kill in range(KILLS):
        mark = new_mark()
        number = (signal.SIGTERM, signal.SIGINT, signal.SIGKILL)[kill % 3]
        killed(path, mark, rng, number)
        assert not survivors(mark), (kill, number)
    dry_run_study(path)
    assert not running(path)
