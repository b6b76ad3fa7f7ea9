"""Frequency responses by harmonic balance: the fast path where forces are functions of displacement and velocity.

What is followed are Fourier series (see `calib.dynamics.harmonic_balance`) in place of cycles of the period map. They
have the period of the excitation; branches end where the motion reaches a rigid stop, whose impacts no series of a few
harmonics describes. How much the harmonics that are left out change the motion is measured by shooting from it.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from calib.dynamics.arclength import CLOSED, Mark, near, run
from calib.dynamics.branch import Branch, Special
from calib.dynamics.harmonic_balance import HarmonicBalance
from calib.dynamics.orbits import shoot
from calib.dynamics.response import (
    AMPLITUDE,
    FREQUENCY,
    AmplitudeAt,
    FrequencyResponse,
    Irregular,
    LevelKeeper,
    ResponseBranch,
    Truncation,
    as_measured,
    check_window,
    constant,
    followed_anew,
)
from calib.dynamics.series_curve import (
    AT_STOP,
    SeriesCurve,
    SeriesMotion,
    at_own_scale,
    linear_size,
    modal_system,
)
from calib.dynamics.setting import Setting

SAME_SERIES_DISTANCE = 1e-6  # between coefficients, in units of the scale
MOTIONS_CHECKED = 5  # of each branch, by shooting
TOUCHING = "with impacts"  # kind of a motion that no series is sought of


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
    keep: LevelKeeper = followed_anew,
) -> FrequencyResponse:
    """Response of the motions that have the period of the excitation, by harmonic balance.

    Parameters
    ----------
    setting : whose period map tells its modal system: four_dof and oscillator out of contact or with a compliant stop
    harmonics : of the series
    steps : frequencies at which motions are sought that the branches begin with
    window, levels, most, amplitude, on_level, keep : as those of `calib.dynamics.response.frequency_response`; the
        result of a level depends on the highest one too, by round-off

    Raises
    ------
    CalibError : as there, or forces that harmonic balance does not serve: a loss by the closing speed
    """
    check_window(window, levels, harmonics, steps)
    unit_level = max(levels)
    middle = math.sqrt(window[0] * window[1])
    bodies = setting.map({FREQUENCY: middle, AMPLITUDE: unit_level}).bodies
    balance = HarmonicBalance(modal_system(setting, middle, unit_level), harmonics)
    branches: list[ResponseBranch] = []
    irregular: list[Irregular] = []
    left_out = Truncation(harmonics, 0.0, math.nan, math.nan)

    def followed(level: float) -> tuple[list[ResponseBranch], list[Irregular], list[Truncation]]:
        search = _SeriesSearch(setting, balance, window, unit_level, level, steps, most, amplitude)
        search.search()
        return search.branches, search.irregular, search.checks

    for done, level in enumerate(sorted(set(levels))):
        on_level(level, done)
        own, others, checks = keep(level, partial(followed, level))
        branches += own
        irregular += others
        left_out = max([left_out, *checks], key=lambda check: check.largest)
    return FrequencyResponse(bodies, window, setting.unit(AMPLITUDE), tuple(branches), tuple(irregular), left_out)


class _Followed(NamedTuple):
    """A curve, its motions, the special points on it, and why it ends either way."""

    curve: SeriesCurve
    motions: list[SeriesMotion]
    specials: list[Special]
    ends: tuple[str, str]


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
        self.scale = linear_size(balance, window, self.drive)
        self.curves: list[tuple[SeriesCurve, list[SeriesMotion]]] = []
        self.branches: list[ResponseBranch] = []
        self.irregular: list[Irregular] = []
        self.checks: list[Truncation] = []

    def drive(self, frequency: float) -> float:
        return self.per_unit * self.amplitude(self.level, frequency)

    def curve(self, scale: float) -> SeriesCurve:
        return SeriesCurve(self.balance, *self.window, scale, self.drive)

    def search(self) -> None:
        """Follow what Newton's method finds from the linear motion, and from the motions beside it, up and down."""
        for direction in (self.frequencies, self.frequencies[::-1]):
            y = None
            for frequency in direction.tolist():
                for guess in [self._linear(frequency)] if y is None else [y, self._linear(frequency)]:
                    found = self.curve(self.scale).solved(guess, frequency)
                    if found is not None:
                        y = found if y is None or guess is y else y
                        self._follow(found, frequency)

    def _linear(self, frequency: float) -> np.ndarray:
        return self.balance.linear_motion(2.0 * math.pi * frequency, self.drive(frequency))

    def _follow(self, y: np.ndarray, frequency: float) -> None:
        if self._is_known(y, frequency):
            return
        found = at_own_scale(self.scale, partial(self._followed, y, frequency))
        if found is None:
            return
        self.scale = found.curve.scale
        self.curves.append((found.curve, found.motions))
        branch = self._branch(*found)
        self.branches.append(self._response(found.curve, found.motions, branch))
        self.checks += self._checks(found.curve, found.motions, branch)

    def _followed(self, y: np.ndarray, frequency: float, scale: float) -> tuple[_Followed, list[SeriesMotion]] | None:
        """Follow the motion at a frequency both ways, with steps by a scale; None where it cannot be or has impacts."""
        curve = self.curve(scale)
        start = curve.start(y, frequency)
        if start is None:
            return None
        if start.clearance < 0.0:
            self._note_impacts(frequency)
            return None
        motions, specials, ends = self._both_ways(curve, start)
        return _Followed(curve, motions, specials, ends), motions

    def _both_ways(
        self, curve: SeriesCurve, start: SeriesMotion
    ) -> tuple[list[SeriesMotion], list[Special], tuple[str, str]]:
        onward = run(curve, start, self.most)
        if onward.reason == CLOSED:
            return onward.points, self._specials(curve, onward.marks), (CLOSED, CLOSED)
        back = run(curve, start._replace(tangent=-start.tangent), self.most)
        shift = len(back.points) - 1
        marks = [(shift - index, mark) for index, mark in back.marks[::-1]]
        marks += [(shift + index, mark) for index, mark in onward.marks]
        motions = [*back.points[:0:-1], *onward.points]
        return motions, self._specials(curve, marks), (back.reason, onward.reason)

    def _specials(self, curve: SeriesCurve, marks: list[tuple[int, Mark[SeriesMotion]]]) -> list[Special]:
        return [
            Special(mark.kind, curve.parameter(mark.point.z), curve.state(mark.point.z), index, mark.evidence)
            for index, mark in marks
        ]

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
        self, curve: SeriesCurve, motions: list[SeriesMotion], specials: list[Special], ends: tuple[str, str]
    ) -> Branch:
        map = self.setting.map({FREQUENCY: self.window[0], AMPLITUDE: self.level})
        sections = np.array([curve.at_section(motion.z) for motion in motions])
        count = len(motions)
        return Branch(
            periods=1,
            bodies=tuple(map.bodies),
            names=tuple(map.names),
            units=tuple(map.units),
            parameter=np.array([curve.parameter(motion.z) for motion in motions]),
            displacement=sections[:, 0].T[:, None, :],
            velocity=sections[:, 1].T[:, None, :],
            states=np.array([curve.state(motion.z) for motion in motions]),
            multipliers=np.array([motion.multipliers for motion in motions]),
            stable=np.array([motion.stable for motion in motions]),
            impacts=np.zeros(count, dtype=int),
            slowest=np.full(count, math.inf),
            nearest=np.array([motion.clearance for motion in motions]),
            points=tuple(specials),
            ends=ends,
        )

    def _response(self, curve: SeriesCurve, motions: list[SeriesMotion], branch: Branch) -> ResponseBranch:
        series = np.array([self.balance.bodies(y, a) for y, _, a in (curve.unpacked(motion.z) for motion in motions)])
        values = self.balance.at(series, self.balance.phase)
        begin = self.setting.section_phase
        harmonics = np.array([curve.complex_amplitudes(motion.z, begin) for motion in motions])
        peak = 0.5 * np.ptp(values, axis=-1).T
        followed = ResponseBranch(self.level, branch, np.moveaxis(harmonics, 0, -1), peak)
        return as_measured(self.setting, followed, self.amplitude)

    def _checks(self, curve: SeriesCurve, motions: list[SeriesMotion], branch: Branch) -> Iterator[Truncation]:
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
            moved = slice(0, size.size)  # internal states of forces follow from the motion
            change = np.abs(cycle.state - branch.states[place])[moved] if cycle.converged else math.inf
            size = np.where(size > 0.0, size, 1.0)
            yield Truncation(self.balance.harmonics, float(np.max(change / size)), self.level, frequency)
