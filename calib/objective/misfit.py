"""The misfit of simulated records: one definition, whatever the terms of a study."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from calib.objective.terms import Reference, Term
from calib.records import channels, prescribed
from calib.records.response import has_phase, parts_of

MISFIT = (
    "rms of measured minus simulated over the standard deviation of the measured channel, rms over channels and "
    "records, with equal weight of all samples that are compared"
)

Rows = Sequence[tuple[str, str]]  # (body, channel)


@dataclass(frozen=True, eq=False)
class Squares:
    """Squared residuals of one record over the mean squares of its channels about their means, summed over segments.

    Attributes
    ----------
    total : (row, segment) sums over the samples that count  [1]
    count : (row, segment) number of these samples
    """

    total: np.ndarray
    count: np.ndarray

    @classmethod
    def of(cls, measured: np.ndarray, simulated: np.ndarray, weight: np.ndarray, segments: np.ndarray) -> "Squares":
        """Sum over segments.

        Parameters
        ----------
        measured, simulated : (row, n), each row in its unit
        weight : (row, n) in [0, 1], 0 where a sample does not count
        segments : (n,) number of the segment of each sample
        """
        size = np.square(measured - measured.mean(axis=1, keepdims=True)).mean(axis=1, keepdims=True)
        square = np.square(weight * (measured - simulated)) / np.where(size > 0.0, size, 1.0)
        length = int(segments.max(initial=-1)) + 1
        total, count = (
            np.array([np.bincount(segments, row, length) for row in rows]).reshape(-1, length)
            for rows in (square, np.square(weight))
        )
        return cls(total, count)

    def drawn(self, index: np.ndarray) -> "Squares":
        """Return the squares of these segments, which may be repeated."""
        return Squares(self.total[:, index], self.count[:, index])

    @property
    def mean(self) -> float:
        """Mean over the samples that count of each channel, then over channels; NaN where none counts  [1]."""
        return float(self.resampled(np.ones((1, self.total.shape[1])))[0])

    def resampled(self, times: np.ndarray) -> np.ndarray:
        """Means (k,), as `mean`, with each segment taken as often as `times` (k, segment) says  [1]."""
        total, count = times @ self.total.T, times @ self.count.T
        counted = count > 0.0
        means, channels = np.divide(total, count, out=np.zeros(total.shape), where=counted), counted.sum(axis=1)
        return np.divide(means.sum(axis=1), channels, out=np.full(len(times), np.nan), where=channels > 0)


def misfit(records: Sequence[Squares]) -> float:
    """Misfit of the records together, as `MISFIT` has it  [1]."""
    return float(np.sqrt(np.mean([squares.mean for squares in records])))


def compared_rows(reference: Reference, terms: Sequence[Term]) -> Rows:
    """(body, channel) pairs of a reference that a term may compare and that its record does not prescribe."""
    own = [t for t in terms if t.records is None or reference.name in t.records] or terms
    names = [str(body) for body in reference.record.body.values]
    bodies = {body for term in own for body in term.bodies or names}
    given = prescribed(reference.record)
    # the imaginary parts of a response of amplitudes alone
    unknown = parts_of(reference.record)[1::2] if reference.is_swept and not has_phase(reference.record) else ()
    return [
        (body, channel)
        for body in names
        for channel in channels(reference.record)
        if body in bodies and (body, channel) not in given and channel not in unknown
    ]


def row_weights(rows: Rows, used: np.ndarray, trust: np.ndarray) -> np.ndarray:
    """Weights (row, n) of the samples `used` (row, n): velocity is multiplied by its trust (n,)."""
    moving = np.array([channel == "velocity" for _, channel in rows], dtype=bool)
    return used * np.where(moving[:, None], trust[None], 1.0)


def record_misfit(reference: Reference, terms: Sequence[Term], simulated: xr.Dataset, compared: xr.Dataset) -> float:
    """Misfit of one simulated record, as `MISFIT` has it; NaN where no sample counts  [1].

    Parameters
    ----------
    reference : what was measured
    terms : of the study
    simulated, compared : the record as it was simulated, and as `Objective.compared` returns it
    """
    given = prescribed(simulated)
    rows = [(b, c) for b, c in compared_rows(reference, terms) if (b, c) not in given and c in compared]
    return misfit([squares_of(reference.compared, compared, rows)]) if rows else np.nan


def squares_of(measured: xr.Dataset, compared: xr.Dataset, rows: Rows) -> Squares:
    """Squares of these rows of a record, in a single segment."""
    reference, simulated = (np.array([one[c].sel(body=b).values for b, c in rows]) for one in (measured, compared))
    weight = row_weights(rows, np.ones(reference.shape), compared["trust"].values)
    return Squares.of(reference, simulated, weight, np.zeros(reference.shape[1], dtype=int))
