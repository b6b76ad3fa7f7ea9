"""Frequency responses by harmonic balance: the fast path where forces are functions of displacement and velocity.

What is followed are Fourier series (see `calib.dynamics.harmonic_balance`) in place of cycles of the period map. They
have the period of the excitation; branches end where the motion reaches a rigid stop, whose impacts no series of a few
harmonics describes. How much the harmonics that are left out change the motion is measured by shooting from it.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from calib.dynamics.arclength import CLOSED, Mark, near, root, roots, run
from calib.dynamics.branch import TESTS, Branch, Special, evidence
from calib.dynamics.harmonic_balance import HarmonicBalance
from calib.dynamics.orbits import newton, shoot
from calib.dynamics.response import (
    AMPLITUDE,
    FREQUENCY,
    AmplitudeAt,
    FrequencyResponse,
    Irregular,
    ResponseBranch,
    Truncation,
    check_window,
    constant,
)
from calib.dynamics.setting import Setting
from calib.errors import CalibError
from calib.modelling.modal_system import ModalMap

MAX_FIRST_STEPS = 30  # of Newton's method from the linear motion, or from the motion at a frequency beside it
SAME_SERIES_DISTANCE = 1e-6  # between coefficients, in units of the scale
MIN_SIZE_RATIO, MAX_SIZE_RATIO = 0.2, 2.0  # of the motions of a branch over that by which its steps were chosen
MAX_RESCALINGS = 4  # of the steps of a branch
SIZE_FREQUENCIES = 200  # of the linear motion whose largest is the first idea of the size
DIFFERENCE = 1e-6  # of the window, for the derivative by the frequency
MOTIONS_CHECKED = 5  # of each branch, by shooting
CLEARANCE_STEPS = 3  # of Newton's method to the instant of the least clearance
TOUCHING = "with impacts"  # kind of a motion that no series is sought of
AT_STOP = "the motion reaches the stop, whose impacts harmonic balance does not serve"


def balanced_response(
    setting: Setting,
    window: tuple[float, float],
    levels: Sequence[float],
    *,
    harmonics: int = 7,
    steps: int = 17,
    most: int = 400,
    amplitude: AmplitudeAt = constant,
    on_level: Callable[[float, int], None] = lambda level, done: None,
) -> FrequencyResponse:
    """Response of the motions that have the period of the excitation, by harmonic balance.

    Parameters
    ----------
    setting : whose period map tells its modal system: four_dof and oscillator out of contact or with a compliant stop
    harmonics : of the series
    steps : frequencies at which motions are sought that the branches begin with
    window, levels, most, amplitude, on_level : as those of `calib.dynamics.response.frequency_response`

    Raises
    ------
    CalibError : as there, or forces that harmonic balance does not serve: with internal states, effects on the
        excitation, a loss by the closing speed
    """
    check_window(window, levels, harmonics, steps)
    unit_level = max(levels)
    map = setting.map({FREQUENCY: math.sqrt(window[0] * window[1]), AMPLITUDE: unit_level})
    if not isinstance(map, ModalMap):
        raise CalibError(
            f"the period map of {setting.model.name!r} does not tell its modal system, which harmonic balance is of; "
            "take shooting"
        )
    balance = HarmonicBalance(map.modal_system(), harmonics)
    branches: list[ResponseBranch] = []
    irregular: list[Irregular] = []
    left_out = Truncation(harmonics, 0.0, math.nan, math.nan)
    for done, level in enumerate(sorted(set(levels))):
        on_level(level, done)
        search = _SeriesSearch(setting, balance, window, unit_level, level, steps, most, amplitude)
        search.search()
        branches += search.branches
        irregular += search.irregular
        left_out = max([left_out, *search.checks], key=lambda check: check.largest)
    return FrequencyResponse(map.bodies, window, setting.unit(AMPLITUDE), tuple(branches), tuple(irregular), left_out)


class _Motion(NamedTuple):
    """Motion of a curve: coefficients and parameter z (d,), tangent, multipliers, derivative, least clearance [m]."""

    z: np.ndarray
    tangent: np.ndarray
    multipliers: np.ndarray
    matrix: np.ndarray
    corrections: int
    clearance: float


@dataclass(frozen=True, eq=False)
class _SeriesCurve:
    """The curve of motions over the frequency at one level, as `calib.dynamics.arclength.SolutionCurve`.

    Attributes
    ----------
    scale : of the coefficients  [kg^1/2 m]
    drive : amplitude of U at a frequency [Hz]
    """

    balance: HarmonicBalance
    low: float
    high: float
    scale: float
    drive: Callable[[float], float]
    parameters: int = 1

    def parameter(self, z: np.ndarray) -> float:
        return float((1.0 - z[-1]) * self.low + z[-1] * self.high)  # exact at both edges

    def unpacked(self, z: np.ndarray) -> tuple[np.ndarray, float, float]:
        """Coefficients, angular frequency [rad/s] and amplitude of U."""
        frequency = self.parameter(z)
        return self.scale * z[:-1].reshape(-1, self.balance.size), 2.0 * math.pi * frequency, self.drive(frequency)

    def packed(self, y: np.ndarray, frequency: float) -> np.ndarray:
        return np.append(y.ravel() / self.scale, (frequency - self.low) / (self.high - self.low))

    @cached_property
    def _units(self) -> np.ndarray:
        """Size (n (2 H + 1),) of the terms of each equation."""
        largest = np.maximum(np.abs(self.balance.system.stiffness), (2.0 * math.pi * self.high) ** 2)
        return self.scale * np.repeat(largest, self.balance.size)

    def residual(self, z: np.ndarray) -> np.ndarray:
        return self.balance.residual(*self.unpacked(z)).ravel() / self._units

    def derivative(self, z: np.ndarray) -> np.ndarray:
        by_coefficients = self.balance.derivative(*self.unpacked(z)) * (self.scale / self._units[:, None])
        step = np.append(np.zeros(z.size - 1), DIFFERENCE)
        by_frequency = (self.residual(z + step) - self.residual(z - step)) / (2.0 * DIFFERENCE)
        return np.column_stack([by_coefficients, by_frequency])

    def point(self, z: np.ndarray, steps: tuple[float, ...], heading: np.ndarray) -> _Motion | None:
        matrix = self.derivative(z)
        if not np.isfinite(matrix).all():
            return None
        tangent = _null_vector(matrix, heading)
        multipliers = self.balance.multipliers(*self.unpacked(z))
        return _Motion(z, tangent, multipliers, matrix, len(steps) - 1, self._clearance(z))

    def obstacle(self, base: _Motion, point: _Motion) -> str:
        return ""

    def marks(self, base: _Motion, ahead: _Motion) -> list[Mark[_Motion]] | None:
        touch = None
        if ahead.clearance < 0.0:
            touch = root(self, base, ahead, lambda point, _: point.clearance)
            if touch is None:
                return None
        located = roots(self, base, touch or ahead, TESTS)
        if located is None:
            return None
        marks = [Mark(kind, point, evidence(kind, point)) for kind, point in located]
        marks = [mark for mark in marks if mark.evidence]
        return [*marks, Mark("grazing", touch, AT_STOP, last=True)] if touch else marks

    def where(self, point: _Motion) -> str:
        return f"{self.parameter(point.z):g}"

    def _clearance(self, z: np.ndarray) -> float:
        """Least clearance of a rigid stop along the motion [m], inf without one."""
        stop = self.balance.system.clearance
        if stop is None:
            return math.inf
        y, _, amplitude = self.unpacked(z)
        series = (stop.shape @ y)[0]
        series[0] += stop.mean[0]
        series[1] += stop.drive[0] * amplitude
        slope = self.balance.slope(series)
        curvature = self.balance.slope(slope)
        phase = self.balance.phase[np.argmin(self.balance.at(series, self.balance.phase))]
        for _ in range(CLEARANCE_STEPS):
            rise, bend = self.balance.at(np.stack([slope, curvature]), np.array([phase]))[:, 0]
            if bend <= 0.0:
                break
            phase -= np.clip(rise / bend, -self.balance.phase[1], self.balance.phase[1])
        return float(self.balance.at(series, np.array([phase]))[0])


def _null_vector(matrix: np.ndarray, heading: np.ndarray) -> np.ndarray:
    """Unit vector (d,) that the matrix (d - 1, d) takes to zero, along `heading` (d,)."""
    try:
        vector = np.linalg.solve(np.vstack([matrix, heading]), np.eye(heading.size)[-1])
        vector /= np.linalg.norm(vector)
    except np.linalg.LinAlgError:
        vector = np.linalg.svd(matrix)[2][-1]
    return vector if vector @ heading >= 0.0 else -vector


class _SeriesSearch:
    """Branches at one level."""

    def __init__(
        self,
        setting: Setting,
        balance: HarmonicBalance,
        window: tuple[float, float],
        unit_level: float,
        level: float,
        steps: int,
        most: int,
        amplitude: AmplitudeAt,
    ) -> None:
        self.setting, self.balance, self.window, self.level, self.most = setting, balance, window, level, most
        self.amplitude = amplitude
        self.frequencies = np.linspace(*window, steps)
        self.per_unit = balance.system.amplitude / unit_level
        sizes = [np.abs(self._linear(frequency)).max() for frequency in np.linspace(*window, SIZE_FREQUENCIES).tolist()]
        self.scale = max(sizes) or 1.0
        self.curves: list[tuple[_SeriesCurve, list[_Motion]]] = []
        self.branches: list[ResponseBranch] = []
        self.irregular: list[Irregular] = []
        self.checks: list[Truncation] = []

    def drive(self, frequency: float) -> float:
        return self.per_unit * self.amplitude(self.level, frequency)

    def curve(self) -> _SeriesCurve:
        return _SeriesCurve(self.balance, *self.window, self.scale, self.drive)

    def search(self) -> None:
        """Follow what Newton's method finds from the linear motion, and from the motions beside it, up and down."""
        for direction in (self.frequencies, self.frequencies[::-1]):
            y = None
            for frequency in direction.tolist():
                for guess in [self._linear(frequency)] if y is None else [y, self._linear(frequency)]:
                    found = self._solved(guess, frequency)
                    if found is not None:
                        y = found if y is None or guess is y else y
                        self._follow(found, frequency)

    def _linear(self, frequency: float) -> np.ndarray:
        return self.balance.linear_motion(2.0 * math.pi * frequency, self.drive(frequency))

    def _solved(self, guess: np.ndarray, frequency: float) -> np.ndarray | None:
        """Coefficients of a motion at a frequency, near a guess."""
        curve = self.curve()
        at = curve.packed(guess, frequency)[-1]
        z, _, reason = newton(
            lambda u: curve.residual(np.append(u, at)),
            lambda u: curve.derivative(np.append(u, at))[:, :-1],
            curve.packed(guess, frequency)[:-1],
            MAX_FIRST_STEPS,
        )
        return None if reason else curve.scale * z.reshape(guess.shape)

    def _follow(self, y: np.ndarray, frequency: float) -> None:
        if self._is_known(y, frequency):
            return
        for _ in range(MAX_RESCALINGS):
            curve = self.curve()
            z = curve.packed(y, frequency)
            start = curve.point(z, (0.0,), np.eye(z.size)[-1])
            if start is None:
                return
            if start.clearance < 0.0:
                self._note_impacts(frequency)
                return
            motions, specials, ends = self._both_ways(curve, start)
            size = max(np.abs(motion.z[:-1]).max() for motion in motions)
            if MIN_SIZE_RATIO <= size <= MAX_SIZE_RATIO:
                break
            self.scale *= size
        self.curves.append((curve, motions))
        branch = self._branch(curve, motions, specials, ends)
        self.branches.append(self._response(curve, motions, branch))
        self.checks += self._checks(curve, motions, branch)

    def _both_ways(self, curve: _SeriesCurve, start: _Motion) -> tuple[list[_Motion], list[Special], tuple[str, str]]:
        onward = run(curve, start, self.most)
        if onward.reason == CLOSED:
            return onward.points, self._specials(curve, onward.marks), (CLOSED, CLOSED)
        back = run(curve, start._replace(tangent=-start.tangent), self.most)
        shift = len(back.points) - 1
        marks = [(shift - index, mark) for index, mark in back.marks[::-1]]
        marks += [(shift + index, mark) for index, mark in onward.marks]
        motions = [*back.points[:0:-1], *onward.points]
        return motions, self._specials(curve, marks), (back.reason, onward.reason)

    def _specials(self, curve: _SeriesCurve, marks: list[tuple[int, Mark[_Motion]]]) -> list[Special]:
        return [
            Special(mark.kind, curve.parameter(mark.point.z), self._state(curve, mark.point.z), index, mark.evidence)
            for index, mark in marks
        ]

    def _state(self, curve: _SeriesCurve, z: np.ndarray) -> np.ndarray:
        """State (2 d,) of the period map at its section  [m], [m/s]."""
        displacement, velocity = self._at_section(curve, z)
        free = list(self.balance.system.free)
        return np.concatenate([displacement[free], velocity[free]])

    def _at_section(self, curve: _SeriesCurve, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Displacement and velocity (body,) at the section  [m], [m/s]."""
        y, omega, amplitude = curve.unpacked(z)
        series, phase = self.balance.bodies(y, amplitude), np.array([self.balance.system.phase])
        return self.balance.at(series, phase)[:, 0], omega * self.balance.at(self.balance.slope(series), phase)[:, 0]

    def _is_known(self, y: np.ndarray, frequency: float) -> bool:
        """Whether a motion is on a branch that is followed already."""
        for curve, motions in self.curves:
            own = curve.packed(y, frequency)
            for one, other in zip(motions[:-1], motions[1:], strict=True):
                offsets = one.z[-1] - own[-1], other.z[-1] - own[-1]
                if offsets[0] * offsets[1] <= 0.0:
                    normal, reach = np.eye(own.size)[-1], 2.0 * float(np.linalg.norm(other.z - one.z))
                    share = offsets[0] / (offsets[0] - offsets[1]) if offsets[0] != offsets[1] else 0.0
                    guess = (1.0 - share) * one.z + share * other.z
                    point, _ = near(curve, guess, normal, one.tangent, reach)
                    if point is not None and np.abs(point.z - own).max() < SAME_SERIES_DISTANCE:
                        return True
        return False

    def _note_impacts(self, frequency: float) -> None:
        if not any(met.frequency == frequency for met in self.irregular):
            self.irregular.append(Irregular(self.level, frequency, TOUCHING, AT_STOP))

    def _branch(
        self, curve: _SeriesCurve, motions: list[_Motion], specials: list[Special], ends: tuple[str, str]
    ) -> Branch:
        map = self.setting.map({FREQUENCY: self.window[0], AMPLITUDE: self.level})
        sections = np.array([self._at_section(curve, motion.z) for motion in motions])
        count = len(motions)
        return Branch(
            periods=1,
            bodies=tuple(map.bodies),
            names=tuple(map.names),
            units=tuple(map.units),
            parameter=np.array([curve.parameter(motion.z) for motion in motions]),
            displacement=sections[:, 0].T[:, None, :],
            velocity=sections[:, 1].T[:, None, :],
            states=np.array([self._state(curve, motion.z) for motion in motions]),
            multipliers=np.array([motion.multipliers for motion in motions]),
            stable=np.array([abs(motion.multipliers[0]) < 1.0 for motion in motions]),
            impacts=np.zeros(count, dtype=int),
            slowest=np.full(count, math.inf),
            nearest=np.array([motion.clearance for motion in motions]),
            points=tuple(specials),
            ends=ends,
        )

    def _response(self, curve: _SeriesCurve, motions: list[_Motion], branch: Branch) -> ResponseBranch:
        series = np.array([self.balance.bodies(y, a) for y, _, a in (curve.unpacked(motion.z) for motion in motions)])
        values = self.balance.at(series, self.balance.phase)
        # the drive's phase may be turned against that of the excitation: by a factor on it that is negative
        begin = self.setting.excitation.phase + 2.0 * math.pi * self.setting.phase
        turn = np.exp(1j * np.arange(self.balance.harmonics + 1) * (self.balance.system.phase - begin))
        harmonics = self.balance.complex_amplitudes(series) * turn
        return ResponseBranch(
            self.level, branch, np.moveaxis(harmonics, 0, -1), 0.5 * np.ptp(values, axis=-1).T
        )  # fmt: skip

    def _checks(self, curve: _SeriesCurve, motions: list[_Motion], branch: Branch) -> Iterator[Truncation]:
        """Yield what shooting makes of some motions: the change of the state at the section over the motion's size."""
        grazing = [point.index for point in branch.points if point.kind == "grazing"]
        candidates = np.setdiff1d(np.arange(len(motions)), grazing)
        places = candidates[np.unique(np.linspace(0, candidates.size - 1, MOTIONS_CHECKED).astype(int))]
        for place in places.tolist():
            frequency = float(branch.parameter[place])
            map = self.setting.map({FREQUENCY: frequency, AMPLITUDE: self.amplitude(self.level, frequency)})
            cycle = shoot(map, branch.states[place], 1)
            y, omega, amplitude = curve.unpacked(motions[place].z)
            series = self.balance.bodies(y, amplitude)[list(self.balance.system.free)]
            values = [self.balance.at(one, self.balance.phase) for one in (series, omega * self.balance.slope(series))]
            size = np.concatenate([0.5 * np.ptp(value, axis=-1) for value in values])
            change = np.abs(cycle.state - branch.states[place]) if cycle.converged else math.inf
            size = np.where(size > 0.0, size, 1.0)
            yield Truncation(self.balance.harmonics, float(np.max(change / size)), self.level, frequency)
