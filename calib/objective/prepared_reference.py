"""A reference, prepared for the comparison with simulated records."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import xarray as xr

from calib.errors import CalibError
from calib.modelling.model import Model
from calib.modelling.simulator import Request
from calib.objective.alignment import Alignment
from calib.objective.initial_state import (
    Comparison,
    Released,
    Unknown,
    View,
    initial_state,
    no_initial_state,
    released,
    unknowns,
)
from calib.objective.scalar_features import FeatureValue, Scalar, compared, scalars
from calib.objective.terms import Reference, Term
from calib.records import OK, is_response, prescribed, with_channels
from calib.records import channels as channels_of
from calib.records.cycles import NO_CONTACT, UNDECIDED, MotionKind, clock_rate, kind_of_motion, sampled

DRIFTING_PERIODS = (1, 2, 3, 4)  # periods, tried for a motion that never returns on its recorder's clock
CLOCK_RATE = "clock_rate"  # attribute of a record: by how much the drive's clock is faster than the recorder's  [1]


Pairs = frozenset[tuple[str, str]]  # (body, channel)


@dataclass(frozen=True, eq=False)
class SensedRecord:
    """A simulated record as the instrument would have recorded it.

    Attributes
    ----------
    record : on the time base of the reference, nuisances applied, with its variable `trust`
    raw : as it was simulated
    nuisances : name -> value in SI
    motion : kind of the simulated motion
    prescribed : (body, channel) pairs that the excitation prescribes
    """

    record: xr.Dataset
    raw: xr.Dataset
    nuisances: Mapping[str, float]
    motion: MotionKind
    prescribed: Pairs


class PreparedReference:
    """A reference, with everything that does not depend on the simulation computed once."""

    def __init__(self, reference: Reference, terms: Sequence[Term]):
        self.name = reference.name
        self.reference = reference
        self.period = reference.excitation.period
        stated = {"place": reference.excitation.place, "quantity": reference.excitation.quantity}
        self.record = _prepared(reference.record, self.period).assign_attrs(stated)
        self.bodies = [str(body) for body in self.record.body.values]
        self.motion = kind_of_motion(self.record)
        self.prescribed = frozenset(prescribed(self.record))
        wanted = [t for t in terms if t.records is None or reference.name in t.records] or terms
        self._bodies = {body for term in wanted for body in term.bodies or self.bodies}
        of_terms = {(b, c) for term in wanted for b in term.bodies or self.bodies for c in term.feature.channels}
        self._channels = channels_of(self.record)
        self._pairs = of_terms & {(b, c) for b in self.bodies for c in self._channels}
        self._alignments: dict[Pairs, Alignment] = {}
        self._alignment(self.prescribed)
        trust = xr.DataArray(np.ones(self.record.sizes["time"]), dims="time")
        self._template = xr.Dataset(
            {**{c: self.record[c] for c in self._channels}, "trust": trust},
            attrs={k: v for k, v in self.record.attrs.items() if k in ("frequency", "place", "quantity", "status")},
        )
        self._scalars: dict[tuple[str, frozenset[str]], Mapping[str, Scalar]] = {}
        self._initial: tuple[Mapping[str, tuple[str, str]], list[Unknown]] | None = None

    def _alignment(self, prescribed: Pairs) -> Alignment:
        if prescribed not in self._alignments:
            self._alignments[prescribed] = Alignment(
                self.record,
                self.period,
                self.motion.period or 1,
                self.reference.nuisance,
                self._bodies,
                prescribed,
                self._pairs,
            )
        return self._alignments[prescribed]

    def failure(self, simulated: xr.Dataset) -> tuple[str, str] | None:
        """Status and reason of a record that cannot be compared, None where it can."""
        status = simulated.attrs.get("status", OK)
        if status != OK:
            return status, str(simulated.attrs.get("reason", ""))
        for channel in self._channels:
            if channel in simulated.variables and not np.isfinite(simulated.variables[channel].values).all():
                return "not finite", f"{channel} of the simulated record {self.name!r} holds NaN or infinity"
        return None

    def sensed(self, simulated: xr.Dataset) -> SensedRecord:
        """Align a simulated record, and decide its kind of motion."""
        given = self.prescribed.union(prescribed(simulated))
        raw = simulated
        if not _same(simulated.attrs.get("frequency"), self._template.attrs.get("frequency")):
            raw = _with_period(simulated, self.period)
        values, nuisances, trust = self._alignment(given)(simulated)
        template, values = self._template, {**values, "trust": trust}
        if len(values) < len(template.data_vars):
            template = template[list(values)]
        record = template.copy(data=values)
        return SensedRecord(record, raw, {**nuisances, **initial_state(simulated)}, kind_of_motion(raw), given)

    def released(self, model: Model, values: Mapping[str, float], request: Request) -> Released:
        """Simulate with the initial state that fits the reference best; see `calib.objective.initial_state`."""
        compared = self._comparison

        def simulated(state: Mapping[str, float]) -> View:
            record = model.run({**values, **state}, self.reference.excitation, request)
            failed = self.failure(record)
            if failed is not None:
                return View(record, status=failed[0])
            channels, _, trust = self._alignment(self.prescribed.union(prescribed(record)))(record)
            return compared.view(record, channels, trust)

        try:
            return released(simulated, compared, self._unknowns(model))
        except CalibError as error:
            raise type(error)(f"{self.name}: {error}") from error

    @cached_property
    def _comparison(self) -> Comparison:
        """Samples from which the initial state is solved: what terms compare, else all measured ones of the bodies."""
        measured = [(body, channel) for channel in self._channels for body in self.bodies if body in self._bodies]
        free = [pair for pair in measured if pair not in self.prescribed]
        return Comparison(self.record, [pair for pair in free if pair in self._pairs] or free)

    def _unknowns(self, model: Model) -> list[Unknown]:
        """Return the components of the initial state, estimated from this reference alone."""
        if self._initial is None or self._initial[0] != model.initial:
            if not model.initial:
                raise CalibError(no_initial_state(model))
            centred = "offset" in self.reference.nuisance
            self._initial = model.initial, unknowns(self.record, model.initial, model.parameters, centred)
        return self._initial[1]

    def penalty(self, motion: MotionKind) -> float | None:
        """Distance of a motion of another kind from the reference's, in [0, 1]; None where the kind is right."""
        period = self.motion.period
        if period is None or motion.period == period:
            return None
        if motion.kind in (UNDECIDED, NO_CONTACT) and motion.period is None and motion.likely in (None, period):
            return None
        apart = motion.recurrence[period - 1] if period <= len(motion.recurrence) else 1.0
        return apart / (1.0 + apart)

    def features(self, pairs: set[tuple[str, str]], sensed: SensedRecord) -> list[FeatureValue]:
        """Scalar features of (body, channel) pairs."""
        features: list[FeatureValue] = []
        for body in self.bodies:
            channels = tuple(c for c in self._channels if (body, c) in pairs and (body, c) not in sensed.prescribed)
            if not channels:
                continue
            key = (body, frozenset(channels))
            if key not in self._scalars:
                self._scalars[key] = self._measured(self.record, body, channels, sigmas=True)
            features += compared(self.name, body, self._scalars[key], self._measured(sensed.record, body, channels))
        return features

    def _measured(
        self, record: xr.Dataset, body: str, channels: Sequence[str], sigmas: bool = False
    ) -> dict[str, Scalar]:
        row = self.bodies.index(body)
        values = {c: record.variables[c].values[row] for c in channels if c in record.variables}
        units = {c: self.record[c].attrs["units"] for c in channels}
        known = {}
        for channel in channels:
            if sigmas and f"{channel}_sigma" in record:
                known[channel] = float(np.sqrt(np.mean(record[f"{channel}_sigma"].values[row] ** 2)))
        return scalars(record.variables["time"].values, values, units, self.period, known)


def _same(frequency: float | None, other: float | None) -> bool:
    if frequency is None or other is None:
        return frequency is other
    return abs(frequency - other) <= 1e-12 * other


def _prepared(record: xr.Dataset, period: float | None) -> xr.Dataset:
    """Return the reference with the period of its excitation, its velocity averaged where it lists its impacts."""
    if "impact_time" in record and "velocity" in record:
        record = with_channels(record, {"velocity": sampled(record, "velocity")})
        record = record.drop_vars([v for v in ("impact_time", "impact_speed") if v in record])
    return _with_period(record, period)


def on_drive_clock(reference: Reference) -> Reference:
    """Return a reference whose instants are on the clock of its harmonic drive, with the attribute `clock_rate`  [1].

    A steady motion has the period of its drive: where its cycles say otherwise the recorder's clock is fast or slow,
    and was right at time zero. See `calib.records.cycles.clock_rate`.
    """
    if is_response(reference.record) or not reference.excitation.harmonic or CLOCK_RATE in reference.record.attrs:
        return reference
    steady = _with_period(reference.record, reference.excitation.period)
    known = kind_of_motion(steady).period
    for periods in DRIFTING_PERIODS if known is None else (known,):
        rate = clock_rate(steady, periods)
        if rate != 0.0 and kind_of_motion(_with_rate(steady, rate)).period is not None:
            return replace(reference, record=_with_rate(reference.record, rate))
    return replace(reference, record=_with_rate(reference.record, 0.0))


def _with_rate(record: xr.Dataset, rate: float) -> xr.Dataset:
    """Return a record on a clock whose instants are 1 + rate times its own."""
    instants = [name for name in ("time", "impact_time") if rate != 0.0 and name in record.variables]
    moved = {name: (record[name].dims, (1.0 + rate) * record[name].values, record[name].attrs) for name in instants}
    return record.assign(moved).assign_attrs({CLOCK_RATE: rate})


def _with_period(record: xr.Dataset, period: float | None) -> xr.Dataset:
    attrs = {key: value for key, value in record.attrs.items() if key != "frequency"}
    if period is not None:
        attrs["frequency"] = 1.0 / period
    changed = record.copy(deep=False)
    changed.attrs = attrs
    return changed
