"""The design region of a next measurement: the kinds of test that a laboratory can make, and their settings."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Final

import numpy as np
import xarray as xr

from calib.diagnosis.part import Part
from calib.errors import nearest
from calib.modelling.model import Model
from calib.objective import Reference
from calib.records import STATE
from calib.records.excitation import Excitation
from calib.records.held_response import as_measured, is_held
from calib.records.response import sweeps

STEADY_TONE, SWEEP, RECORDED_INPUT = "steady tone", "sweep", "recorded input"
FREE_DECAY: Final = "free decay"
WITHOUT_CONTACT, REPEATED_RECORD = "without contact", "repeated record"
STEPPED_SINE: Final = "stepped sine"
TESTS = (STEADY_TONE, WITHOUT_CONTACT, SWEEP, RECORDED_INPUT, FREE_DECAY, REPEATED_RECORD, STEPPED_SINE)
RELEASE = ("initial_displacement", "initial_velocity")  # parameters of simulators that can be released
AMPLITUDE_RANGE = (0.1, 1.5)  # of the smallest and the largest amplitude of the records  [1]
FREQUENCY_RANGE = (0.5, 2.0)  # of the lowest and the highest frequency of the records  [1]
RELEASE_RANGE = (0.5, 2.0)  # of the largest displacement of the record  [1]
MAX_SIMULATIONS = 1000  # of a search, unless the study file states another number  [count]


UNBOUNDED = {  # why a kind of test that could be made has no region to be searched
    SWEEP: "its first and its last frequency are the same; state bounds of the frequency that differ",
    FREE_DECAY: "no measured displacement bounds the release; state bounds of the release",
}


@dataclass(frozen=True)
class Laboratory:
    """The tests and settings of the laboratory; what is None is derived from the records.

    Attributes
    ----------
    frequency : lowest and highest of a harmonic excitation  [Hz]
    amplitude : least and greatest of the excitation, of a recorded one its largest magnitude  [unit of its quantity]
    release : least and greatest displacement from which a free decay begins  [m]
    tests : kinds of test, of `TESTS`; None: all that apply
    channels : (body, channel) pairs that could be measured beside those of the records; None: displacement and
        velocity of every body of the simulator
    simulations : that a search may take at most
    """

    frequency: tuple[float, float] | None = None
    amplitude: tuple[float, float] | None = None
    release: tuple[float, float] | None = None
    tests: tuple[str, ...] | None = None
    channels: tuple[tuple[str, str], ...] | None = None
    simulations: int = MAX_SIMULATIONS


UNRESTRICTED = Laboratory()


@dataclass(frozen=True)
class DesignPoint:
    """Settings of a possible measurement.

    Attributes
    ----------
    test : of `TESTS`
    amplitude : of the excitation, of a recorded one its largest magnitude; None without one  [unit of its quantity]
    frequency : of a steady tone, or where a sweep or a stepped sine begins; None for another  [Hz]
    end_frequency : where a sweep or a stepped sine ends; None for another  [Hz]
    release : displacement from which a free decay begins; None for another  [m]
    """

    test: str
    amplitude: float | None = None
    frequency: float | None = None
    end_frequency: float | None = None
    release: float | None = None

    def setting(self, name: str) -> float:
        """Value of a setting  [its unit].

        Raises
        ------
        ValueError : this kind of test has no such setting
        """
        value = getattr(self, name)
        if value is None:
            raise ValueError(f"a test of the kind {self.test!r} has no {name}")
        return value


@dataclass(frozen=True)
class DesignVariable:
    """A setting within its bounds, searched on a logarithmic scale.

    Attributes
    ----------
    name : of the field of `DesignPoint`
    unit : of its value
    low, high : bounds, 0 < low <= high  [unit]
    stated : whether the study file states them; else they are derived from the records
    """

    name: str
    unit: str
    low: float
    high: float
    stated: bool

    @property
    def is_fixed(self) -> bool:
        """Whether the bounds leave one value only."""
        return self.high <= self.low

    def value(self, share: float) -> float:
        """Value at a share in [0, 1] of the logarithmic scale  [unit]."""
        return float(self.low * (self.high / self.low) ** share)


@dataclass(frozen=True)
class DesignRegion:
    """Settings over which one kind of test is searched.

    Attributes
    ----------
    fixed : a point that has the settings which are not searched
    variables : settings that are searched, none or more
    """

    fixed: DesignPoint
    variables: tuple[DesignVariable, ...] = ()

    @property
    def test(self) -> str:
        """Kind of test."""
        return self.fixed.test

    def point(self, shares: Sequence[float]) -> DesignPoint:
        """Point at shares in [0, 1] of the variables' logarithmic scales."""
        values = {v.name: v.value(share) for v, share in zip(self.variables, shares, strict=True)}
        return replace(
            self.fixed,
            amplitude=values.get("amplitude", self.fixed.amplitude),
            frequency=values.get("frequency", self.fixed.frequency),
            release=values.get("release", self.fixed.release),
        )

    def shares(self, point: DesignPoint) -> np.ndarray:
        """Shares (variable,) in [0, 1] of a point: the inverse of `point`."""
        return np.array(
            [
                0.0 if v.is_fixed else np.log(getattr(point, v.name) / v.low) / np.log(v.high / v.low)
                for v in self.variables
            ]
        )

    def grid(self, counts: Sequence[int]) -> list[DesignPoint]:
        """Points of a regular grid with these numbers of values of each variable, one of a fixed one."""
        axes = [
            np.array([0.0]) if v.is_fixed else np.linspace(0.0, 1.0, max(2, count))
            for v, count in zip(self.variables, counts, strict=True)
        ]
        return [self.point(shares) for shares in product(*axes)]

    def neighbours(self, point: DesignPoint, steps: np.ndarray) -> list[DesignPoint]:
        """Points within the bounds that are one step (variable,) in [0, 1] away, in all combinations of variables."""
        centre = self.shares(point)
        moves = product(*((0.0,) if v.is_fixed else (0.0, 1.0, -1.0) for v in self.variables))
        around = [np.clip(centre + np.array(move) * steps, 0.0, 1.0) for move in moves if any(move)]
        return [self.point(shares) for shares in dict.fromkeys(map(tuple, around)) if not np.allclose(shares, centre)]


def releasable(model: Model) -> str | None:
    """Place at which the simulator can be released from a displacement at rest; None where it cannot."""
    excitations = getattr(model.simulator, "excitations", ())
    place = next((place for quantity, place in excitations if quantity == FREE_DECAY), None)
    return place if set(RELEASE) <= set(model.nominal) else None


def amplitude_of(excitation: Excitation) -> float | None:
    """Amplitude of a harmonic excitation, largest magnitude of a recorded one  [unit of its quantity]."""
    if excitation.value is not None:
        return float(np.abs(excitation.value).max())
    return excitation.amplitude if excitation.harmonic else None


def measured_displacement(part: Part) -> float:
    """Largest measured displacement of a record; 0 where none is measured  [m]."""
    rows = [row for (_, channel), row in zip(part.rows, part.measured, strict=True) if channel == "displacement"]
    return max((float(np.abs(row).max()) for row in rows), default=0.0)


def base_record(references: Mapping[str, Reference]) -> str:
    """Name of the record on which the next one is based: the first harmonic one over time, else the first.

    A frequency response only where there is no record over time.
    """
    over_time = {name: r for name, r in references.items() if not r.is_swept} or references
    return next((name for name, r in over_time.items() if r.excitation.harmonic), next(iter(over_time)))


def mistakes_of(laboratory: Laboratory, references: Mapping[str, Reference], model: Model) -> Iterator[tuple[str, str]]:
    """Yield (key, mistake) of each setting that does not suit the records or the simulator."""
    base = references[base_record(references)]
    excitation = base.excitation
    if laboratory.frequency is not None and not excitation.harmonic:
        yield "frequency", "no record has a harmonic excitation whose frequency could be changed; drop this key"
    if laboratory.amplitude is not None and amplitude_of(excitation) is None and not base.is_swept:
        yield "amplitude", "no record has an excitation whose amplitude could be changed; drop this key"
    if laboratory.release is not None and releasable(model) is None:
        yield "release", f"simulator {model.simulator.name!r} takes no free decay from a displacement; drop this key"
    for key in ("release", "channels") if base.is_swept else ():
        if getattr(laboratory, key) is not None:
            yield key, f"beside frequency responses only the level of a {STEPPED_SINE} is searched; drop this key"
    for test in laboratory.tests or ():
        reason = inapplicable(test, base, model)
        if reason:
            yield "tests", reason if test not in TESTS else f"{test!r} cannot be made: {reason}"
    for body, channel in laboratory.channels or ():
        if body not in model.bodies:
            known = ", ".join(model.bodies)
            yield "channels", f"unknown body {body!r}{nearest(body, model.bodies)}; this simulator has {known}"
        elif channel not in STATE:
            yield "channels", f"unknown channel {channel!r}{nearest(channel, STATE)}; expected {' or '.join(STATE)}"


def inapplicable(test: str, base: Reference, model: Model) -> str:
    """Why a kind of test cannot be made with these records and this simulator; "" where it can.

    A sweep begins from an unknown state: it has to be solved for, so that it does not distinguish models.

    Parameters
    ----------
    base : record on which the test is based
    """
    excitation = base.excitation
    if test not in TESTS:
        return f"unknown kind of test {test!r}{nearest(test, TESTS)}; known are {', '.join(TESTS)}"
    if test == STEPPED_SINE and not base.is_swept:
        return "it is searched beside frequency responses, and there is a record over time"
    if test != STEPPED_SINE and base.is_swept:
        return "it is based on a record over time, and every record is a frequency response"
    if test in (STEADY_TONE, SWEEP) and not excitation.harmonic:
        return "it needs a record with a harmonic excitation, and there is none"
    if test == SWEEP and not model.initial:
        return f"simulator {model.simulator.name!r} has no initial state that could be solved for"
    if test == RECORDED_INPUT and not excitation.recorded:
        return "it needs records with a recorded excitation, and none with a harmonic one"
    if test == WITHOUT_CONTACT and amplitude_of(excitation) is None:
        return "it needs a record with an excitation, and there is none"
    if test == FREE_DECAY and releasable(model) is None:
        return f"simulator {model.simulator.name!r} takes no free decay from a displacement"
    return ""


def inapplicable_tests(
    laboratory: Laboratory, references: Mapping[str, Reference], model: Model, part: Part
) -> dict[str, str]:
    """Sweeps and free decays that are not searched although the laboratory could make them, with the reason.

    Parameters
    ----------
    part : record on which they are based
    """
    if references[part.name].is_swept:  # they are searched beside records over time
        return {}
    asked = [test for test in (SWEEP, FREE_DECAY) if laboratory.tests is None or test in laboratory.tests]
    reasons = {test: inapplicable(test, references[part.name], model) for test in asked}
    for test in asked:
        if not reasons[test] and _region(test, laboratory, references, part) is None:
            reasons[test] = UNBOUNDED[test]
    return {test: reason for test, reason in reasons.items() if reason}


def regions(
    laboratory: Laboratory, references: Mapping[str, Reference], model: Model, part: Part
) -> dict[str, DesignRegion]:
    """Design region of each kind of test that the laboratory can make, by kind.

    Parameters
    ----------
    part : record on which it is based
    """
    base = references[part.name]
    asked = TESTS if laboratory.tests is None else laboratory.tests
    possible = [test for test in TESTS if test in asked and not inapplicable(test, base, model)]
    made = {test: _region(test, laboratory, references, part) for test in possible}
    return {test: region for test, region in made.items() if region is not None}


def _region(test: str, laboratory: Laboratory, references: Mapping[str, Reference], part: Part) -> DesignRegion | None:
    """Design region of one kind of test; None where nothing bounds it."""
    excitation = references[part.name].excitation
    if test == STEPPED_SINE:
        return _levels(laboratory, references, references[part.name])
    if test == REPEATED_RECORD:
        return DesignRegion(DesignPoint(test, amplitude_of(excitation), excitation.frequency))
    if test == FREE_DECAY:
        release = _release(laboratory, part)
        return None if release is None else DesignRegion(DesignPoint(test), (release,))
    if not amplitude_of(excitation):
        return None
    similar = [r.excitation for r in alike(references, references[part.name]).values()]
    similar = [e for e in similar if (amplitude_of(e) or 0.0) > 0.0]
    amplitude = _variable("amplitude", excitation.unit, laboratory.amplitude, map(amplitude_of, similar))
    if not excitation.harmonic:
        return DesignRegion(DesignPoint(test), (amplitude,))
    frequency = _variable("frequency", "Hz", laboratory.frequency, (e.frequency for e in similar))
    if test != SWEEP:
        return DesignRegion(DesignPoint(test), (amplitude, frequency))
    if frequency.is_fixed:
        return None
    return DesignRegion(DesignPoint(test, frequency=frequency.low, end_frequency=frequency.high), (amplitude,))


def _levels(laboratory: Laboratory, references: Mapping[str, Reference], base: Reference) -> DesignRegion:
    """Design region of a stepped sine over the frequencies of the responses, of which the base is one."""
    responses = [reference.record for reference in alike(references, base).values()]
    levels = [level for own in responses for level in largest_levels(own)]
    level = _variable("amplitude", base.excitation.unit, laboratory.amplitude, levels)
    ends = [float(end) for own in responses for end in (own.frequency.min(), own.frequency.max())]
    low, high = laboratory.frequency or (min(ends), max(ends))
    return DesignRegion(DesignPoint(STEPPED_SINE, frequency=low, end_frequency=high), (level,))


def largest_levels(response: xr.Dataset) -> list[float]:
    """Largest level of the excitation in each sweep  [its unit]; the least one where an amplitude was held.

    That is the level of the resonance: the others, set there, would drive the body far beyond the amplitude.
    """
    level = as_measured(response)["level"].values
    end = np.min if is_held(response) else np.max
    return [float(end(level[points])) for _, points in sweeps(response)]


def alike(references: Mapping[str, Reference], base: Reference) -> dict[str, Reference]:
    """References with the kind of excitation of a record, over time or frequency responses as that is."""
    return {
        name: r for name, r in references.items()
        if r.is_swept == base.is_swept and same_drive(r.excitation, base.excitation)
    }  # fmt: skip


def same_drive(one: Excitation, other: Excitation) -> bool:
    """Whether two excitations are of one kind at one place, whatever their amplitudes and frequencies."""
    return (one.place, one.quantity, one.recorded) == (other.place, other.quantity, other.recorded)


def _variable(
    name: str, unit: str, stated: tuple[float, float] | None, known: Iterable[float | None]
) -> DesignVariable:
    """Variable within the stated bounds, else within the range about the `known` values of the records."""
    if stated is not None:
        return DesignVariable(name, unit, *stated, stated=True)
    low, high = {"amplitude": AMPLITUDE_RANGE, "frequency": FREQUENCY_RANGE}[name]
    values = [value for value in known if value is not None]
    return DesignVariable(name, unit, low * min(values), high * max(values), stated=False)


def _release(laboratory: Laboratory, part: Part) -> DesignVariable | None:
    """Displacement of release; None where neither the study file nor a measured displacement bounds it."""
    if laboratory.release is not None:
        return DesignVariable("release", "m", *laboratory.release, stated=True)
    largest = measured_displacement(part)
    if not largest > 0.0:
        return None
    low, high = RELEASE_RANGE
    return DesignVariable("release", "m", low * largest, high * largest, stated=False)


def additional_channels(
    laboratory: Laboratory, model: Model, part: Part, given: Sequence[tuple[str, str]]
) -> tuple[tuple[str, str], ...]:
    """(body, channel) pairs absent from the record that the laboratory could measure; none that is prescribed.

    Parameters
    ----------
    given : pairs that the simulation prescribes
    """
    wanted = laboratory.channels
    pairs = [(body, channel) for body in model.bodies for channel in STATE] if wanted is None else wanted
    return tuple(dict.fromkeys(pair for pair in pairs if pair not in part.rows and pair not in given))
