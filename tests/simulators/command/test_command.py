"""Any program as a simulator."""

import os
import pickle
import re
import sys

import numpy as np
import pytest
from bouncer import OPTIONS, lay_out
from shell_program import DRIVE, READ, REQUEST, WRITE, command, left, ran, script

from calib.errors import CalibError
from calib.execution.deadline import within
from calib.modelling.model import Model
from calib.modelling.simulator import Request
from calib.records import check
from calib.records.cycles import kind_of_motion
from calib.records.excitation import Excitation
from calib.simulators.command import Command
from calib.testing import SimulatorSuite


class TestConformance(SimulatorSuite):
    """The suite of all simulators, on the program of a stranger."""

    excitation = DRIVE
    request = Request(periods=2, samples=40)

    @pytest.fixture(autouse=True)
    def _laid_out(self, tmp_path):
        self.folder = lay_out(tmp_path / "study")

    def make(self):
        return Command(**OPTIONS, folder=str(self.folder), settle=126)


def test_a_record_begins_after_the_periods_that_are_dropped(tmp_path):
    record = check(ran(command(tmp_path, WRITE)))
    assert record.attrs["status"] == "ok"
    assert record.attrs["rung"] == 1
    assert "resampled" not in record.attrs
    np.testing.assert_allclose(record.time.values, 0.0025 * np.arange(40))
    np.testing.assert_array_equal(record.displacement.values[0], [float(f"{np.sin(i):.6g}") for i in range(20, 60)])
    np.testing.assert_allclose(record.section_displacement.values[0], np.sin([20, 40, 60]), atol=1e-6)
    assert left(tmp_path) == []


def test_output_on_other_instants_is_interpolated_and_this_is_said(tmp_path):
    read = {**READ, "bodies": {"tip": {"displacement": {"column": "u", "unit": "mm"}}}}
    program = WRITE.replace("i <= 60", "i <= 240").replace("0.0025", "0.000626").replace("sin(i)", "sin(i / 40)")
    record = ran(command(tmp_path, program, read=read))
    assert record.attrs["resampled"].startswith("interpolated (PCHIP) from 241 instants, 0.000626 s apart")
    expected = 1e-3 * np.sin(np.arange(20, 60) * 0.0025 / 0.000626 / 40)
    np.testing.assert_allclose(record.displacement.values[0], expected, atol=2e-6)


def test_few_periods_are_judged_with_what_there_is(tmp_path):
    record = ran(
        command(tmp_path, WRITE.replace("sin(i)", "sin(i * 0.3141592653589793)")),
        Request(periods=1, samples=20, settle=2),
    )
    motion = kind_of_motion(record)
    assert (motion.kind, motion.period) == ("period-1", 1)
    assert "over 2 periods, too few to tell more" in motion.evidence


@pytest.mark.parametrize(
    ("lines", "options", "status", "reason"),
    [
        (["echo no license; exit 3"], {}, "program failed", "exit code 3; details: its log ends: no license"),
        (["echo gone >&2; kill -9 $$"], {}, "program failed", "ended by signal 9; details: its log ends: gone"),
        ([WRITE, "echo '*ERROR in 3'"], {"fail_if": "*ERROR"}, "program failed", r"it printed '\*ERROR' \(fail_if\)"),
        ([WRITE, "echo no convergence"], {"fail_if": ["x", "/no conv.*ce/"]}, "program failed", "'no convergence'"),
        (["true"], {}, "no output", "it has written no file out.csv"),
        (["echo time,u > out.csv"], {}, "unreadable output", "out.csv"),
        (["printf 'time,u\\n0,x\\n1,2\\n' > out.csv"], {}, "unreadable output", "out.csv"),
        ([WRITE.replace("60", "40")], {}, "short output", "covers 0 to 0.1 s; 0.05 to 0.1475 s are needed"),
        ([WRITE.replace("sin(i)", '(i < 50 ? "1" : "nan")')], {}, "not finite", "'u' of out.csv holds NaN .* 50 on"),
        ([WRITE.replace("i * 0.0025", "5")], {}, "unreadable output", "it must increase"),
        ([WRITE.replace("time,u", "time,w")], {}, "unreadable output", "no column 'u' .displacement of tip.*it has"),
        (["sleep 600"], {"inactivity": "0.3 s"}, "inactive", "no output for 0.3 s"),
    ],
)  # fmt: skip
def test_a_run_that_fails_is_a_status_with_the_end_of_its_log(tmp_path, lines, options, status, reason):
    record = ran(command(tmp_path, *lines, **options))
    assert record.attrs["status"] == status

    assert re.search(reason, record.attrs["reason"]), record.attrs["reason"]
    assert left(tmp_path) == []


def test_a_text_in_the_log_ends_a_run_that_goes_on(tmp_path):
    record = ran(command(tmp_path, "echo ERROR; sleep 600", fail_if="ERROR"))
    assert record.attrs["reason"].startswith(str(tmp_path / "solve.sh"))
    assert "fail_if" in record.attrs["reason"]


def test_a_run_gives_up_before_its_trial_is_out_of_time(tmp_path):
    with within(1.0):
        record = ran(command(tmp_path, "echo step 1; sleep 600"))
    assert record.attrs["status"] == "timeout"
    assert "no result within" in record.attrs["reason"]
    assert "its log ends: step 1" in record.attrs["reason"]


def test_the_next_command_line_answers_where_one_fails(tmp_path):
    first = script(tmp_path, "touch debris; echo too large a step; exit 1", name="large.sh")
    second = script(tmp_path, "test -e debris && exit 9", WRITE, name="small.sh")
    record = ran(command(tmp_path, run=[first, second]))
    assert record.attrs["rung"] == 2
    assert "large.sh: program failed: it ended with exit code 1" in record.attrs["failed_rungs"]


def test_each_command_line_may_write_a_file_of_its_own(tmp_path):
    second = script(tmp_path, WRITE.replace("out.csv", "fine.csv"), name="fine.sh")
    lines = [script(tmp_path, "exit 3"), second]
    record = ran(command(tmp_path, run=lines, read={**READ, "file": ["out.csv", "fine.csv"]}))
    assert (record.attrs["status"], record.attrs["rung"]) == ("ok", 2)


def test_times_of_seven_digits_are_the_instants_that_were_asked_for(tmp_path):
    sevenths = WRITE.replace("i * 0.0025", 'sprintf("%.6e", i * 0.0025 + 4e-8)')
    assert "resampled" not in ran(command(tmp_path, sevenths)).attrs


@pytest.mark.parametrize("offset", [2e-4, -2e-4])
def test_an_output_that_begins_a_rounding_too_late_is_taken_with_its_first_sample(tmp_path, offset):
    record = ran(command(tmp_path, rounded(offset)))
    assert record.attrs["status"] == "ok", record.attrs["reason"]
    assert record.displacement.values[0, 0] == pytest.approx(np.sin(20), abs=0.1 if offset < 0.0 else 1e-6)
    assert record.sizes["period"] == 3


@pytest.mark.parametrize(
    ("offset", "gap"), [(4e-4, "it begins 0.4 ms too late, and"), (-0.01, "it ends 7.5 ms too early, and rounding")]
)
def test_an_output_that_is_short_by_more_is_refused_with_the_gap(tmp_path, offset, gap):
    record = ran(command(tmp_path, rounded(offset)))
    assert record.attrs["status"] == "short output"
    assert gap in record.attrs["reason"]
    assert "accounts for 0.25 ms, 0.1 of the sample spacing" in record.attrs["reason"]


def rounded(offset):
    """A program that writes the recorded instants only, all beside them by an offset [s]."""
    row = f'printf "%.4f,%.9g\\n", i * 0.0025 + {offset}, sin(i)'
    return f"awk 'BEGIN {{ print \"time,u\"; for (i = 20; i <= 60; i++) {row} }}' > out.csv"


def test_where_all_command_lines_fail_each_says_why(tmp_path):
    lines = [
        script(tmp_path, f"echo {word}; exit {code}", name=f"{word}.sh") for code, word in ((1, "one"), (2, "two"))
    ]
    reason = ran(command(tmp_path, run=lines, keep="failed")).attrs["reason"]
    assert "one.sh: it ended with exit code 1; " in reason
    assert "two.sh: it ended with exit code 2; details: its log ends: two" in reason
    [kept] = left(tmp_path)
    assert reason.endswith(f"kept in out/runs/{kept}")
    assert sorted(path.name for path in (tmp_path / "out/runs" / kept).iterdir()) == ["calib.log", "calib.log.1"]


def test_command_lines_are_templates_without_a_shell(tmp_path):
    (tmp_path / "show.py").write_text("import sys\nprint(sys.argv[1:])\nsys.exit(4)\n")
    line = "python3 show.py {{ gap | unit('mm') }} '$HOME; echo *' --cores={{ cores }}"
    record = ran(command(tmp_path, run=[line], template=["show.py"], parameters={"gap": "2 mm"}, cores=3))
    assert "['2.0', '$HOME; echo *', '--cores=3']" in record.attrs["reason"]


def test_the_environment_is_that_of_calib_and_what_is_stated(tmp_path, monkeypatch):
    monkeypatch.setenv("CALIB_TEST_OWN", "inherited")
    line = "echo $CALIB_TEST_OWN $SOLVER_KEY $OMP_NUM_THREADS $(basename $PWD | wc -c); exit 1"
    record = ran(command(tmp_path, line, environment={"SOLVER_KEY": "seven"}, cores=2))
    assert "log ends: inherited seven 2" in record.attrs["reason"]


def test_values_that_no_template_takes_are_a_status(tmp_path):
    (tmp_path / "a.inp.j2").write_text('{{ gap | fortran("F5.3") }}')
    simulator = command(tmp_path, WRITE, template=["a.inp.j2"], parameters={"gap": 1.0})
    record = Model(simulator).run({"gap": 1e6}, DRIVE, REQUEST)
    assert record.attrs["status"] == "not rendered"
    assert "does not fit F5.3" in record.attrs["reason"]


@pytest.mark.parametrize(
    ("keep", "program", "kept"),
    [
        ("none", "exit 1", []), ("failed", "exit 1", ["failed"]), ("best", "exit 1", []), ("all", "exit 1", ["failed"]),
        ("none", WRITE, []), ("failed", WRITE, []), ("best", WRITE, []), ("all", WRITE, ["ok"]),
    ],
)  # fmt: skip
def test_run_folders_are_kept_as_asked(tmp_path, keep, program, kept):
    ran(command(tmp_path, program, keep=keep))
    assert [name.partition("-")[0] for name in left(tmp_path)] == kept


def test_the_final_evaluation_keeps_the_best_folder(tmp_path):
    ran(command(tmp_path, WRITE, keep="best").afresh())
    [name] = left(tmp_path)
    assert name.startswith("best-")
    assert {path.name for path in (tmp_path / "out/runs" / name).iterdir()} == {"calib.log", "out.csv"}


def test_the_same_inputs_are_answered_from_the_cache_and_this_is_said(tmp_path):
    simulator = command(tmp_path, "echo run >> " + str(tmp_path / "count"), WRITE)
    first, again = ran(simulator), ran(simulator)
    assert again.attrs["simulations"] == 0
    assert first.drop_attrs().equals(again.drop_attrs())
    assert ran(simulator.afresh()).attrs.get("simulations", 1) == 1
    assert ran(simulator, Request(periods=1, samples=20, settle=1)).sizes["time"] == 20
    assert (tmp_path / "count").read_text().count("run") == 3


OWN_READER = """import numpy as np
from cache_scale import SCALE

def numbers(path):
    table = np.genfromtxt(path, delimiter=",", skip_header=1)
    return table[:, 0], {"u": SCALE * table[:, 1]}
"""


def test_a_reader_of_ones_own_that_has_changed_is_answered_by_no_cache(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "cache_reader.py").write_text(OWN_READER)
    codes, scales = [], ("1.0", "2.00")
    for scale in scales:
        (tmp_path / "cache_scale.py").write_text(f"SCALE = {scale}\n")
        for name in ("cache_reader", "cache_scale"):
            monkeypatch.delitem(sys.modules, name, raising=False)
        simulator = command(tmp_path, WRITE, read={**READ, "reader": "cache_reader:numbers"})
        codes.append(dict(simulator.code))
        record = ran(simulator)
        assert "simulations" not in record.attrs
        assert ran(simulator).attrs["simulations"] == 0
    assert np.abs(record.displacement).max() == pytest.approx(2.0, rel=0.01)
    assert {name for name in codes[0] if codes[0][name] != codes[1][name]} == {"cache_scale"}
    assert "cache_reader" in codes[0]


def test_a_torn_cache_is_no_answer(tmp_path):
    simulator = command(tmp_path, WRITE)
    first = ran(simulator)
    [file] = (tmp_path / "out" / "cache").iterdir()
    file.write_bytes(file.read_bytes()[:1000])
    again = ran(simulator)
    assert "simulations" not in again.attrs
    assert first.identical(again)
    assert ran(simulator).attrs["simulations"] == 0


def test_without_a_cache_every_run_is_made(tmp_path):
    simulator = command(tmp_path, WRITE, cache=False)
    assert ran(simulator).identical(ran(simulator))
    assert not (tmp_path / "out" / "cache").exists()


def test_a_file_that_changes_while_a_study_runs_is_refused(tmp_path):
    (tmp_path / "mesh.inc").write_text("one")
    simulator = command(tmp_path, WRITE, template=["mesh.inc"], cache=False)
    assert ran(simulator).attrs["status"] == "ok"
    (tmp_path / "mesh.inc").write_text("another")
    with pytest.raises(CalibError, match=r"mesh.inc has changed since the study was read"):
        ran(simulator)


def test_files_and_programs_are_known_by_their_content(tmp_path):
    (tmp_path / "mesh.inc").write_text("one")
    (tmp_path / "a.inp.j2").write_text("{{ gap }}")
    more = {"template": ["a.inp.j2", "mesh.inc"], "parameters": {"gap": 1.0}}
    before = command(tmp_path, WRITE, **more).code
    assert sorted(before) == ["file a.inp.j2", "file mesh.inc", "program solve.sh"]
    (tmp_path / "mesh.inc").write_text("another")
    after = command(tmp_path, WRITE, "", **more).code
    assert [name for name in before if before[name] != after[name]] == ["file mesh.inc", "program solve.sh"]
    stated = command(tmp_path, WRITE, version="echo solver 2.20", **more).code
    assert stated["program solve.sh"] == "solver 2.20"


def test_a_simulator_with_its_files_crosses_to_a_child_process(tmp_path):
    simulator = command(tmp_path, WRITE, cache=False)
    assert ran(pickle.loads(pickle.dumps(simulator))).identical(ran(simulator))


def test_a_run_without_a_study_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    line = script(tmp_path, WRITE)
    before = sorted(os.listdir(tmp_path))
    assert ran(Command(run=[line], read=READ)).attrs["status"] == "ok"
    assert sorted(os.listdir(tmp_path)) == before


def test_a_free_decay_and_a_recorded_input_run_on_their_own_instants(tmp_path):
    times = 0.0025 * np.arange(4, 21)
    decay = ran(command(tmp_path, WRITE), Request(times=times), Excitation("mass", "free decay"))
    np.testing.assert_array_equal(decay.time.values, times)
    recorded = Excitation("mass", "force", time=times, value=np.cos(times))
    np.testing.assert_array_equal(ran(command(tmp_path, WRITE), Request(), recorded).time.values, times)


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"run": []}, "run: expected one command line at least"),
        ({"run": ["solve 'a"]}, "close its quotation marks"),
        ({"run": ["nonesuch-solver -i deck"]}, "no program 'nonesuch-solver'"),
        ({"template": ["nothere.j2"]}, "template: nothere.j2: no such file"),
        ({"template": ["a.inp.j2", "sub/a.inp"], "parameters": {"gap": 1}}, "a second file 'a.inp'"),
        ({"parameters": {"gap": "1 mm"}}, "gap: no placeholder of"),
        ({"parameters": {"cores": 1}}, "the name of something else"),
        ({"read": {**READ, "reader": "delimitd"}}, r"unknown reader 'delimitd' \(did you mean 'delimited'"),
        ({"read": {**READ, "seperator": ","}}, "unknown option 'seperator'"),
        ({"read": {**READ, "reader": "calculix_dat", "time": "t"}}, "returns time itself, in seconds; .* { unit ="),
        ({"read": {**READ, "file": ["a", "b"]}}, "one for each of the 1 command line"),
        ({"read": {**READ, "file": []}}, "one for each command line; got none"),
        ({"read": {"reader": "delimited", "file": "a"}}, "read: bodies is missing"),
        ({"read": {**READ, "bodies": {"tip": {"displacement": {"column": "u", "unit": "N"}}}}}, "tip: displacement"),
        ({"read": {**READ, "bodies": {"tip": {"level": {"column": "u", "unit": "mV"}}}}}, "one of SI without a factor"),
        ({"read": {**READ, "bodies": {"a": "u", "b": {"velocity": "v"}}}}, "the same channels of all bodies"),
        ({"read": {**READ, "time": {"column": "t", "unit": "Hz"}}}, "read: time"),
        ({"read": {**READ, "file": "../../out.csv"}}, "a file of the run folder"),
        ({"keep": "some"}, "keep: expected one of none"),
        ({"fail_if": "/(/"}, "no regular expression"),
        ({"inactivity": "3 m"}, "given in s"),
        ({"cores": 0}, "cores: expected"),
        ({"cashe": True}, r"unknown option 'cashe' of 'command' \(did you mean 'cache'"),
        ({"prescribed": ["tip.velocity"]}, "is not read"),
        ({"version": "false-program -v"}, "gives no version"),
        ({"environment": {"A": 1}}, "environment: A"),
    ],
)
def test_a_mistake_in_the_options_is_refused(tmp_path, options, reason):
    (tmp_path / "a.inp.j2").write_text("{{ gap }}")
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "a.inp").write_text("")
    with pytest.raises(CalibError, match=reason):
        command(tmp_path, WRITE, **options)


def test_an_excitation_that_the_templates_do_not_take_is_refused(tmp_path):
    (tmp_path / "a.inp.j2").write_text("{{ excitation.frequency }}")
    simulator = command(tmp_path, WRITE, template=["a.inp.j2"], drives={"force": ["tip", "root"]})
    assert simulator.excitations == {("force", "tip"), ("force", "root")}
    with pytest.raises(CalibError, match="not driven by force at 'tap'.*did you mean 'tip'"):
        simulator.check(Excitation("tap", "force", frequency=1.0, amplitude=1.0), REQUEST)
    recorded = Excitation("tip", "force", time=np.arange(3.0), value=np.arange(3.0))
    with pytest.raises(CalibError, match="a.inp.j2:1: undefined: .*frequency"):
        simulator.check(recorded, Request())
