"""A measured frequency response, prepared for the comparison with simulated ones."""

from collections.abc import Sequence
from typing import NoReturn

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from calib.errors import CalibError
from calib.objective.prepared_reference import Pairs, SensedRecord
from calib.objective.scalar_features import FeatureValue, Scalar, compared
from calib.objective.terms import Reference, Term
from calib.records import OK
from calib.records.cycles import SWEPT, MotionKind
from calib.records.response import complex_amplitude, sweeps, tolerances

SAMPLES_PER_INTERVAL = 16  # of the curve between two of its points, where the nearest one is sought
MAX_FOOT_STEPS = 6  # of Newton's method to the nearest point of the curve
MIN_SPLINE_POINTS = 4  # fewer are joined by straight lines
KIND = MotionKind(SWEPT, None, "the response to a sweep has no single motion")


class PreparedResponse:
    """A measured response, with everything that does not depend on the simulation computed once.

    It is compared as `PreparedReference` compares a record over time, but that a simulated response is put on the
    measured points by distance: see `sensed`.
    """

    def __init__(self, reference: Reference, terms: Sequence[Term]):
        self.name, self.reference, self.record = reference.name, reference, reference.record
        self.period: float | None = None
        self.bodies = [str(body) for body in self.record.body.values]
        self.motion = KIND
        self.prescribed: Pairs = frozenset()
        wanted = [t for t in terms if t.records is None or reference.name in t.records] or terms
        self._bodies = [b for b in self.bodies if any(b in (term.bodies or self.bodies) for term in wanted)]
        self._frequency_sigma, self._sigma = tolerances(self.record)

    def failure(self, simulated: xr.Dataset) -> tuple[str, str] | None:
        """Status and reason of a response that cannot be compared, None where it can."""
        status = simulated.attrs.get("status", OK)
        if status != OK:
            return status, str(simulated.attrs.get("reason", ""))
        if not np.isfinite(complex_amplitude(simulated)).all():
            return "not finite", f"the simulated response {self.name!r} holds NaN or infinity"
        return None

    def sensed(self, simulated: xr.Dataset) -> SensedRecord:
        """Put a simulated response on the measured points: of each the nearest point of the curve of its sweep.

        The distance is that of frequency and of the real and imaginary parts of all compared bodies, each in its
        standard uncertainty (`calib.records.response.tolerances`): orthogonal distance regression.
        """
        simulated = simulated.sel(body=self.bodies)
        frequency = np.empty(self.record.sizes["point"])
        amplitude = np.empty((len(self.bodies), frequency.size), dtype=complex)
        rows = [self.bodies.index(body) for body in self._bodies]
        measured, own = self.record["frequency"].values, complex_amplitude(self.record)
        for sweep, points in sweeps(self.record):
            curves = _curves(simulated, sweep)
            for point in points.tolist():
                sigma = np.concatenate([[self._frequency_sigma[point]], *(2 * [self._sigma[rows, point]])])
                target = np.concatenate([[measured[point]], own[rows, point].real, own[rows, point].imag])
                frequency[point], amplitude[:, point] = _nearest(curves, target, sigma, rows)
        values = {
            "frequency": ("point", frequency, {"units": "Hz"}),
            "in_phase": (("body", "point"), amplitude.real, {"units": "m"}),
            "quadrature": (("body", "point"), amplitude.imag, {"units": "m"}),
            "trust": ("point", np.ones(frequency.size)),
        }
        return SensedRecord(self.record.assign(values), simulated, {}, KIND, frozenset())

    def penalty(self, motion: MotionKind) -> float | None:
        """None: a response is of no kind of motion."""
        return None

    def released(self, *_: object) -> NoReturn:
        """Refuse: a steady response does not depend on its start."""
        raise CalibError(f"{self.name}: a frequency response has no initial state that could be solved for")

    def features(self, pairs: set[tuple[str, str]], sensed: SensedRecord) -> list[FeatureValue]:
        """Largest amplitude, and the frequency at which it is, of each body in each sweep."""
        found: list[FeatureValue] = []
        for body in (body for body in self.bodies if any(body == own for own, _ in pairs)):
            measured, simulated = (_peaks(record, body) for record in (self.record, sensed.record))
            found += compared(self.name, body, measured, simulated)
        return found


def _peaks(record: xr.Dataset, body: str) -> dict[str, Scalar]:
    own = np.abs(complex_amplitude(record.sel(body=[body]))[0])
    peaks: dict[str, Scalar] = {}
    for sweep, points in sweeps(record):
        top = points[int(np.argmax(own[points]))]
        peaks[f"largest amplitude in sweep {sweep:g}"] = Scalar(float(own[top]), "m")
        peaks[f"frequency of the largest amplitude in sweep {sweep:g}"] = Scalar(float(record.frequency[top]), "Hz")
    return peaks


def _curves(simulated: xr.Dataset, sweep: float) -> list[tuple[np.ndarray, CubicSpline | None, np.ndarray]]:
    """Stable stretches of a sweep: parameter (m,) along each, spline over it, and points (m, 1 + 2 bodies).

    A point holds frequency [Hz], real parts and imaginary parts [m]. The parameter is the chord length in units of the
    ranges of a stretch.
    """
    curves = []
    amplitude = complex_amplitude(simulated)
    own = simulated["sweep"].values == sweep
    for piece in dict.fromkeys(simulated["piece"].values[own].tolist()):
        at = np.flatnonzero(own & (simulated["piece"].values == piece))
        points = np.column_stack([simulated["frequency"].values[at], amplitude[:, at].real.T, amplitude[:, at].imag.T])
        span = np.ptp(points, axis=0)
        chord = np.linalg.norm(np.diff(points / np.where(span > 0.0, span, 1.0), axis=0), axis=1)
        keep = np.concatenate([[True], chord > 0.0])
        along, points = np.concatenate([[0.0], np.cumsum(chord)])[keep], points[keep]
        spline = CubicSpline(along, points) if along.size >= MIN_SPLINE_POINTS else None
        curves.append((along, spline, points))
    return curves


def _nearest(
    curves: list[tuple[np.ndarray, CubicSpline | None, np.ndarray]],
    target: np.ndarray,
    sigma: np.ndarray,
    rows: Sequence[int],
) -> tuple[float, np.ndarray]:
    """Frequency [Hz] and complex amplitudes (body,) [m] of the point of the curves that is nearest to a measured one.

    target, sigma : (1 + 2 n,) frequency, real parts and imaginary parts of n compared bodies, and their uncertainties
    """
    best, nearest = np.inf, np.empty(0)
    for along, spline, points in curves:
        bodies = (points.shape[1] - 1) // 2
        columns = [0, *(1 + row for row in rows), *(1 + bodies + row for row in rows)]
        fine = np.interp(
            np.arange(SAMPLES_PER_INTERVAL * (along.size - 1) + 1) / SAMPLES_PER_INTERVAL, np.arange(along.size), along
        )
        sampled = _at(fine, along, spline, points)
        square = (((sampled[:, columns] - target) / sigma) ** 2).sum(axis=1)
        place = int(np.argmin(square))
        foot = sampled[place]
        if spline is not None:
            low, high = fine[max(place - 1, 0)], fine[min(place + 1, fine.size - 1)]
            foot = spline(_foot(spline, float(fine[place]), (float(low), float(high)), columns, target, sigma))
        distance = float((((foot[columns] - target) / sigma) ** 2).sum())
        if distance < best:
            best, nearest = distance, foot
    bodies = (nearest.size - 1) // 2
    return float(nearest[0]), nearest[1 : 1 + bodies] + 1j * nearest[1 + bodies :]


def _at(fine: np.ndarray, along: np.ndarray, spline: CubicSpline | None, points: np.ndarray) -> np.ndarray:
    if spline is not None:
        return np.asarray(spline(fine))
    return np.column_stack([np.interp(fine, along, column) for column in points.T])


def _foot(
    spline: CubicSpline,
    at: float,
    bounds: tuple[float, float],
    columns: list[int],
    target: np.ndarray,
    sigma: np.ndarray,
) -> float:
    """Parameter of the nearest point of a spline within bounds, by Newton's method on the squared distance."""
    for _ in range(MAX_FOOT_STEPS):
        apart, slope, bend = (
            (spline(at, order)[columns] - (target if order == 0 else 0.0)) / sigma for order in range(3)
        )
        curvature = float(slope @ slope + apart @ bend)
        if curvature <= 0.0:
            curvature = float(slope @ slope)
        if curvature == 0.0:
            break
        at = float(np.clip(at - float(slope @ apart) / curvature, *bounds))
    return at
