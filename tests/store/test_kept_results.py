"""Results that outlive the process that calculated them."""

import errno
import hashlib
import os

import pytest

from calib.errors import CalibError
from calib.store.kept_results import KeptResults

ONE, OTHER = (hashlib.sha256(name).digest() for name in (b"one", b"other"))


@pytest.fixture
def path(tmp_path):
    """File of two results."""
    with KeptResults(tmp_path / "kept", {"study": 1}) as kept:
        kept.add(ONE, b"first")
        kept.add(OTHER, b"")
        kept.add(ONE, b"not taken")
    return tmp_path / "kept"


def test_what_was_kept_is_there_again(path):
    with KeptResults(path, {"study": 1}) as kept:
        assert (kept.known, ONE in kept, OTHER in kept, b"third" in kept) == (2, True, True, False)
        assert (kept.get(ONE), kept.get(OTHER)) == (b"first", b"")


def test_what_belongs_to_something_else_is_forgotten(path):
    with KeptResults(path, {"study": 2}) as kept:
        assert (kept.known, ONE in kept) == (0, False)
        kept.add(ONE, b"again")
    with KeptResults(path, {"study": 2}) as kept:
        assert kept.get(ONE) == b"again"


def test_after_any_cut_what_was_whole_before_it_is_there_and_the_file_goes_on(path):
    whole = path.read_bytes()
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        with KeptResults(path, {"study": 1}) as kept:
            entries = [kept.get(key) for key in (ONE, OTHER) if key in kept]
            assert entries == [b"first", b""][: kept.known]
            whole_before = OTHER in kept
            kept.add(OTHER, b"new")
        with KeptResults(path, {"study": 1}) as kept:
            assert kept.get(OTHER) == (b"" if whole_before else b"new")


def test_a_damaged_result_and_all_behind_it_are_calculated_again(path):
    content = bytearray(path.read_bytes())
    content[content.index(b"first")] ^= 1
    path.write_bytes(content)
    with KeptResults(path, {"study": 1}) as kept:
        assert kept.known == 0


def test_a_full_disk_stops_nobody(path, monkeypatch):
    def full(file, data, offset):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    third, fourth = (hashlib.sha256(name).digest() for name in (b"third", b"fourth"))
    with KeptResults(path, {"study": 1}) as kept:
        with monkeypatch.context() as patch:
            patch.setattr(os, "pwrite", full)
            kept.add(third, b"lost")
        kept.add(fourth, b"not tried")
        assert (third in kept, fourth in kept, kept.get(ONE)) == (False, False, b"first")
    with KeptResults(path, {"study": 1}) as kept:
        assert kept.known == 2


def test_beside_another_process_nothing_is_kept_and_its_file_stays(path):
    with KeptResults(path, {"study": 1}) as first, KeptResults(path, {"study": 2}) as second:
        assert second.known == 0
        second.add(ONE, b"mine")
        second.remove()
        assert (ONE in second, first.get(ONE)) == (False, b"first")
    assert path.exists()


def test_once_what_they_were_for_is_complete_the_file_goes(path):
    with KeptResults(path, {"study": 1}) as kept:
        kept.remove()
    assert not path.exists()


def test_a_file_that_cannot_be_made_is_named(tmp_path):
    with pytest.raises(CalibError, match="cannot write .*kept: No such file or directory; mend that and run again"):
        KeptResults(tmp_path / "missing" / "kept", {})
