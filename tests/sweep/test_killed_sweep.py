"""`calib sweep`, killed at random moments, ends with what it would have found uninterrupted."""

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from functools import cache
from pathlib import Path

import pytest
import xarray as xr
from child_environment import environment
from click.testing import CliRunner
from kills import KILLS
from map_study import waiting, write_map_study
from marked_processes import MARK, marked, new_mark, survivors

from calib.cli import main
from calib.store.chunks import read_joined

ROOT = Path(__file__).parents[2]


def minimal(folder):
    """studies/minimal beside its records."""
    home = folder / "studies" / "minimal"
    home.mkdir(parents=True)
    shutil.copy(ROOT / "studies" / "minimal" / "study.toml", home)
    shutil.copytree(ROOT / "experiments_ref", folder / "experiments_ref")
    return home


def sweep(study, path, *options):
    return [sys.executable, "-m", "calib", "sweep", str(study), "-o", str(path), "--quiet", *map(str, options)]


def pieces(path):
    return len(list(path.parent.glob(f".{path.name}-pieces/*/*.npz")))


def until(what, process=None):
    limit = time.monotonic() + 120.0
    while not what():
        assert process is None or process.poll() is None, "the sweep ended before it was killed"
        assert time.monotonic() < limit, "not within two minutes"
        time.sleep(0.01)


def kill(command, when, whole_group, patience=0.0):
    """Start a sweep, kill it when it is time, and wait until none of its processes is left."""
    mark = new_mark()
    process = subprocess.Popen(command, env={**environment(), MARK: mark}, start_new_session=True)
    try:
        until(when, process)
        time.sleep(patience)
        assert process.poll() is None, "the sweep ended before it was killed"
        assert marked(mark)
        (os.killpg if whole_group else os.kill)(process.pid, signal.SIGKILL)
        process.wait()
        assert not survivors(mark, patience=120.0)
    finally:
        process.kill()
        process.wait()
        survivors(mark)


def same(killed, whole):
    """Whether the files hold the same, and nothing is left beside them."""
    xr.testing.assert_identical(read_joined(killed), read_joined(whole))
    assert not [name for name in os.listdir(killed.parent) if name.startswith(".")]


@pytest.mark.slow
def test_a_killed_sweep_goes_on_and_none_of_its_processes_is_left(tmp_path):
    gate, killed, whole = tmp_path / "gate", tmp_path / "killed" / "s.nc", tmp_path / "whole" / "s.nc"
    study, options = write_map_study(tmp_path, waiting(gate)), ("--over", "a=0.2:0.3:100", "--carry", "forward")
    kill(sweep(study, killed, *options, "--jobs", 2), lambda: pieces(killed) > 3, whole_group=False)
    assert pieces(killed) > 3
    gate.unlink()
    for path in (killed, whole):
        assert CliRunner().invoke(main, sweep(study, path, *options)[3:]).exit_code == 0
    same(killed, whole)


def options_of(carry):
    return "--over", "restitution=0:0.6:121", "--carry", carry


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return the file of the sweep that nothing has killed: carry -> path."""

    @cache
    def made(carry):
        folder = tmp_path_factory.mktemp("whole")
        line = sweep(minimal(folder), folder / "s.nc", *options_of(carry), "--jobs", 2)
        assert CliRunner().invoke(main, line[3:]).exit_code == 0
        return folder / "s.nc"

    return made


@pytest.mark.slow
@pytest.mark.parametrize("carry", ["none", "both"])
def test_many_kills_change_nothing(carry, whole, tmp_path):
    """Killed while it starts, and after a few pieces more each time."""
    study, killed, options = minimal(tmp_path), tmp_path / "killed" / "s.nc", options_of(carry)
    rng, count = random.Random(carry), 16 * (2 if carry == "both" else 1)
    for number in range(KILLS):
        aim = count * number // (2 * KILLS)  # so that half of it is left when it is killed last
        command = sweep(study, killed, *options, "--jobs", 2)
        kill(command, lambda aim=aim: pieces(killed) >= aim, bool(number % 2), rng.uniform(0.0, 0.2))
    subprocess.run(sweep(study, killed, *options, "--jobs", 1), env=environment(), check=True)
    same(killed, whole(carry))
