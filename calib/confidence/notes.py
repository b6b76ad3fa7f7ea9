"""Finished points of profiles in a file, so that a run that was stopped or killed goes on."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from calib.confidence.constrained import FittedPoint
from calib.store.notes import PieceNotes
from calib.store.plain import typed

NOTES = "confidence.jsonl"
EVALUATION = "evaluation/"  # begin of the keys of points that were evaluated for a posterior distribution
CONFIRMED = "confirmed/"  # the same of points that the confirming simulator evaluated


class PointNotes(PieceNotes[FittedPoint]):
    """A file of points by their keys.

    Parameters and errors as of `PieceNotes`.
    """

    def __init__(self, path: Path, identity: Any):
        super().__init__(path, identity, "point", _point)

    @property
    def evaluations(self) -> int:
        """Evaluations that the points of profiles took."""
        return sum(
            point.evaluations for key, point in self.pieces.items() if not key.startswith((EVALUATION, CONFIRMED))
        )

    def __enter__(self) -> "PointNotes":
        return self


def _point(document: Mapping[str, Any]) -> FittedPoint:
    finite = {key: math.inf if document[key] is None else document[key] for key in ("square", "cost")}
    return typed(FittedPoint, {**document, **finite})
