"""Finished points of profiles in a file, so that a run that was stopped or killed goes on."""

import hashlib
import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from calib.confidence.constrained import FittedPoint
from calib.errors import CalibError
from calib.execution.files import PERMISSIONS
from calib.store import checksum
from calib.store.ledger import write_errors_reported
from calib.store.plain import plain, typed

NOTES = "confidence.jsonl"
IDENTITY, KEY, POINT = "of", "key", "point"
EVALUATION = "evaluation/"  # begin of the keys of points that were evaluated for a posterior distribution
CONFIRMED = "confirmed/"  # the same of points that the confirming simulator evaluated


class PointNotes:
    """A JSON-lines file of points by their keys, each on disk before `add` returns; use it in a with block.

    The first line says what the points belong to. Those of something else are forgotten, and so is an unfinished last
    line.

    Parameters
    ----------
    path : of the file, made where it is missing
    identity : all that decides what the points are, as JSON

    Raises
    ------
    CalibError : the file cannot be read or written, or a line of it is damaged
    """

    def __init__(self, path: Path, identity: Any):
        self._path = path
        digest = hashlib.sha256(json.dumps(plain(identity), sort_keys=True).encode()).hexdigest()
        self._points, end = _read(path, digest)
        with write_errors_reported(path):
            self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, PERMISSIONS)
            os.ftruncate(self._file, end)
        self.known = len(self._points)
        if not end:
            self._append({IDENTITY: digest})

    @property
    def evaluations(self) -> int:
        """Evaluations that the points of profiles took."""
        return sum(
            point.evaluations for key, point in self._points.items() if not key.startswith((EVALUATION, CONFIRMED))
        )

    def get(self, key: str) -> FittedPoint | None:
        """Return the point of a key, None where there is none yet."""
        return self._points.get(key)

    def add(self, key: str, point: FittedPoint) -> None:
        """Keep a point."""
        self.add_all({key: point})

    def add_all(self, points: Mapping[str, FittedPoint]) -> None:
        """Keep points that were made together."""
        self._append(*({KEY: key, POINT: plain(point)} for key, point in points.items()))
        self._points.update(points)

    def _append(self, *contents: dict[str, Any]) -> None:
        lines = (json.dumps(content, allow_nan=False, separators=(",", ":")) for content in contents)
        with write_errors_reported(self._path):
            os.write(self._file, b"".join(map(checksum.sealed, lines)))
            os.fsync(self._file)

    def __enter__(self) -> "PointNotes":
        return self

    def __exit__(self, *exception: object) -> None:
        os.close(self._file)


def _read(path: Path, digest: str) -> tuple[dict[str, FittedPoint], int]:
    """Points of a file by their keys, and where the last whole line of them ends; none of another identity."""
    try:
        text = path.read_bytes()
    except FileNotFoundError:
        return {}, 0
    except OSError as error:
        raise CalibError(f"cannot read {path}: {error.strerror}") from error
    whole = text[: text.rfind(b"\n") + 1]
    points = dict[str, FittedPoint]()
    for number, line in enumerate(whole.splitlines(keepends=True)):
        try:
            content = json.loads(line)
            if not checksum.is_intact(line, content):
                raise ValueError("its check sum does not fit its content")
            if number == 0:
                if content[IDENTITY] != digest:
                    return {}, 0
            else:
                points[content[KEY]] = _point(content[POINT])
        except (KeyError, TypeError, ValueError) as error:
            raise CalibError(
                f"{path}, line {number + 1} is damaged ({error}); delete the file, or use --fresh"
            ) from error
    return points, len(whole)


def _point(document: dict[str, Any]) -> FittedPoint:
    finite = {key: math.inf if document[key] is None else document[key] for key in ("square", "cost")}
    return typed(FittedPoint, {**document, **finite})
