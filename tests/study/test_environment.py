"""What decides whether the same numbers come out again, and a study that is resumed where it has changed."""

import json
import warnings
from dataclasses import replace

import pytest
from study_fakes import run, study

from calib.store import environment as module
from calib.store.environment import environment
from calib.store.ledger import TRIALS, read


def test_the_kernel_and_the_threads_of_each_blas_are_named():
    blas = environment().blas
    assert blas
    assert list(blas) == sorted(blas)  # whatever is loaded first
    assert all("kernel" in text and "thread(s)" in text for text in blas.values())


def test_another_kernel_begins_a_new_segment_and_says_so(tmp_path, monkeypatch):
    run(study(10), tmp_path)
    other = replace(environment(), blas={"numpy.libs": "openblas 0.3, kernel Other, 1 thread(s)"})
    monkeypatch.setattr("calib.store.ledger.environment", lambda: other)
    with pytest.warns(UserWarning, match=r"another processor or BLAS kernel(.|\n)*kernel Other"):
        run(study(12), tmp_path)
    header, trials = read(tmp_path)
    assert (header.segment, header.blas) == (1, other.blas)
    assert len(trials) == 12


def test_a_ledger_from_before_it_was_kept_goes_on_as_a_new_segment(tmp_path):
    run(study(10), tmp_path)
    path = tmp_path / TRIALS
    lines = path.read_text().splitlines(keepends=True)
    header = json.loads(lines[0])
    del header["blas"], header["crc32"]  # of headers with it
    path.write_text("".join([json.dumps(header) + "\n", *lines[1:]]))
    with pytest.warns(UserWarning, match="blas"):
        run(study(12), tmp_path)
    assert read(tmp_path)[0].segment == 1


def test_the_same_environment_goes_on_without_a_word(tmp_path):
    run(study(10), tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run(study(12), tmp_path)
    assert read(tmp_path)[0].segment == 0
    assert module.environment() is environment()
