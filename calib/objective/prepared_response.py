"""A measured frequency response, prepared for the comparison with simulated ones."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple, NoReturn

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from calib.errors import CalibError
from calib.objective.gross_errors import in_doubt, trust_at
from calib.objective.prepared_reference import Pairs, SensedRecord
from calib.objective.scalar_features import FeatureValue, Scalar, compared
from calib.objective.stable_stretches import StableStretch, stable_stretches
from calib.objective.terms import Reference, Term
from calib.records import OK
from calib.records.compared_response import compared_harmonics, compared_of, compared_tolerances
from calib.records.cycles import SWEPT, MotionKind
from calib.records.held_response import is_held
from calib.records.response import (
    complex_harmonics,
    harmonic_orders,
    harmonic_tolerances,
    has_phase,
    modulus,
    split_parts,
    sweeps,
    tolerances,
    with_harmonics,
)
from calib.records.sweep_names import sweep_names

SAMPLES_PER_INTERVAL = 16  # of the curve between two of its points, where the nearest one is sought
MAX_FOOT_STEPS = 6  # of Newton's method to the nearest point of the curve
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
        self._frequency_sigma, self._sigma = compared_tolerances(self.record)
        self._orders = len(harmonic_orders(self.record))
        self._higher_sigma = harmonic_tolerances(self.record)[1:]
        self._parts = len(self._rows) * (2 if has_phase(self.record) else 1)
        self._sweep_names = sweep_names(self.record)
        self._in_doubt = self._points_in_doubt()
        self._sweeps_without_doubt = [(number, own[~self._in_doubt[own]]) for number, own in sweeps(self.record)]

    def failure(self, simulated: xr.Dataset) -> tuple[str, str] | None:
        """Status and reason of a response that cannot be compared, None where it can."""
        status = simulated.attrs.get("status", OK)
        if status != OK:
            return status, str(simulated.attrs.get("reason", ""))
        if not np.isfinite(complex_harmonics(simulated)).all():
            return "not finite", f"the simulated response {self.name!r} holds NaN or infinity"
        return None

    def sensed(self, simulated: xr.Dataset) -> SensedRecord:
        """Put a simulated response on the measured points: of each the nearest point of the curve of its sweep.

        The distance is that of frequency and of the real and imaginary parts of all harmonics of all compared bodies,
        each in its standard uncertainty: orthogonal distance regression. At a held amplitude that of the level, see
        `calib.records.compared_response`.
        """
        simulated = self._read(simulated)
        size = self.record.sizes["point"]
        frequency, rows = np.empty(size), np.empty((self._orders * len(self.bodies), size), dtype=complex)
        trust = np.empty(size)
        for points, feet in self._feet(simulated):
            frequency[points], rows[:, points], trust[points] = (
                feet.frequency,
                feet.amplitude,
                self._trust(feet, points),
            )
        harmonics = compared_of(
            rows.reshape(self._orders, len(self.bodies), size), self.record["sweep"].values, self.record
        )
        values = {
            "frequency": ("point", frequency, {"units": "Hz"}),
            **{part: (("body", "point"), own, {"units": "m"}) for part, own in split_parts(self.record, harmonics)},
            "trust": ("point", trust),
        }
        return SensedRecord(self.record.assign(values), simulated, {}, KIND, frozenset())

    def compared(self, simulated: xr.Dataset) -> xr.Dataset:
        """Return a simulated response as it is compared with the measured one in its standard uncertainties.

        The distance of a point from the curve has the components dF / sigma_F, dH / sigma_H, and none along the curve
        (at the end of a stretch it may have one, which does not count). It is turned in the plane of the frequency and
        of the tangent, by the angle between these, so that its component by the frequency becomes the one along the
        curve: what is left are as many components as there are parts, of noise of unit variance.
        """
        parts = self.reference.compared
        rows, own = self._rows, complex_harmonics(parts)
        left, trust = own.reshape(-1, own.shape[-1]), np.empty(own.shape[-1])  # by row: a view
        for points, feet in self._feet(self._read(simulated)):
            real, imaginary = _turned(feet.apart, feet.tangent)[:, 1:].T.reshape(2, len(rows), len(points))
            trust[points] = self._trust(feet, points)
            left[np.array(rows)[:, None], points] -= trust[points] * (real + 1j * imaginary)
        values = {part: (("body", "point"), values) for part, values in split_parts(parts, own)}
        return parts.assign({**values, "trust": ("point", trust)})

    def _read(self, simulated: xr.Dataset) -> xr.Dataset:
        """Bodies of a simulated response that were measured, without phases where none were."""
        simulated = simulated.sel(body=self.bodies)
        return simulated if has_phase(self.record) else modulus(simulated)

    @property
    def _rows(self) -> list[int]:
        """Numbers of the rows that are compared: bodies of the first harmonic, of the next one, and so on."""
        own, n = [self.bodies.index(body) for body in self._bodies], len(self.bodies)
        return [order * n + body for order in range(self._orders) for body in own]

    def _points_in_doubt(self) -> np.ndarray:
        """Whether each point (point,) lies apart from those before and after it in its sweep."""
        frequency, found = self.record["frequency"].values, np.zeros(self.record.sizes["point"], dtype=bool)
        own, sigma = (
            values.reshape(-1, frequency.size)[self._rows] for values in (compared_harmonics(self.record), self._sigma)
        )
        for _, points in sweeps(self.record):
            found[points] = in_doubt(own[:, points], sigma[:, points], frequency[points], self._parts)
        return found

    def _trust(self, feet: "_Feet", points: np.ndarray) -> np.ndarray:
        """Factors (k,) in (0, 1] on the distances of k of the points: less than 1 of those in doubt that are far."""
        trust = trust_at(np.square(feet.apart).sum(axis=1), self._parts)
        return np.where(self._in_doubt[points], trust, 1.0)

    def _feet(self, simulated: xr.Dataset) -> Iterator[tuple[np.ndarray, "_Feet"]]:
        """Measured points of each sweep with the nearest ones of its curve."""
        rows = self._rows
        measured = self.record["frequency"].values
        own, of_parts = (
            values.reshape(-1, measured.size)[rows] for values in (compared_harmonics(self.record), self._sigma)
        )
        harmonics = compared_of(complex_harmonics(simulated), simulated["sweep"].values, self.record)
        simulated = with_harmonics(simulated, harmonics)
        target = np.column_stack([measured, own.real.T, own.imag.T])
        sigma = np.column_stack([self._frequency_sigma, of_parts.T, of_parts.T])
        for sweep, points in sweeps(self.record):
            yield points, _nearest(stable_stretches(simulated, sweep), target[points], sigma[points], rows)

    def penalty(self, motion: MotionKind) -> float | None:
        """None: a response is of no kind of motion."""
        return None

    def released(self, *_: object) -> NoReturn:
        """Refuse: a steady response does not depend on its start."""
        raise CalibError(f"{self.name}: a frequency response has no initial state that could be solved for")

    def features(self, pairs: set[tuple[str, str]], sensed: SensedRecord) -> list[FeatureValue]:
        """Scalar features of each body in each sweep, at the measured frequencies where no gross error may be.

        The largest amplitude, where it is, and the rms amplitude of each higher harmonic.
        """
        found: list[FeatureValue] = []
        measured, simulated = np.abs(complex_harmonics(self.record)), np.abs(complex_harmonics(sensed.raw))
        for body in (body for body in self.bodies if any(body == own for own, _ in pairs)):
            row = self.bodies.index(body)
            own = np.array([self._at_measured(sensed.raw, size) for size in simulated[:, row]])
            found += compared(self.name, body, self._peaks(measured[0, row], row), self._peaks(own[0], row))
            known = self._rms_of_harmonics(measured[1:, row], self._higher_sigma[:, row])
            found += compared(self.name, body, known, self._rms_of_harmonics(own[1:], np.zeros(own[1:].shape)))
        return found

    def _rms_of_harmonics(self, own: np.ndarray, sigma: np.ndarray) -> dict[str, Scalar]:
        """Rms amplitude of each higher harmonic (order, n) of a body in each sweep, less that of noise  [m].

        Twice its standard error matters: of a harmonic that is drowned in noise that is as large as what noise hides.

        sigma : (order, n) standard uncertainty of either part  [m]
        """
        parts, at = 2 if has_phase(self.record) else 1, " at one level" if is_held(self.record) else ""
        found: dict[str, Scalar] = {}
        for order, amplitude, noise in zip(harmonic_orders(self.record)[1:], own, sigma, strict=True):
            for sweep, points in self._sweeps_without_doubt:
                by_noise = parts * noise[points] ** 2
                square = np.maximum(amplitude[points] ** 2 - by_noise, 0.0)
                error = float(np.sqrt(np.sum(4.0 * noise[points] ** 2 * square + 2.0 * by_noise * noise[points] ** 2)))
                mean = max(float(np.mean(amplitude[points] ** 2 - by_noise)), 0.0)
                size, reach = np.sqrt(mean), np.sqrt(mean + 2.0 * error / points.size)
                name = f"rms harmonic {order}{at} ({self._sweep_names[sweep]})"
                found[name] = Scalar(float(size), "m", float(reach - size), resolution=0.5 * float(reach - size))
        return found

    def _at_measured(self, simulated: xr.Dataset, size: np.ndarray) -> np.ndarray:
        """Amplitude (n,) at the measured frequencies, linear along the simulated curve of each sweep  [m].

        size : (point,) of the simulated response  [m]
        """
        frequency = simulated["frequency"].values
        curves, own = dict(sweeps(simulated)), np.empty(self.record.sizes["point"])
        for sweep, points in sweeps(self.record):
            along = curves[sweep][np.argsort(frequency[curves[sweep]], kind="stable")]
            own[points] = np.interp(self.record["frequency"].values[points], frequency[along], size[along])
        return own

    def _peaks(self, own: np.ndarray, row: int) -> dict[str, Scalar]:
        """Scalar features of the amplitudes (n,) of a body.

        The frequency is known to the step at which it is, and the amplitude to what it changes over that step on the
        branch it is on, of each of two responses.
        """
        peaks: dict[str, Scalar] = {}
        frequency, (of_frequency, of_parts) = self.record["frequency"].values, tolerances(self.record)
        for sweep, points in self._sweeps_without_doubt:
            place = int(np.argmax(own[points]))
            top, around = points[place], points[max(place - 1, 0) : place + 2]
            step = float(np.abs(np.diff(frequency[around])).mean()) if around.size > 1 else 0.0
            change = float(np.abs(np.diff(own[around])).min()) if around.size > 1 else 0.0
            known, level = (
                float(np.hypot(part / np.sqrt(6.0), sigma))
                for part, sigma in ((step, of_frequency[top]), (change, of_parts[row, top]))
            )
            at = " at one level" if is_held(self.record) else ""
            label = f"largest amplitude{at} ({self._sweep_names[sweep]})"
            peaks[label] = Scalar(float(own[top]), "m", resolution=level)
            peaks[f"frequency of the {label}"] = Scalar(float(frequency[top]), "Hz", resolution=known)
        return peaks


class _Feet(NamedTuple):
    """The points of curves that are nearest to k measured ones.

    Attributes
    ----------
    frequency : (k,) [Hz]
    amplitude : (row, k) complex, of rows as `PreparedResponse` has them  [m]
    apart : (k, 1 + 2 n) measured points less these: frequency, real and imaginary parts of the n compared rows, each
        in its standard uncertainty
    tangent : (k, 1 + 2 n) unit vectors along the curve, likewise, towards higher frequencies
    """

    frequency: np.ndarray
    amplitude: np.ndarray
    apart: np.ndarray
    tangent: np.ndarray


def _nearest(
    curves: Sequence[StableStretch],
    target: np.ndarray,
    sigma: np.ndarray,
    rows: Sequence[int],
) -> _Feet:
    """Points of the curves that are nearest to k measured ones.

    target, sigma : (k, 1 + 2 n) frequency, real parts and imaginary parts of n compared rows, and their uncertainties
    """
    every = (curves[0].points.shape[1] - 1) // 2
    columns = [0, *(1 + row for row in rows), *(1 + every + row for row in rows)]
    best, foot, ahead = np.full(len(target), np.inf), *np.zeros((2, len(target), curves[0].points.shape[1]))
    for along, spline, points in curves:
        fine = np.interp(
            np.arange(SAMPLES_PER_INTERVAL * (along.size - 1) + 1) / SAMPLES_PER_INTERVAL, np.arange(along.size), along
        )
        sampled = _at(fine, along, spline, points)
        place = np.argmin(_squares(sampled[:, columns], target, sigma), axis=1)
        low, high = np.maximum(place - 1, 0), np.minimum(place + 1, fine.size - 1)
        own, onward = sampled[place], sampled[high] - sampled[low]
        if spline is not None:
            at = _foot_parameters(spline, fine[place], (fine[low], fine[high]), columns, target, sigma)
            own, onward = spline(at), spline(at, 1)
        distance = (((own[:, columns] - target) / sigma) ** 2).sum(axis=1)
        nearer = distance < best
        best[nearer], foot[nearer], ahead[nearer] = distance[nearer], own[nearer], onward[nearer]
    tangent = ahead[:, columns] / sigma
    length = np.linalg.norm(tangent, axis=1, keepdims=True)
    tangent = np.divide(tangent, length, out=np.zeros_like(tangent), where=length > 0.0)
    tangent[length[:, 0] == 0.0, 0] = 1.0
    tangent *= np.copysign(1.0, tangent[:, :1])
    amplitude = foot[:, 1 : 1 + every] + 1j * foot[:, 1 + every :]
    return _Feet(foot[:, 0], amplitude.T, (target - foot[:, columns]) / sigma, tangent)


def _squares(sampled: np.ndarray, target: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Squared distances (k, s) of k measured points from s of a curve."""
    squares = np.zeros((len(target), len(sampled)))
    for own, wanted, uncertainty in zip(sampled.T, target.T, sigma.T, strict=True):
        squares += ((own - wanted[:, None]) / uncertainty[:, None]) ** 2
    return squares


def _turned(vectors: np.ndarray, tangents: np.ndarray) -> np.ndarray:
    """Turn vectors (k, d) by the rotations that take unit tangents of no negative first component to the first axis.

    In the plane of each, by I + K + K^2 / (1 + cos a) with K = e t' - t e' and a the angle between them.
    """

    def swung(own: np.ndarray) -> np.ndarray:
        swing = -own[:, :1] * tangents
        swing[:, 0] += (tangents * own).sum(axis=1)
        return swing

    once = swung(vectors)
    return vectors + once + swung(once) / (1.0 + tangents[:, :1])


def _at(fine: np.ndarray, along: np.ndarray, spline: CubicSpline | None, points: np.ndarray) -> np.ndarray:
    if spline is not None:
        return np.asarray(spline(fine))
    return np.column_stack([np.interp(fine, along, column) for column in points.T])


def _foot_parameters(
    spline: CubicSpline,
    at: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    columns: list[int],
    target: np.ndarray,
    sigma: np.ndarray,
) -> np.ndarray:
    """Parameters (k,) of the nearest points of a spline within bounds, by Newton's method on the squared distances."""
    for _ in range(MAX_FOOT_STEPS):
        apart, slope, bend = (spline(at, order)[:, columns] for order in range(3))
        apart, slope, bend = (apart - target) / sigma, slope / sigma, bend / sigma
        square = (slope**2).sum(axis=1)
        curvature = square + (apart * bend).sum(axis=1)
        curvature = np.where(curvature > 0.0, curvature, square)
        descent = (slope * apart).sum(axis=1)
        step = np.divide(descent, curvature, out=np.zeros_like(at), where=curvature > 0.0)
        at = np.clip(at - step, *bounds)
    return at
