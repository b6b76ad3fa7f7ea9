"""Frequency responses: periodic motions under a harmonic excitation followed over its frequency, level by level.

At a level of the excitation the stable motions of a coarse stepped sweep up and down are each followed over the
frequency by pseudo-arclength continuation, through folds and where they are unstable. A branch ends where an impact
grazes; what the motion settles to beyond is followed, too.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple, Protocol, TypeVar

import numpy as np

from calib.dynamics.branch import Branch, follow
from calib.dynamics.orbit_kind import OrbitKind
from calib.dynamics.orbits import shoot
from calib.dynamics.setting import Setting
from calib.dynamics.single_run import kind_of_run
from calib.errors import CalibError
from calib.modelling.orbit import PeriodMap, SampledMap
from calib.records import OK
from calib.records.response import complex_harmonics, make_response

HARMONIC_SAMPLES = 1024  # of the motion whose harmonics are taken: where it has kinks they are exact to some 1e-6
MAX_BRANCHES = 32  # of one level
MAX_SUBHARMONIC = 8  # periods after which a motion returns that is followed
BEYOND_GRAZING = 2e-3  # of the window: how far beyond a grazing the motion is sought that comes after it
MAX_EXTENT_RATIO = 2.0  # of the motions of a branch over that by which its steps were chosen
SAME_CYCLE_DISTANCE = 1e-4  # in units of the map's scale: between a motion and a branch that it is on
LEVEL_FREQUENCIES = 7  # of a branch at which it is followed over the level, where isolas are sought
MAX_LEVEL_POINTS = 120  # one way, of such a curve
MAX_LEVEL_RATIO = 3.0  # of the highest level of such a curve over that at which isolas are sought

FREQUENCY, AMPLITUDE = "excitation.frequency", "excitation.amplitude"
AmplitudeAt = Callable[[float, float], float]
T = TypeVar("T")


def constant(level: float, frequency: float) -> float:
    """Return the level: the amplitude of an excitation that is the same at all frequencies."""
    return level


@dataclass(frozen=True, eq=False)
class ResponseBranch:
    """Periodic motions of one branch at one level of the excitation, m of them.

    Attributes
    ----------
    level : amplitude of the excitation, in its unit
    branch : over the frequency [Hz], with stability and special points
    harmonics : (body, harmonic, m) complex amplitudes H_0 (the mean), H_1, ... of the displacement: it is the real part
        of the sum of H_k exp(i k (2 pi F t + phase)) where the excitation is A cos(2 pi F t + phase)  [m]; those
        above the mean, of which a measured response is, as effects at the site "response" have them measured, all else
        of the motion itself
    peak : (body, m) half of the displacement from its lowest to its highest value  [m]
    isolated : whether continuation in the level has found it, and the sweep has not
    """

    level: float
    branch: Branch
    harmonics: np.ndarray
    peak: np.ndarray
    isolated: bool = False

    @property
    def frequency(self) -> np.ndarray:
        """Frequency (m,) of the excitation [Hz]."""
        return self.branch.parameter


@dataclass(frozen=True)
class Irregular:
    """A motion of the coarse sweep that is followed by no branch: its place and kind, and the sentence on it."""

    level: float
    frequency: float
    kind: str
    evidence: str


class Truncation(NamedTuple):
    """How much the harmonics that a series leaves out change the motion.

    Attributes
    ----------
    harmonics : of the series
    largest : change of the state at the section by shooting from the motion, over the motion's size, where it is
        largest of the motions that were looked at  [1]; inf where shooting finds no motion there
    level, frequency : where that is
    """

    harmonics: int
    largest: float
    level: float
    frequency: float


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Responses over one window of frequencies at one or more levels.

    Attributes
    ----------
    bodies : in the order of the harmonics
    window : lowest and highest frequency  [Hz]
    unit : of the levels
    branches : by rising level; at each in the order in which they were found
    irregular : motions of the sweep that do not return, or too late
    truncation : of the series, where the motions are found by harmonic balance
    """

    bodies: tuple[str, ...]
    window: tuple[float, float]
    unit: str
    branches: tuple[ResponseBranch, ...]
    irregular: tuple[Irregular, ...]
    truncation: Truncation | None = None

    def at(self, level: float) -> tuple[ResponseBranch, ...]:
        """Branches at one level."""
        return tuple(branch for branch in self.branches if branch.level == level)

    @property
    def levels(self) -> tuple[float, ...]:
        """Levels that there are branches at, the lowest first."""
        return tuple(sorted({branch.level for branch in self.branches}))


class LevelKeeper(Protocol):
    """Returns what is followed at a level, be it kept from before."""

    def __call__(self, level: float, follow: Callable[[], T]) -> T:
        """Result of `follow` at a level."""


def followed_anew(level: float, follow: Callable[[], T]) -> T:
    """Result of `follow`, kept nowhere."""
    return follow()


def frequency_response(
    setting: Setting,
    window: tuple[float, float],
    levels: Sequence[float],
    *,
    harmonics: int = 3,
    steps: int = 17,
    most: int = 400,
    isolas: bool = False,
    amplitude: AmplitudeAt = constant,
    on_level: Callable[[float, int], None] = lambda level, done: None,
    keep: LevelKeeper = followed_anew,
) -> FrequencyResponse:
    """Response of the periodic motions over the frequency of the excitation at each level.

    Parameters
    ----------
    setting : whose simulator samples the motion between the sections
    window : lowest and highest frequency  [Hz]
    levels : amplitudes of the excitation, in its unit
    harmonics : the highest that is kept
    steps : frequencies of the coarse sweep
    most : points one way of a branch
    isolas : whether each branch is followed over the level, too, at some frequencies: curves apart from those that a
        sweep comes to are found where they are connected with it at another level, up to three times as high
    amplitude : of the excitation at a level and a frequency [Hz], in its unit: a shaker that is held at an amplitude of
        acceleration or a force that sags at resonance has another one at each frequency
    on_level : called as the work on a level begins, with the number of those that are done
    keep : may return the result of a level from before; it depends on all that is given here but the other levels

    Raises
    ------
    CalibError : a window without width or with frequencies that are none, no level or one that is not positive, less
        than one harmonic or two steps, or a simulator that does not sample its motion
    """
    check_window(window, levels, harmonics, steps)
    sampled(setting, setting.map())
    branches: list[ResponseBranch] = []
    irregular: list[Irregular] = []

    def followed(level: float) -> tuple[list[ResponseBranch], list[Irregular]]:
        search = _LevelSearch(setting, window, level, steps, most, amplitude)
        search.sweep()
        found = len(search.branches)
        if isolas:
            search.continue_in_level()
        own = [
            _response(setting, level, branch, harmonics, amplitude, isolated=i >= found)
            for i, branch in enumerate(search.branches)
        ]
        return own, search.irregular

    for done, level in enumerate(sorted(set(levels))):
        on_level(level, done)
        own, others = keep(level, partial(followed, level))
        branches += own
        irregular += others
    return FrequencyResponse(setting.map().bodies, window, setting.unit(AMPLITUDE), tuple(branches), tuple(irregular))


def check_window(window: tuple[float, float], levels: Sequence[float], harmonics: int, steps: int) -> None:
    """Check what a response is asked for.

    Raises
    ------
    CalibError : as `frequency_response`, but for the simulator
    """
    low, high = window
    if not (np.isfinite([low, high]).all() and 0.0 < low < high):
        raise CalibError(f"expected frequencies from a positive one to a higher one [Hz], got {low:g} .. {high:g}")
    if not levels or not all(np.isfinite(level) and level > 0.0 for level in levels):
        raise CalibError(f"expected one or more positive levels, got {list(levels)}")
    if harmonics < 1 or steps < 2:
        raise CalibError(f"expected at least 1 harmonic and 2 steps, got {harmonics} and {steps}")


def sampled(setting: Setting, map: PeriodMap) -> SampledMap:
    """Return the map where it samples the motion between its sections.

    Raises
    ------
    CalibError : it does not
    """
    if not isinstance(map, SampledMap):
        raise CalibError(
            f"the period map of {setting.model.name!r} does not tell the motion between its sections, of which the "
            "harmonics of a response are taken; let it have `motion`, see calib.modelling.orbit.SampledMap"
        )
    return map


class _LevelSearch:
    """Branches at one level."""

    def __init__(
        self,
        setting: Setting,
        window: tuple[float, float],
        level: float,
        steps: int,
        most: int,
        amplitude: AmplitudeAt,
    ) -> None:
        self.setting, self.window, self.level, self.most, self.amplitude = setting, window, level, most, amplitude
        self.frequencies = np.linspace(*window, steps)
        self.extent = 1.0  # of the motions of the sweep, in units of the map's scale
        self.branches: list[Branch] = []
        self.irregular: list[Irregular] = []

    def map(self, frequency: float, level: float | None = None) -> PeriodMap:
        amplitude = self.amplitude(self.level if level is None else level, frequency)
        return self.setting.map({FREQUENCY: frequency, AMPLITUDE: amplitude})

    def sweep(self) -> None:
        """Follow what a stepped sweep up and down settles to, and what comes beyond grazings."""
        met: list[tuple[float, OrbitKind]] = []
        for direction in (self.frequencies, self.frequencies[::-1]):
            state = None
            for frequency in direction.tolist():
                kind = self._settled(frequency, state)
                met.append((frequency, kind))
                state = kind.state if kind.status == OK else None
        sizes = [np.abs(kind.orbit.states / self.map(frequency).scale).max(initial=0.0) for frequency, kind in met]
        self.extent = max([1.0, *sizes])
        for frequency, kind in met:
            self._follow_settled(frequency, kind)

    def continue_in_level(self) -> None:
        """Follow each branch over the level at some frequencies, and the motions at this level that this leads to."""
        for branch in tuple(self.branches):
            places = np.linspace(0, len(branch.parameter) - 1, LEVEL_FREQUENCIES + 2).astype(int)[1:-1]
            for place in np.unique(places):
                frequency = float(branch.parameter[place])
                for state in self._at_this_level(frequency, branch.states[place], branch.periods):
                    self._follow(frequency, state, branch.periods)

    def _at_this_level(self, frequency: float, state: np.ndarray, periods: int) -> Iterator[np.ndarray]:
        over = follow(
            lambda level: self.map(frequency, level),
            state, self.level, (0.2 * self.level, MAX_LEVEL_RATIO * self.level), periods, MAX_LEVEL_POINTS,
            self.extent,
        )  # fmt: skip
        for guess in _crossings(over, self.level):
            cycle = shoot(self.map(frequency), guess, periods)
            if cycle.converged:
                yield cycle.state

    def _settled(self, frequency: float, state: np.ndarray | None) -> OrbitKind:
        map = self.map(frequency)
        return kind_of_run(map, map.initial if state is None else state)

    def _follow_settled(self, frequency: float, kind: OrbitKind) -> None:
        """Follow the motion that a run has settled to, or keep it among those that no branch follows."""
        if 0 < kind.period <= MAX_SUBHARMONIC:
            self._follow(frequency, kind.state, kind.period)
        else:
            self._keep(frequency, kind.kind, kind.evidence)

    def _keep(self, frequency: float, kind: str, evidence: str) -> None:
        """Keep a motion among those that no branch follows."""
        if not any((one.frequency, one.kind) == (frequency, kind) for one in self.irregular):
            self.irregular.append(Irregular(self.level, frequency, kind, evidence))

    def _follow(self, frequency: float, state: np.ndarray, periods: int) -> None:
        if self._is_known(frequency, state, periods):
            return
        if len(self.branches) >= MAX_BRANCHES:
            self._keep(frequency, f"beyond the {MAX_BRANCHES} branches that are followed at a level", "")
            return
        branch = self._followed(frequency, state, periods)
        if not branch.parameter.size:
            return
        self.branches.append(branch)
        width = self.window[1] - self.window[0]
        for point in branch.points:
            # on the side that the branch does not come from
            if point.kind == "grazing":
                side = np.sign(point.parameter - branch.parameter[point.index])
                beyond = point.parameter + side * BEYOND_GRAZING * width
                if self.window[0] < beyond < self.window[1]:
                    self._follow_settled(float(beyond), self._settled(float(beyond), point.state))

    def _followed(self, frequency: float, state: np.ndarray, periods: int) -> Branch:
        """Follow a motion with steps that suit the size that the motions of the branch have."""
        while True:
            branch = follow(self.map, state, frequency, self.window, periods, self.most, self.extent)
            size = np.abs(branch.states / self.map(frequency).scale).max(initial=0.0)
            if size <= MAX_EXTENT_RATIO * self.extent:
                return branch
            self.extent = float(size)

    def _is_known(self, frequency: float, state: np.ndarray, periods: int) -> bool:
        """Whether a cycle, at one of its sections, is on a branch that is followed already."""
        map = self.map(frequency)
        for branch in self.branches:
            if periods % branch.periods:
                continue
            for guess in _crossings(branch, frequency):
                cycle = shoot(map, guess, branch.periods)
                own = [cycle.state, *cycle.orbit.states[:-1]] if cycle.converged else []
                if any(np.abs((other - state) / map.scale).max() < SAME_CYCLE_DISTANCE for other in own):
                    return True
        return False


def _crossings(branch: Branch, value: float) -> Iterator[np.ndarray]:
    """States of a branch at one value of its parameter, by linear interpolation."""
    offset = branch.parameter - value
    for i in np.flatnonzero(offset[:-1] * offset[1:] <= 0.0):
        span = offset[i + 1] - offset[i]
        share = -offset[i] / span if span else 0.0
        yield (1.0 - share) * branch.states[i] + share * branch.states[i + 1]


def _response(
    setting: Setting, level: float, branch: Branch, harmonics: int, amplitude: AmplitudeAt, isolated: bool
) -> ResponseBranch:
    at = partial(harmonics_of_cycle, setting, branch.periods, harmonics)
    frequencies = branch.parameter.tolist()
    pairs = [at(f, amplitude(level, f), state) for f, state in zip(frequencies, branch.states, strict=True)]
    complex_amplitudes, peaks = zip(*pairs, strict=True)
    stacked = np.stack(complex_amplitudes, axis=-1), np.stack(peaks, axis=-1)
    return as_measured(setting, ResponseBranch(level, branch, *stacked, isolated), amplitude)


def as_measured(setting: Setting, response: ResponseBranch, amplitude: AmplitudeAt) -> ResponseBranch:
    """Return a response whose harmonics but the mean are what effects at the site "response" have measured of them."""
    excitation, harmonics = setting.excitation, response.harmonics.copy()
    levels = np.array([amplitude(response.level, frequency) for frequency in response.frequency.tolist()])
    record = make_response(
        response.frequency, response.branch.bodies, harmonics[:, 1], levels, excitation.unit, place=excitation.place,
        quantity=excitation.quantity, higher={order: harmonics[:, order] for order in range(2, harmonics.shape[1])},
    )  # fmt: skip
    measured = setting.model.measured_response(record, setting.values)
    harmonics[:, 1:] = np.moveaxis(complex_harmonics(measured), 0, 1)
    return replace(response, harmonics=harmonics)


def harmonics_of_cycle(
    setting: Setting, periods: int, highest: int, frequency: float, amplitude: float, state: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Complex amplitudes (body, harmonic) and half the peak-to-peak displacement (body,) of a cycle  [m]."""
    map = sampled(setting, setting.map({FREQUENCY: frequency, AMPLITUDE: amplitude}))
    displacement = map.motion(state, periods, HARMONIC_SAMPLES)
    orders = np.arange(highest + 1)
    spectrum = np.fft.rfft(displacement, axis=1)[:, periods * orders] / displacement.shape[1]
    spectrum[:, 1:] *= 2.0
    return spectrum * np.exp(-1j * orders * setting.section_phase), 0.5 * np.ptp(displacement, axis=1)
