"""Pieces of a long calculation in a file."""

import os
from dataclasses import dataclass

import pytest

from calib.errors import CalibError
from calib.store.notes import PieceNotes
from calib.store.plain import typed


@dataclass(frozen=True)
class Piece:
    """One number."""

    value: float


def opened(path, identity="this"):
    return PieceNotes(path, identity, "piece", lambda document: typed(Piece, document))


def test_pieces_come_back_unless_they_belong_to_something_else(tmp_path):
    path = tmp_path / "pieces.jsonl"
    with opened(path) as notes:
        notes.add("a", Piece(1.5))
        notes.add_all({"b": Piece(2.5), "c": Piece(3.5)})
    with opened(path) as notes:
        assert (notes.known, notes.get("b"), notes.get("d")) == (3, Piece(2.5), None)
    with opened(path, "that") as notes:
        assert notes.known == 0


def test_a_piece_that_the_disk_does_not_take_whole_is_refused_and_spoils_no_other(tmp_path, monkeypatch):
    path, whole = tmp_path / "pieces.jsonl", os.pwrite
    with opened(path) as notes:
        notes.add("a", Piece(1.5))
        room = [10]

        def full(file, data, offset):
            if not room[0]:
                raise OSError(28, "No space left on device")
            taken = whole(file, data[: room[0]], offset)
            room[0] -= taken
            return taken

        monkeypatch.setattr(os, "pwrite", full)
        with pytest.raises(CalibError, match="No space left"):
            notes.add("b", Piece(2.5))
        monkeypatch.setattr(os, "pwrite", whole)
        assert notes.get("b") is None
        notes.add("c", Piece(3.5))
    with opened(path) as notes:
        assert dict(notes.pieces) == {"a": Piece(1.5), "c": Piece(3.5)}


def test_a_damaged_line_is_named(tmp_path):
    path = tmp_path / "pieces.jsonl"
    with opened(path) as notes:
        notes.add("a", Piece(1.5))
    path.write_bytes(path.read_bytes().replace(b"1.5", b"1.7"))
    with pytest.raises(CalibError, match=r"pieces.jsonl, line 2 is damaged \(its check sum"):
        opened(path)
