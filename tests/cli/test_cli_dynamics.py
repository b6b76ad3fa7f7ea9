"""The commands of dynamics, as a user types them: calib sweep, branch and basins."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from child_environment import environment
from click.testing import CliRunner
from echo_study import write_study
from map_study import BISTABLE, waiting, write_map_study

from calib.cli import main
from calib.cli.given import bodies_drawn
from calib.store import Store
from calib.store.chunks import read_joined
from calib.study_file import load

ROOT = Path(__file__).parents[2]
# a process in the background of a script begins deaf to Ctrl-C, and so do its children
HEEDING = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
PLANE = ("--x", "body.displacement=-1.5:1.5:4", "--y", "body.velocity=-0.2:0.1:3")
MANY = ("--over", "a=0.2:0.3:100")


def calib(*arguments, code=0):
    ended = CliRunner().invoke(main, [str(a) for a in arguments])
    assert ended.exit_code == code, ended.output
    assert "Traceback" not in ended.output
    return ended


def process(*arguments, before=""):
    code = f"{HEEDING}{before}from calib.cli import main; main()"
    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, arguments)],
        env=environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def pictures(folder):
    found = sorted(path for path in folder.iterdir() if path.suffix == ".png")
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in found)
    return [path.name for path in found]


@pytest.fixture
def study(tmp_path):
    return write_map_study(tmp_path)


# --- sweep


def test_a_sweep_says_which_motion_is_where_and_leaves_file_and_picture(study, tmp_path):
    ended = calib("sweep", study, "--over", "a=0.2:1.4:7", "--cycles", 96)
    out = tmp_path / "out"
    assert ended.stdout.splitlines() == [
        "found:",
        "  a 0.2: period-1",
        "  a 0.4 .. 0.8: period-2",
        "  a 1: period-4",
        "  a 1.2 .. 1.4: chaotic",
        f"sweep: {out / 'sweep.nc'}",
        f"picture: {out / 'sweep.png'}",
    ]
    found = read_joined(out / "sweep.nc")
    assert found.displacement.sizes["cycle"] == 96
    assert sorted(os.listdir(out)) == ["sweep.nc", "sweep.png"]
    assert pictures(out) == ["sweep.png"]


def test_branches_are_told_apart(study, tmp_path):
    write_map_study(tmp_path, BISTABLE)
    ended = calib("sweep", study, "--over", "push=-0.6,0,0.6", "--carry", "both", "--start", "body.displacement=-1")
    assert ended.stdout.splitlines()[:4] == ["forward:", "  push -0.6 N .. 0.6 N: period-1", "backward:",
                                             "  push -0.6 N .. 0.6 N: period-1"]  # fmt: skip
    found = read_joined(tmp_path / "out" / "sweep.nc")
    assert (np.sign(found.displacement[:, 0, -1]).values == [[-1, -1, 1], [-1, 1, 1]]).all()


def test_failed_points_are_counted_with_their_status(study):
    said = calib("sweep", study, "--over", "a=0.2,3,4").stdout
    assert said.splitlines()[:4] == [
        "found:", "  a 0.2: period-1", "  a 3 .. 4: failed", "failed: 2 of 3 (diverged)",
    ]  # fmt: skip


def test_a_sweep_without_any_motion_is_exit_code_4(study, tmp_path):
    assert "failed: 2 of 2 (diverged)" in calib("sweep", study, "--over", "a=3,4", code=4).stdout
    assert pictures(tmp_path / "out") == ["sweep.png"]


def test_a_plane_of_parameters_says_how_often(study, tmp_path):
    out = tmp_path / "new" / "folder" / "plane.nc"
    said = calib("sweep", study, "--over", "a=0.2:0.3:3", "--over", "b=0.25,0.3", "-o", out).stdout
    assert "  period-1: 6 of 6" in said
    assert pictures(out.parent) == ["plane.png"]


@pytest.mark.slow
def test_a_latin_hypercube_is_drawn_from_its_seed(study, tmp_path):
    for name, seed in (("one", 1), ("again", 1), ("two", 2)):
        calib("sweep", study, "--over", "a=0.2:0.3", "--over", "b=0.01:0.1:log", "--latin", 5, "--seed", seed,
              "-o", tmp_path / f"{name}.nc")  # fmt: skip
    one, again, two = (read_joined(tmp_path / f"{name}.nc") for name in ("one", "again", "two"))
    assert one.kind.dims == ("point",)
    assert sorted(np.floor((one.a.values - 0.2) / 0.02)) == [0, 1, 2, 3, 4]
    xr.testing.assert_identical(one, again)
    assert not np.isin(two.a, one.a).any()


def test_a_latin_hypercube_of_one_parameter_is_described_too(study, tmp_path):
    said = calib("sweep", study, "--over", "a=0.2:0.3", "--latin", 3).stdout.splitlines()
    drawn = read_joined(tmp_path / "out" / "sweep.nc").a.values
    assert len(drawn) == 3
    assert said[:2] == ["found:", f"  a {min(drawn):.4g} .. {max(drawn):.4g}: period-1"]


def test_a_branch_is_not_followed_in_equal_ratios_nor_written_over_another_file(study, tmp_path):
    ratios = calib("branch", study, "--over", "a=0.2:0.3:log", "--at", "0.25", code=1)
    assert "linear" in ratios.stderr
    mine = tmp_path / "bench.nc"
    before = mine.read_bytes()
    over = calib("branch", study, "--over", "a=0.2:0.3", "--at", "0.25", "-o", mine, code=1)
    assert "not a file of `calib branch`" in over.stderr
    assert mine.read_bytes() == before


def test_values_may_have_units_and_equal_ratios(study, tmp_path):
    calib("sweep", study, "--over", "excitation.amplitude=0.5 mm:2mm:3:log", "--set", "b=0.1")
    found = read_joined(tmp_path / "out" / "sweep.nc")
    np.testing.assert_allclose(found.excitation_amplitude, [5e-4, 1e-3, 2e-3])
    assert json.loads(found.attrs["definition"])["values"]["b"] == 0.1
    assert "excitation.amplitude 0.5 mm" in calib("sweep", study, "--over", "excitation.amplitude=0.5 mm:2mm:3:log",
                                                   "--set", "b=0.1").stdout  # fmt: skip


@pytest.mark.parametrize("command", [("sweep", "--over", "a=0.2,0.3"), ("basins", *PLANE)])
def test_quiet_says_nothing_and_leaves_its_file(study, tmp_path, command):
    ended = calib(command[0], study, *command[1:], "--quiet")
    assert (ended.stdout, ended.stderr) == ("", "")
    assert (tmp_path / "out" / f"{command[0]}.nc").is_file()


def test_more_stretches_than_anybody_reads_are_left_out(tmp_path):
    every_other = [round(0.2 + 0.002 * k, 3) for k in range(15)]
    path = write_map_study(tmp_path, ("[windows]", f"options.faults.impossible = {every_other}\n[windows]"))
    said = calib("sweep", path, "--over", "a=0.2:0.229:30").stdout.splitlines()
    assert said[:3] == ["found:", "  a 0.2: failed", "  a 0.201: period-1"]
    assert said[25] == "  ... and 6 more"


def test_the_values_of_the_study_s_result_are_taken_and_set_ones_come_first(study, tmp_path):
    with Store(tmp_path / "out", view=None) as store:
        store.open(load(study).study.header)
    (tmp_path / "out" / "result.json").write_text(json.dumps({"values": {"a": 0.25, "b": 0.1, "b@bench": 0.2}}))
    calib("sweep", study, "--over", "push=0,1", "--best", "-o", tmp_path / "best.nc")
    calib("sweep", study, "--over", "push=0,1", "--best", "--set", "b=0.15", "-o", tmp_path / "set.nc")
    best, given = (json.loads(read_joined(tmp_path / name).attrs["definition"]) for name in ("best.nc", "set.nc"))
    assert (best["values"]["a"], best["values"]["b"]) == (0.25, 0.2)
    assert (given["values"]["a"], given["values"]["b"]) == (0.25, 0.15)
    other = tmp_path / "other.toml"  # its results are in the same folder
    other.write_text(study.read_text().replace("seed = ", "seed = 1"))
    refused = calib("sweep", other, "--over", "push=0,1", "--best", code=1)
    assert "was made by another study" in refused.stderr
    assert "seed: " in refused.stderr


def test_only_the_bodies_asked_for_are_drawn(tmp_path):
    beam = Path(__file__).parents[2] / "studies" / "minimal"
    followed = ("branch", beam, "--over", "restitution=0.04:0.06", "--at", "0.05", "--most", 2, "-o", tmp_path / "b.nc")
    calib(*followed, "--bodies", "q3")
    assert pictures(tmp_path) == ["b_q3.png"]
    calib(*followed)
    assert pictures(tmp_path) == ["b_q2.png", "b_q3.png"]


def test_a_body_that_only_follows_the_excitation_is_drawn_where_it_is_asked_for():
    file = load(Path(__file__).parents[2] / "studies" / "fe_calibration")
    assert bodies_drawn(None, file, None) == ["layer"]
    assert bodies_drawn("beam,layer", file, None) == ["beam", "layer"]


# --- branch


def test_a_branch_says_its_special_points_and_ends(study, tmp_path):
    ended = calib("branch", study, "--over", "a=-0.3:0.6", "--at", "0.2")
    said = ended.stdout.splitlines()
    assert said[0].startswith("at a = 0.2: period-1, returns after 1 period(s)")
    assert re.match(r"period-1 over a -0\.1225 \.\. 0\.6, \d+ points", said[1])
    assert [line.split(":")[0] for line in said[2:4]] == ["  fold at a = -0.1225", "  flip at a = 0.3675"]
    assert said[5].startswith("  other end: edge of the window, 0.6")
    assert said[6:] == [f"branch: {tmp_path / 'out' / 'branch.nc'}", f"picture: {tmp_path / 'out' / 'branch_body.png'}"]
    assert pictures(tmp_path / "out") == ["branch_body.png"]
    with xr.open_dataset(tmp_path / "out" / "branch.nc") as branch:
        assert branch.attrs["model"] == "mapped"
        assert branch.special_kind.values.tolist() == ["fold", "flip"]


@pytest.mark.slow
def test_the_curves_of_a_branch_are_told_drawn_and_kept(study, tmp_path):
    said = calib(
        "branch", study, "--over", "a=-0.3:0.6", "--at", "0.2", "--curve", "b=0.1:0.4", "--set", "b=0.3"
    ).stdout
    rows = [[cell.strip() for cell in line.split("│")[1:-1]] for line in said.splitlines() if line.startswith("│")]
    assert [row[:4] for row in rows] == [["1", "fold", "1", "0"], ["2", "flip", "1", "0"]]
    assert rows[0][5] == "0.1 .. 0.4"
    assert said.count("ends: edge of the window, (a, b) = (") == said.count(") in SI") == 4
    assert pictures(tmp_path / "out") == ["branch_body.png", "branch_curves.png"]
    with xr.open_dataset(tmp_path / "out" / "branch_curves.nc") as curves:
        assert (curves.a.attrs["name"], curves.b.attrs["name"]) == ("a", "b")
        assert curves.curve_kind.values.tolist() == ["fold", "flip"]
        share = np.where(curves.curve_kind == "fold", -0.25, 0.75)[curves.curve_of_step.values]
        assert np.abs(curves.a - share * (1.0 - curves.b) ** 2).max() < 1e-9
        assert np.isnan(curves.test_value.sel(test="cusp").values[curves.curve_of_step == 1]).all()
        assert curves.b_window.values.tolist() == [0.1, 0.4]
    later = calib("branch", study, "--over", "a=-0.3:0.6", "--at", "0.2").stdout.splitlines()
    assert later[-1].startswith(f"{tmp_path / 'out' / 'branch_curves.nc'} is of an earlier branch; delete it, or")


@pytest.mark.parametrize(
    ("curve", "reason"),
    [
        ("a=0.1:0.4", "is that of --over"),
        ("b=0.1:0.4:log", "linear"),
        ("b=0.35:0.4", "outside 0.35 .. 0.4"),
        ("c=0.1:0.4", "cannot vary"),
        ("b=0.1", "expected NAME=LOW:HIGH"),
    ],
)
def test_a_curve_that_cannot_be_is_refused_before_the_branch_is_followed(study, curve, reason):
    ended = calib("branch", study, "--over", "a=-0.3:0.6", "--at", "0.2", "--curve", curve, code=1)
    assert ended.stderr.startswith("calib: --curve")
    assert reason in ended.stderr
    assert ended.stdout == ""


def test_curves_that_were_made_before_an_interrupt_are_kept(study, tmp_path, monkeypatch):
    def interrupted(self, done, total):
        raise KeyboardInterrupt

    monkeypatch.setattr("calib.cli.curves.Count.__call__", interrupted)
    calib("branch", study, "--over", "a=-0.3:0.6", "--at", "0.2", "--curve", "b=0.1:0.4", "--set", "b=0.3", code=3)
    with xr.open_dataset(tmp_path / "out" / "branch_curves.nc") as curves:
        assert curves.curve_kind.values.tolist() == ["fold"]


def test_a_branch_without_special_points_has_no_curves(study, tmp_path):
    ended = calib("branch", study, "--over", "a=0.1:0.3", "--at", "0.2", "--curve", "b=0.1:0.4")
    assert "curves: none" in ended.stdout
    assert not (tmp_path / "out" / "branch_curves.nc").exists()


@pytest.mark.parametrize("x", [1.0, -1.0])
def test_the_branch_from_a_start_is_the_one_of_its_motion(tmp_path, x):
    path = write_map_study(tmp_path, BISTABLE)
    calib("branch", path, "--over", "push=-0.3:0.3", "--at", "0", "--start", f"body.displacement={x}")
    with xr.open_dataset(tmp_path / "out" / "branch.nc") as branch:
        assert branch.displacement.size > 0
        assert (np.sign(branch.displacement) == x).all()
        assert branch.stable.all()


def test_a_chaotic_motion_is_not_followed(study, tmp_path):
    said = calib("branch", study, "--over", "a=0.2:1.4", "--at", "1.4", code=1).stderr
    assert "the motion at a = 1.4 is chaotic" in said
    assert "choose another --at or --start" in said
    assert not (tmp_path / "out").exists()


# --- basins


def test_basins_say_what_share_leads_where(tmp_path):
    path = write_map_study(tmp_path, BISTABLE)
    said = calib("basins", path, *PLANE).stdout.splitlines()
    assert said == [
        "  0: period-1: 50.0 % of the states",
        "  1: period-1: 50.0 % of the states",
        f"basins: {tmp_path / 'out' / 'basins.nc'}",
        f"picture: {tmp_path / 'out' / 'basins.png'}",
    ]
    assert pictures(tmp_path / "out") == ["basins.png"]


def test_states_that_lead_nowhere_are_counted_with_their_status(tmp_path):
    path = write_map_study(tmp_path, BISTABLE)
    said = calib("basins", path, "--x", "body.displacement=1,5", "--y", "body.velocity=0,0.1").stdout
    assert "  without a motion: 50.0 % of the states (diverged)" in said
    said = calib("basins", path, "--x", "body.displacement=5,6", "--y", "body.velocity=0,1", "--fresh", code=4).stdout
    assert "  without a motion: 100.0 % of the states (diverged)" in said
    assert pictures(tmp_path / "out") == ["basins.png"]


# --- what is refused


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--over", "aa=0:1:3"], "--over: 'aa' cannot vary (did you mean 'a'?)"),
        (["--over", "excitation.amplitude=1s:2s:3"], "--over excitation.amplitude: expected a quantity"),
        (["--over", "a=1:0:3"], "--over a: the window is the wrong way round"),
        (["--over", "a=0:1:1"], "--over a: expected LOW:HIGH:COUNT"),
        (["--over", "a=0:1:3:lin"], "--over a: expected LOW:HIGH:COUNT"),
        (["--over", "a=-1:1:3:log"], "--over a: a log window needs low > 0"),
        (["--over", "a"], "--over: expected NAME=LOW:HIGH:COUNT"),
        (["--over", "a=0.2,,0.3"], "--over a: cannot read ''"),
        (["--over", "a=0.2,0.2"], "'a' on a grid must differ"),
        (["--over", "b=0:2:3"], "--over: expected finite values of 'b' in [-1, 1] 1, got 2"),
        (["--over", "excitation.frequency=0:2:3"], "--over: expected finite values of 'excitation.frequency' above 0"),
        (["--over", "a=0:1:3", "--over", "a=0:1:3"], "--over a is given twice"),
        (["--over", "a=0:1:3", "--over", "b=0:1:3", "--over", "push=0:1:3"], "--over: a sweep is over one or two"),
        (["--over", "a=0:1:3", "--latin", 5], "--over: expected NAME=LOW:HIGH or NAME=LOW:HIGH:log, without a COUNT"),
        (["--over", "a=0:1", "--latin", 5, "--carry", "both"], "--carry both: a state is carried along a grid"),
        (["--over", "b=0:2", "--latin", 5], "--over: expected finite values of 'b'"),
        (["--over", "a=0:1:3", "--start", "body.velocty=0"], "--start: no component 'body.velocty' (did you mean"),
        (["--over", "a=0:1:3", "--start", "body.velocity=1 mm"], "--start body.velocity: expected a quantity"),
        (["--over", "a=0:1:3", "--best"], "--best: there is no result.json in"),
        (["--over", "a=0:1:3", "--bodies", "bdy"], "--bodies: there is no body 'bdy' (did you mean 'body'?)"),
        (["--over", "a=0:1:3", "--set", "c=1"], "--set: unknown parameter 'c'"),
        (["--over", "a=0:1:3", "--set", "b=2"], "--set b: expected a value in [-1, 1] 1, got 2"),
        (["--over", "a=0:1:3", "--record", "bensch"], "no record 'bensch' (did you mean 'bench'?)"),
    ],
)
def test_a_sweep_that_makes_no_sense_is_refused_by_the_option_s_name(study, tmp_path, arguments, said):
    assert said in calib("sweep", study, *arguments, code=1).stderr
    assert sorted(os.listdir(tmp_path)) == ["bench.nc", "study.toml"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--over", "a=0:1:3", "--at", "0.2"], "--over: expected NAME=LOW:HIGH or NAME=LOW:HIGH:log, without a COUNT"),
        (["--over", "b=0:2", "--at", "0.2"], "--over: expected finite values of 'b'"),
        (["--over", "a=0.1:1", "--at", "1.1"], "--at: expected a in the window of --over, 0.1 .. 1, got 1.1"),
        (["--over", "a=0.1:1", "--at", "x"], "--at: cannot read 'x'"),
        (["--over", "a=0.1:1", "--at", "0.2", "--start", "body.x=1"], "--start: no component 'body.x'"),
    ],
)
def test_a_branch_that_makes_no_sense_is_refused_by_the_option_s_name(study, tmp_path, arguments, said):
    assert said in calib("branch", study, *arguments, code=1).stderr
    assert sorted(os.listdir(tmp_path)) == ["bench.nc", "study.toml"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--x", "body.x=0:1:3", *PLANE[2:]], "--x: no component 'body.x'"),
        ([*PLANE[:2], "--y", "body.velocity=0:1s:3"], "--y body.velocity: expected a quantity"),
        ([*PLANE[:2], "--y", "body.velocity=0:1"], "--y body.velocity: expected LOW:HIGH:COUNT"),
        ([*PLANE[:2], "--y", PLANE[1]], "two components, got 'body.displacement' twice"),
        ([*PLANE, "--start", "body.x=1"], "--start: no component 'body.x'"),
    ],
)
def test_a_plane_that_makes_no_sense_is_refused_by_the_option_s_name(study, tmp_path, arguments, said):
    assert said in calib("basins", study, *arguments, code=1).stderr
    assert sorted(os.listdir(tmp_path)) == ["bench.nc", "study.toml"]


IMPOSSIBLE = ("[windows]", "options = { faults = { impossible = [0.2] } }\n[windows]")


def test_a_sweep_over_values_that_let_nothing_move_fails_with_that_status(tmp_path):
    path = write_map_study(tmp_path, IMPOSSIBLE)
    said = calib("sweep", path, "--over", "push=0,1", code=4).stdout.splitlines()
    assert said[:3] == ["found:", "  push 0 N .. 1 N: failed", "failed: 2 of 2 (impossible value)"]
    swept = read_joined(tmp_path / "out" / "sweep.nc")
    assert swept.status.values.tolist() == ["impossible value"] * 2
    assert set(swept.kind.values) == {"failed"}
    assert np.isnan(swept.displacement).all()


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (["branch", "--over", "push=0:1", "--at", "0.5"], "--over: push = 0 N: "),
        (["basins", *PLANE], "{study}: "),
        (["basins", *PLANE, "--set", "a=0.2"], "--set: "),
    ],
)
def test_values_that_let_nothing_move_are_no_traceback(tmp_path, command, said):
    path = write_map_study(tmp_path, IMPOSSIBLE)
    ended = calib(command[0], path, *command[1:], code=1)
    assert (ended.stdout, ended.stderr) == ("", f"calib: {said.format(study=path)}a mass of 0 kg\n")
    assert sorted(os.listdir(tmp_path)) == ["bench.nc", "study.toml"]


COMMANDS = [["sweep", "--over", "{0}=0.2,0.3"], ["branch", "--over", "{0}=0.2:0.3", "--at", "0.2"], ["basins", *PLANE]]


@pytest.mark.parametrize("command", COMMANDS)
def test_a_simulator_without_a_period_map_is_refused(tmp_path, command):
    path = write_study(tmp_path)
    said = calib(command[0], path, *(text.format("gain") for text in command[1:]), code=1).stderr
    assert "simulator 'echo' offers no period map" in said
    assert sorted(os.listdir(tmp_path)) == ["bench.nc", "study.toml"]


@pytest.mark.parametrize("command", ["sweep --over gap=1mm,2mm", "branch --over gap=1mm:2mm --at 1mm",
                                     "basins --x q3.displacement=0:1:3 --y q3.velocity=0:1:3"])  # fmt: skip
def test_a_fixed_step_is_refused(tmp_path, command):
    shutil.copytree(ROOT / "experiments_ref" / "clapping_minimal", tmp_path / "experiments_ref" / "clapping_minimal")
    path = tmp_path / "studies" / "minimal" / "study.toml"
    path.parent.mkdir(parents=True)
    text = (ROOT / "studies" / "minimal" / "study.toml").read_text()
    path.write_text(text.replace('drive = "spring"', 'drive = "spring", mode = "fixed_step"'))
    name, *options = command.split()
    assert "take mode 'exact'" in calib(name, path, *options, code=1).stderr
    assert os.listdir(path.parent) == ["study.toml"]


@pytest.mark.parametrize("command", COMMANDS)
def test_a_recorded_excitation_is_refused(tmp_path, command):
    path = write_map_study(tmp_path)
    with xr.open_dataset(tmp_path / "bench.nc") as stored:
        record = stored.load()
    record["excitation"] = ("time", np.cos(record.time.values), {"units": "m"})
    del record.attrs["amplitude"]
    record.to_netcdf(tmp_path / "bench.nc")
    ended = calib(command[0], path, *(text.format("a") for text in command[1:]), code=1)
    assert (ended.stdout, ended.stderr) == ("", "calib: the map is of a harmonic excitation\n")
    assert sorted(os.listdir(tmp_path)) == ["bench.nc", "study.toml"]


@pytest.mark.parametrize("command", ["sweep", "branch", "basins"])
def test_the_name_of_a_picture_is_wrong_usage(study, tmp_path, command):
    """The picture would take the place of the data."""
    options = {"sweep": ["--over", "a=0.2,0.3"], "branch": ["--over", "a=0:1", "--at", 0.2], "basins": PLANE}[command]
    assert "name of a picture" in calib(command, study, *options, "-o", tmp_path / "x.png", code=2).stderr
    assert not (tmp_path / "x.png").exists()


def test_wrong_usage_is_exit_code_2(study):
    calib("sweep", study, code=2)
    calib("sweep", study, "--over", "a=0:1:3", "--carry", "up", code=2)
    calib("sweep", study, "--over", "a=0:1:3", "--cycles", 50, code=2)
    calib("sweep", study, "--over", "a=0:1:3", "--phase", 1.0, code=2)
    calib("branch", study, "--over", "a=0:1", code=2)
    calib("basins", study, "--x", "body.displacement=0:1:3", code=2)


def test_another_sweep_s_file_is_kept_unless_fresh(study, tmp_path):
    calib("sweep", study, "--over", "a=0.2,0.3")
    assert "--fresh to replace it" in calib("sweep", study, "--over", "a=0.2,0.35", code=1).stderr
    calib("sweep", study, "--over", "a=0.2,0.35", "--fresh")
    assert read_joined(tmp_path / "out" / "sweep.nc").a.values.tolist() == [0.2, 0.35]
    assert "not a file of `calib sweep`" in calib(
        "sweep", study, "--over", "a=0.2,0.3", "--fresh", "-o", tmp_path / "bench.nc", code=1).stderr  # fmt: skip


# --- stopped, crowded out, no room


def pieces(path):
    return list(path.parent.glob(f".{path.name}-pieces/*/*.npz"))


def until(what, seconds=60.0):
    limit = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < limit, "not within a minute"
        time.sleep(0.02)


@pytest.mark.slow
def test_ctrl_c_is_exit_code_3_and_the_sweep_goes_on(tmp_path):
    path, gate = tmp_path / "sweep.nc", tmp_path / "gate"
    study = write_map_study(tmp_path, waiting(gate))
    run = process("sweep", study, *MANY, "-o", path, "--jobs", 2)
    try:
        until(lambda: len(pieces(path)) > 2)
        second = calib("sweep", study, "--over", "a=0.2,0.3", "-o", path, code=1)
        run.send_signal(signal.SIGINT)
        _, said = run.communicate(timeout=60)
    finally:
        run.kill()
    assert f"{path} is being written by process {run.pid}" in second.stderr
    assert run.returncode == 3, said
    assert "stopped" in said
    assert "Traceback" not in said
    assert not path.exists()
    assert len(pieces(path)) > 2
    gate.unlink()
    calib("sweep", study, *MANY, "-o", path, "--jobs", 2)
    assert sorted(os.listdir(tmp_path)) == ["bench.nc", "study.toml", "sweep.nc", "sweep.png"]


@pytest.mark.slow
def test_a_disk_without_room_for_the_file_ends_with_a_message_and_the_pieces_are_kept(study, tmp_path):
    over, path = ["--over", "a=0.2:0.3:150"], tmp_path / "sweep.nc"
    limit = "import resource, signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN); "
    limit += "resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000)); "
    run = process("sweep", study, *over, "-o", path, before=limit)
    _, said = run.communicate(timeout=60)
    assert run.returncode == 1, said
    assert "Traceback" not in said
    assert "is the disk full?" in said
    assert str(path) in said
    assert not path.exists()
    chained = [piece for piece in pieces(path) if piece.name.startswith("chain-")]
    assert len(chained) == 2 * 19  # 150 values eight at a time, motions taken on to each from both sides
    assert len(pieces(path)) - len(chained) == 19
    calib("sweep", study, *over, "-o", path)
    assert not [name for name in os.listdir(tmp_path) if name.startswith(".")]


@pytest.mark.parametrize("command", [[text.format("a") for text in command] for command in COMMANDS])
def test_a_folder_that_cannot_be_written_is_named(study, tmp_path, command):
    (tmp_path / "file").write_text("kept")
    said = calib(command[0], study, *command[1:], "-o", tmp_path / "file" / "x.nc", code=1).stderr
    assert str(tmp_path / "file") in said
    assert (tmp_path / "file").read_text() == "kept"
    assert sorted(os.listdir(tmp_path)) == ["bench.nc", "file", "study.toml"]
