"""Finished pieces of a long calculation in a file, so that a run that was stopped or killed goes on."""

import hashlib
import json
import os
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Generic, TypeVar

from calib.errors import CalibError
from calib.execution.files import PERMISSIONS
from calib.store import checksum
from calib.store.ledger import write_at, write_errors_reported
from calib.store.plain import plain

IDENTITY, KEY = "of", "key"
T = TypeVar("T")


class PieceNotes(Generic[T]):
    """A JSON-lines file of pieces by their keys, each on disk before `add` returns; use it in a with block.

    The first line says what the pieces belong to. Those of something else are forgotten, and so is an unfinished last
    line.

    Parameters
    ----------
    path : of the file, made where it is missing
    identity : all that decides what the pieces are, as JSON
    kind : what a piece is called in the file
    read : a piece from its JSON; raises KeyError, TypeError or ValueError where it is none

    Raises
    ------
    CalibError : the file cannot be read or written, or a line of it is damaged
    """

    def __init__(self, path: Path, identity: Any, kind: str, read: Callable[[Mapping[str, Any]], T]):
        self._path, self._kind, self._one_at_a_time = path, kind, threading.Lock()
        digest = hashlib.sha256(json.dumps(plain(identity), sort_keys=True).encode()).hexdigest()
        self._pieces, self._end = _read(path, digest, kind, read)
        with write_errors_reported(path):
            self._file = os.open(path, os.O_WRONLY | os.O_CREAT, PERMISSIONS)
            os.ftruncate(self._file, self._end)
        self.known = len(self._pieces)
        if not self._end:
            self._append({IDENTITY: digest})

    @property
    def pieces(self) -> Mapping[str, T]:
        """All pieces by their keys."""
        return self._pieces

    def get(self, key: str) -> T | None:
        """Return the piece of a key, None where there is none yet."""
        return self._pieces.get(key)

    def add(self, key: str, piece: T) -> None:
        """Keep a piece."""
        self.add_all({key: piece})

    def add_all(self, pieces: Mapping[str, T]) -> None:
        """Keep pieces that were made together."""
        self._append(*({KEY: key, self._kind: plain(piece)} for key, piece in pieces.items()))
        self._pieces.update(pieces)

    def _append(self, *contents: dict[str, Any]) -> None:
        lines = (json.dumps(content, allow_nan=False, separators=(",", ":")) for content in contents)
        data = b"".join(map(checksum.sealed, lines))
        with self._one_at_a_time:
            write_at(self._file, self._path, data, self._end)
            self._end += len(data)

    def __enter__(self) -> "PieceNotes[T]":
        return self

    def __exit__(self, *exception: object) -> None:
        os.close(self._file)


def _read(path: Path, digest: str, kind: str, read: Callable[[Mapping[str, Any]], T]) -> tuple[dict[str, T], int]:
    """Pieces of a file by their keys, and where the last whole line of them ends; none of another identity."""
    try:
        text = path.read_bytes()
    except FileNotFoundError:
        return {}, 0
    except OSError as error:
        raise CalibError(f"cannot read {path}: {error.strerror}") from error
    whole = text[: text.rfind(b"\n") + 1]
    pieces = dict[str, T]()
    for number, line in enumerate(whole.splitlines(keepends=True)):
        try:
            content = json.loads(line)
            if number == 0 and IDENTITY not in content:  # of an earlier format
                return {}, 0
            if not checksum.is_intact(line, content):
                raise ValueError("its check sum does not fit its content")
            if number == 0:
                if content[IDENTITY] != digest:
                    return {}, 0
            else:
                pieces[content[KEY]] = read(content[kind])
        except (KeyError, TypeError, ValueError) as error:
            raise CalibError(
                f"{path}, line {number + 1} is damaged ({error}); delete the file, or use --fresh"
            ) from error
    return pieces, len(whole)
