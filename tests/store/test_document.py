"""Claims about documents in JSON files."""

import json
from dataclasses import dataclass
from functools import partial

import pytest

from calib.errors import CalibError
from calib.store.document import read_document, write_document
from calib.store.plain import plain, typed


@dataclass(frozen=True)
class Weighed:
    """A document."""

    name: str
    mass: float | None


def read(path):
    return read_document(path, partial(typed, Weighed), "weighed thing", "calib weigh")


def test_what_was_written_is_read(tmp_path):
    path = tmp_path / "weighed.json"
    for thing in (Weighed("bob", 0.2), Weighed("mass à ressort", None)):
        write_document(plain(thing), path)
        assert read(path) == thing
    assert [one.name for one in tmp_path.iterdir()] == ["weighed.json"]


def test_there_may_be_no_file(tmp_path):
    assert read(tmp_path / "weighed.json") is None


@pytest.mark.parametrize("content", ["", "{", "[]", '{"name": 1}', '{"mass": 2.0}', "[" * 100_000, b"\xff\xfe{"])
def test_a_file_of_something_else_is_named_with_what_to_do(tmp_path, content):
    path = tmp_path / "weighed.json"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(
        CalibError, match=r"weighed.json holds no weighed thing \(.*\); delete it and run `calib weigh`"
    ):
        read(path)


def test_a_failed_write_leaves_the_file_as_it_was(tmp_path):
    path = tmp_path / "weighed.json"
    write_document({"name": "bob", "mass": 0.2}, path)
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_document({"name": "bob", "mass": float("nan")}, path)
    assert json.loads(path.read_text()) == {"name": "bob", "mass": 0.2}
