"""Work done in pieces: kept, found again, joined."""

import os

import numpy as np
import pytest
import xarray as xr

from calib.errors import CalibError
from calib.execution.pool import InProcess
from calib.store.chunks import Chunks, joined, read_joined, write_joined

ONE, OTHER = {"over": [1.0, 2.0], "environment": "here"}, {"over": [1.0, 3.0], "environment": "here"}


def squares(x):
    if x < 0:
        raise ValueError("below zero")
    if x > 100:
        raise CalibError("above a hundred")
    return {"square": np.array([x * x]), "name": np.array(["x" * x])}


def alone(x):
    return {"square": np.array([-1]), "name": np.array([f"{x} failed"])}


def made(chunks, tasks):
    with InProcess(squares) as pool:
        return dict(chunks.computed(pool, tasks, alone))


def hidden(folder):
    return [name for name in os.listdir(folder) if name.startswith(".")]


# --- pieces


def test_a_piece_comes_back_as_it_was_kept(tmp_path):
    arrays = {"f": np.array([[1.5, np.nan]]), "i": np.array([3]), "s": np.array(["period-1", ""]), "no": np.zeros(0)}
    with Chunks(tmp_path / "x.nc", ONE) as chunks:
        assert chunks.read("0") is None
        chunks.write("0", arrays)
        found = chunks.read("0")
        chunks.clear()
    assert list(found) == list(arrays)
    for name, array in arrays.items():
        np.testing.assert_array_equal(found[name], array)
        assert found[name].dtype == array.dtype


def test_what_is_made_is_kept_for_the_next_process(tmp_path):
    with Chunks(tmp_path / "x.nc", ONE) as chunks:
        assert chunks.finished(["a", "b"]) == {}
        made(chunks, {"a": 3})
    with Chunks(tmp_path / "x.nc", ONE) as chunks:
        [(key, arrays)] = chunks.finished(["a", "b"]).items()
        chunks.clear()
    assert (key, arrays["square"]) == ("a", 9)


def test_pieces_are_yielded_when_they_are_kept(tmp_path):
    kept = {}
    with Chunks(tmp_path / "x.nc", ONE) as chunks, InProcess(squares) as pool:
        for key, arrays in chunks.computed(pool, {"a": 1, "b": 2, "c": -1}, alone):
            kept[key] = chunks.read(key)  # before the next one is made
            assert kept[key]["square"] == arrays["square"]
        chunks.clear()
    assert {key: int(arrays["square"][0]) for key, arrays in kept.items()} == {"a": 1, "b": 4, "c": -1}


def test_what_a_failing_call_was_to_make_is_made_alone_when_the_others_have_ended(tmp_path):
    with Chunks(tmp_path / "x.nc", ONE) as chunks:
        found = made(chunks, {"a": -1, "b": 2})
        assert list(found) == ["b", "a"]
        assert found["a"]["name"] == ["-1 failed"]
        assert chunks.finished(["a"])["a"]["name"] == ["-1 failed"]
        chunks.clear()


def test_a_failing_call_leaves_nothing_itself(tmp_path):
    def stopped(task):
        raise KeyboardInterrupt

    with Chunks(tmp_path / "x.nc", ONE) as chunks, InProcess(squares) as pool:
        with pytest.raises(KeyboardInterrupt):
            list(chunks.computed(pool, {"a": -1, "b": 2}, stopped))
        assert list(chunks.finished(["a", "b"])) == ["b"]
        chunks.clear()


def test_a_refusal_is_the_caller_s_mistake(tmp_path):
    with pytest.raises(CalibError, match="above a hundred"), Chunks(tmp_path / "x.nc", ONE) as chunks:
        made(chunks, {"a": 101})
    assert hidden(tmp_path) == []


@pytest.mark.parametrize(("path", "definition"), [("x.nc", OTHER), ("y.nc", ONE)], ids=["definition", "path"])
def test_other_work_has_other_pieces(tmp_path, path, definition):
    with Chunks(tmp_path / "x.nc", ONE) as chunks:
        made(chunks, {"a": 3})
    with Chunks(tmp_path / path, definition) as chunks:
        assert chunks.finished(["a"]) == {}


def test_the_hidden_folder_goes_with_the_last_piece(tmp_path):
    with Chunks(tmp_path / "x.nc", ONE) as chunks:
        made(chunks, {"a": 3})
    with Chunks(tmp_path / "x.nc", OTHER):
        pass
    assert len(hidden(tmp_path)) == 1
    with Chunks(tmp_path / "x.nc", OTHER) as chunks:
        chunks.clear()
    assert hidden(tmp_path) == []


@pytest.mark.parametrize("definition", [ONE, OTHER])
def test_one_at_a_time_works_for_a_file(tmp_path, definition):
    with Chunks(tmp_path / "x.nc", ONE):
        with pytest.raises(CalibError, match=r"x\.nc is being written by process"):
            Chunks(tmp_path / "x.nc", definition).__enter__()
        with Chunks(tmp_path / "y.nc", definition):
            pass
    with Chunks(tmp_path / "x.nc", definition):
        pass


# --- the joined file

JOINED = xr.Dataset(
    {"kind": ("branch", np.array(["period-1", "chaotic"])), "none": (("branch", "k"), np.zeros((2, 0)))},
    coords={"branch": ["forward", "backward"]},
)


def test_a_joined_file_comes_back_with_its_texts_and_definition(tmp_path):
    write_joined(JOINED, ONE, tmp_path / "x.nc")
    found = read_joined(tmp_path / "x.nc")
    assert found.kind.dtype.kind == found.branch.dtype.kind == "U"
    xr.testing.assert_equal(found, JOINED)
    xr.testing.assert_identical(joined(tmp_path / "x.nc", ONE), found)


def test_another_machine_s_file_of_the_same_work_is_taken_and_this_is_said(tmp_path):
    write_joined(JOINED, ONE, tmp_path / "x.nc")
    with pytest.warns(UserWarning, match=r"x\.nc was made with other library versions"):
        assert joined(tmp_path / "x.nc", {**ONE, "environment": "there"}) is not None


def test_a_file_of_other_work_is_refused_and_says_in_what_it_differs(tmp_path):
    write_joined(JOINED, ONE, tmp_path / "x.nc")
    with pytest.raises(CalibError, match=r"x\.nc holds something else \(it differs in over\).*--fresh"):
        joined(tmp_path / "x.nc", OTHER)
    assert joined(tmp_path / "x.nc", OTHER, fresh=True) is None


def test_of_the_options_of_a_simulator_those_are_compared_that_both_versions_state(tmp_path):
    write_joined(JOINED, {**ONE, "options": {"drive": "spring", "old": 1}}, tmp_path / "x.nc")
    same = {**ONE, "options": {"drive": "spring", "counts": {"masters": 56}}}
    assert joined(tmp_path / "x.nc", same) is not None
    with pytest.raises(CalibError, match=r"it differs in options\.drive\)"):
        joined(tmp_path / "x.nc", {**same, "options": {"drive": "rigid"}})


def test_without_a_file_nothing_is_joined(tmp_path):
    assert joined(tmp_path / "x.nc", ONE) is None


@pytest.mark.parametrize("fresh", [False, True])
def test_a_file_of_something_else_is_refused(tmp_path, fresh):
    JOINED.to_netcdf(tmp_path / "x.nc")
    with pytest.raises(CalibError, match="not a file of `calib sweep` or `calib basins`"):
        joined(tmp_path / "x.nc", ONE, fresh)
