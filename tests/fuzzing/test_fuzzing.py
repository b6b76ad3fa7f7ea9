"""A small sample of the fuzz of `benchmarks/fuzz.py`, what it found once, and its own alarms."""

import json
import os
import random
import socket
from pathlib import Path

import h5py
import numpy as np
import pytest
from fuzzing.case import OwnError, in_child, lay_trap, run_case
from fuzzing.kinds import KINDS

from calib.errors import CalibError

SEEDS = (7, 8)
FOUND = sorted((Path(__file__).parent / "found").glob("*/*"))  # kind/what: files that once did harm


@pytest.mark.parametrize("kind", KINDS)
def test_a_sample_of_damaged_files_is_read_or_refused(tmp_path, kind):
    trap = lay_trap(tmp_path)
    for seed in SEEDS:
        outcome = run_case(KINDS[kind], seed, tmp_path, trap)
        assert outcome.good, (seed, outcome.status, outcome.detail)


@pytest.mark.parametrize("kind", KINDS)
def test_a_case_is_the_same_for_the_same_seed(tmp_path, kind):
    made = []
    for name in ("one", "other"):
        folder = tmp_path / name / "case"
        folder.mkdir(parents=True)
        done = KINDS[kind].make(KINDS[kind].samples()[0], random.Random(f"{kind} 5"), folder)
        made.append((done, sorted(path.name for path in folder.rglob("*"))))
    assert made[0] == made[1]


@pytest.mark.slow  # one of them takes all the time that reading may take
@pytest.mark.parametrize("folder", FOUND, ids=lambda folder: f"{folder.parent.name}-{folder.name}")
def test_what_was_found_is_mended(tmp_path, folder):
    case = tmp_path / "case"
    for path in folder.rglob("*"):
        if path.is_file():
            target = case / path.relative_to(folder)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(path.read_bytes())
    outcome = in_child(KINDS[folder.parent.name], case)
    assert outcome.good, (outcome.status, outcome.detail)


class _Doing:
    """A kind whose reading does something that it must not."""

    name = "doing"

    def __init__(self, deed):
        self._deed = deed

    def samples(self):
        return ["one"]

    def make(self, sample, rng, folder):
        return []

    def readable(self, folder):
        return frozenset()

    def read(self, folder):
        self._deed(folder)


def _many_bytes(folder):
    np.ones(150_000_000).sum()


def _asked(folder):
    try:
        np.empty(2**40)
    except MemoryError as error:
        raise CalibError("too large") from error


def _strange(folder):
    raise OwnError("a\x1b[2Jb")


def _forked(folder):
    if os.fork() == 0:
        try:
            (folder.parent / "elsewhere").write_text("x")
        finally:
            os._exit(0)
    os.wait()


@pytest.mark.parametrize(
    ("deed", "status"),
    [
        (lambda folder: (folder / "own").write_text("x"), "read"),
        (lambda folder: [][1], "traceback"),
        (lambda folder: (folder.parent / "elsewhere").write_text("x"), "outside"),
        (_forked, "outside"),
        (lambda folder: Path("/etc/passwd").read_text(), "outside"),
        (lambda folder: Path("/etc").iterdir().__next__(), "outside"),
        (lambda folder: socket.socket(), "outside"),
        (lambda folder: h5py.File(folder.parent / "outside" / "secret.h5", "r").close(), "outside/secret.h5 was read"),
        (lambda folder: os.abort(), "crash SIGABRT"),
        (_many_bytes, "took 1."),
        (_asked, "asked for too much memory"),
        (_strange, "a message with"),
    ],
)
def test_the_fuzz_gives_alarm(tmp_path, deed, status):
    outcome = run_case(_Doing(deed), 1, tmp_path, lay_trap(tmp_path))
    assert outcome.status.startswith(status), (outcome.status, outcome.detail)
    assert outcome.good == (status == "read")
    json.dumps(outcome.detail)
