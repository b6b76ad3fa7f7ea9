"""How far simulated records are from measured ones, over all records and terms."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from calib import plugins
from calib.cycles import Motion, kind_of_motion, sampled
from calib.errors import CalibError, nearest
from calib.objective.alignment import Alignment
from calib.objective.reach import FeatureValue, Scalar, compared, scalars
from calib.objective.terms import Feature, Reference, Score, Term
from calib.record import OK
from calib.record import channels as channels_of

BEND = 5.0  # distance from which the total rises more slowly than the distance
WRONG = 10.0  # least total of a motion of the wrong kind; more than any right one


class Objective:
    """Compare simulated records with references, term by term.

    The distance of a term is the root of the mean squared difference of its feature, in units of the feature's scale,
    over the samples of each channel and body and then over channels, bodies and records alike: 10 % too large is 0.10.
    Where the reference states how its uncertainty varies within a channel, samples are weighted by 1 / sigma, of unit
    mean square. D, the root of the weighted mean of the squared distances of all terms, is the root of the summed
    squares of the residuals.

    The kind of motion comes first. Where a reference is period-n and the simulation of its record is not, the total is
    at least 10, more than any total of the right kind (at most 9): 10 (1 + r / (1 + r)) averaged over the wrong records
    plus D / (1 + D), r being the difference of the simulated states n periods apart over the amplitude. A motion that
    is undecided is wrong only where it settles towards another period.

    Everything of the references is computed once: a score of one record (2 bodies, 2 channels, 2400 samples) costs
    about 1 ms, 2 ms with all nuisances.

    Parameters
    ----------
    references : by name; those of use "calibrate" are scored, the others can be aligned
    terms : what is compared

    Raises
    ------
    CalibError : a term whose body or record is not there, whose channel a reference lacks, or that compares nothing
        that the excitation leaves open
    """

    def __init__(self, references: Mapping[str, Reference], terms: Sequence[Term]):
        self.references = dict(references)
        self.terms = _distinct(terms)
        if not self.terms:
            raise CalibError("an objective needs at least one term; name a feature to compare")
        self._compared = {name: _Compared(reference, self.terms) for name, reference in self.references.items()}
        self.scored = [name for name, reference in self.references.items() if reference.use == "calibrate"]
        if not self.scored:
            raise CalibError('no reference is used to calibrate; set use = "calibrate" for one of them at least')
        self._blocks = [self._blocks_of(term) for term in self.terms]
        whole = sum(term.weight for term in self.terms)
        self._weights = [term.weight / whole for term in self.terms]

    def _blocks_of(self, term: Term) -> list["_Blocks"]:
        for name in term.records or ():
            if name not in self.scored:
                raise CalibError(
                    f"term {term.label!r}: no record {name!r} to calibrate on{nearest(name, self.scored)}; "
                    f"there are {', '.join(self.scored)}"
                )
        blocks = [_Blocks(term, name, self._compared[name]) for name in term.records or self.scored]
        if not any(block.number for block in blocks):
            raise CalibError(
                f"term {term.label!r}: the excitation prescribes all that it compares, which is no evidence of fit; "
                "compare another body or channel"
            )
        return blocks

    def on(self, references: Mapping[str, Reference]) -> "Objective":
        """Return the same terms over other references, all of them scored, whatever their use.

        A term of named records keeps those that are there; where none is, it is taken for all.
        """
        scored = {name: replace(reference, use="calibrate") for name, reference in references.items()}
        terms = []
        for term in self.terms:
            kept = tuple(name for name in term.records or () if name in scored)
            terms.append(replace(term, records=kept or None))
        return Objective(scored, terms)

    def __call__(self, records: Mapping[str, xr.Dataset]) -> Score:
        """Score the simulated records, one for each scored reference; a failed one makes the total infinite."""
        bad = self._first_failure(records)
        if bad is not None:
            return Score(np.inf, {term.label: np.inf for term in self.terms}, *bad)
        seen = {name: self._compared[name].seen(records[name]) for name in self.scored}
        distances, residuals = [], []
        for blocks, weight in zip(self._blocks, self._weights, strict=True):
            square, parts = self._term(blocks, weight, seen)
            distances.append(square)
            residuals += parts
        square = float(np.dot(self._weights, distances))
        labels = [term.label for term in self.terms]
        penalties = {name: self._compared[name].penalty(view.motion) for name, view in seen.items()}
        wrong = tuple(name for name, penalty in penalties.items() if penalty is not None)
        return Score(
            total=_total(np.sqrt(square), [penalties[name] for name in wrong]),
            terms=dict(zip(labels, np.sqrt(distances).tolist(), strict=True)),
            kind=_joined({name: view.motion.kind for name, view in seen.items()}),
            evidence=_joined({name: self._evidence(name, view.motion, name in wrong) for name, view in seen.items()}),
            residuals=np.concatenate(residuals),
            nuisances={name: view.nuisances for name, view in seen.items()},
            wrong=wrong,
        )

    def _first_failure(self, records) -> tuple[str, str] | None:
        for name in self.scored:
            if name not in records:
                raise CalibError(f"no simulated record for {name!r}{nearest(name, records)}; there are {list(records)}")
        for name in self.scored:
            found = self._compared[name].failure(records[name])
            if found is not None:
                return found
        return None

    def _term(self, blocks, weight, seen):
        """Squared distance of a term, and its residuals record by record."""
        active = [block.active(seen[block.record].prescribed) for block in blocks]
        number = sum(int(a.sum()) for a in active)
        if not number:
            raise CalibError(
                f"term {blocks[0].term.label!r}: the simulator prescribes all that it compares; compare another body"
            )
        square, parts = 0.0, []
        for block, mask in zip(blocks, active, strict=True):
            residual = block.residual(seen[block.record], mask) / np.sqrt(number)
            square += float(residual @ residual)
            parts.append(np.sqrt(weight) * residual)
        return square, parts

    def _evidence(self, name, motion: Motion, wrong: bool) -> str:
        if not wrong:
            return motion.evidence
        return f"{motion.evidence}; the reference is {self._compared[name].motion.kind}"

    def residuals(self, records: Mapping[str, xr.Dataset]) -> xr.DataArray:
        """Residuals (residual,) with coordinates term, record, body and channel; its squares add up to D^2.

        Raises
        ------
        CalibError : a record failed
        """
        score = self(records)
        if score.residuals is None:
            raise CalibError(f"a failed run has no residuals (status {score.status!r}: {score.reason})")
        names = {key: [] for key in ("term", "record", "body", "channel")}
        for blocks in self._blocks:
            for block in blocks:
                for body, channel, size in block.layout:
                    for key, value in zip(names, (block.term.label, block.record, body, channel), strict=True):
                        names[key] += [value] * size
        coords = {key: ("residual", np.array(values, dtype=str)) for key, values in names.items()}
        return xr.DataArray(score.residuals, dims="residual", coords=coords)

    def aligned(self, name: str, record: xr.Dataset) -> xr.Dataset:
        """Return a simulated record on the time base of the reference `name`, its nuisances applied."""
        if name not in self._compared:
            raise CalibError(f"no reference {name!r}{nearest(name, self._compared)}; there are {list(self._compared)}")
        found = self._compared[name].failure(record)
        if found is not None:
            raise CalibError(f"a failed run cannot be aligned (status {found[0]!r}: {found[1]})")
        view = self._compared[name].seen(record)
        return view.record.assign_attrs({f"nuisance_{key}": value for key, value in view.nuisances.items()})

    def features(self, records: Mapping[str, xr.Dataset]) -> list[FeatureValue]:
        """Scalar features of the bodies that are compared, measured beside simulated; empty where a run failed."""
        if self._first_failure(records) is not None:
            return []
        found = []
        for name in self.scored:
            mine = [block for blocks in self._blocks for block in blocks if block.record == name]
            pairs = {pair for block in mine for pair in block.pairs}
            found += self._compared[name].features(pairs, records[name])
        return found


def _distinct(terms: Sequence[Term]) -> list[Term]:
    """Terms with labels of which no two are alike."""
    kept: list[Term] = []
    for term in terms:
        label, number = term.label, 1
        while label in {other.label for other in kept}:
            number += 1
            label = f"{term.label} ({number})"
        kept.append(term if number == 1 else replace(term, label=label))
    return kept


def _total(distance: float, penalties: Sequence[float]) -> float:
    if penalties:
        return float(WRONG * (1.0 + np.mean(penalties)) + distance / (1.0 + distance))
    beyond = (distance - BEND) / 4.0
    return float(distance if beyond <= 0.0 else BEND + 4.0 * beyond / (1.0 + beyond))


def _joined(said: Mapping[str, str]) -> str:
    if len(set(said.values())) == 1:
        return next(iter(said.values()))
    return "; ".join(f"{name}: {text}" for name, text in said.items())


def _pairs(prescribed: str) -> frozenset[tuple[str, str]]:
    """Split an attribute `prescribed`, "body.channel, ...", into (body, channel) pairs."""
    parts = (entry.strip().rpartition(".") for entry in prescribed.split(",") if entry.strip())
    return frozenset((body, channel) for body, _, channel in parts)


@dataclass(frozen=True, eq=False)
class _Seen:
    """A simulated record as the instrument would have seen it."""

    record: xr.Dataset
    raw: xr.Dataset
    nuisances: Mapping[str, float]
    motion: Motion
    prescribed: frozenset[tuple[str, str]]


class _Compared:
    """A reference with all that can be computed of it beforehand."""

    def __init__(self, reference: Reference, terms: Sequence[Term]):
        self.name = reference.name
        self.reference = reference
        self.period = reference.excitation.period
        self.record = _prepared(reference.record, self.period)
        self.bodies = [str(body) for body in self.record.body.values]
        self.motion = kind_of_motion(self.record)
        self.prescribed = _pairs(str(self.record.attrs.get("prescribed", "")))
        wanted = [t for t in terms if t.records is None or reference.name in t.records] or terms
        self._bodies = {body for term in wanted for body in term.bodies or self.bodies}
        self._alignments: dict[frozenset, Alignment] = {}
        self._alignment(self.prescribed)
        channels = channels_of(self.record)
        self._template = xr.Dataset(
            {c: self.record[c] for c in channels},
            attrs={k: v for k, v in self.record.attrs.items() if k in ("frequency", "place", "quantity", "status")},
        )
        self._scalars: dict[tuple[str, frozenset], Mapping[str, Scalar]] = {}

    def _alignment(self, prescribed) -> Alignment:
        if prescribed not in self._alignments:
            self._alignments[prescribed] = Alignment(
                self.record,
                self.period,
                self.motion.period or 1,
                self.reference.nuisance,
                self._bodies,
                prescribed,
            )
        return self._alignments[prescribed]

    def failure(self, simulated: xr.Dataset) -> tuple[str, str] | None:
        """Status and reason of a record that cannot be compared, None where it can."""
        status = simulated.attrs.get("status", OK)
        if status != OK:
            return status, str(simulated.attrs.get("reason", ""))
        for channel in self._template.data_vars:
            if channel in simulated.variables and not np.isfinite(simulated.variables[channel].values).all():
                return "not finite", f"{channel} of the simulated record {self.name!r} holds NaN or infinity"
        return None

    def seen(self, simulated: xr.Dataset) -> _Seen:
        """Align a simulated record, and tell its kind of motion."""
        prescribed = self.prescribed | _pairs(str(simulated.attrs.get("prescribed", "")))
        raw = simulated
        if not _same(simulated.attrs.get("frequency"), self._template.attrs.get("frequency")):
            raw = _with_period(simulated, self.period)
        values, nuisances = self._alignment(prescribed)(simulated)
        template = self._template
        if len(values) < len(template.data_vars):
            template = template[list(values)]
        return _Seen(template.copy(data=values), raw, nuisances, kind_of_motion(raw), prescribed)

    def penalty(self, motion: Motion) -> float | None:
        """How far a motion of another kind is from the reference's, in [0, 1]; None where the kind is right."""
        period = self.motion.period
        if period is None or motion.period == period:
            return None
        if motion.kind in ("undecided", "no contact") and motion.period is None and motion.likely in (None, period):
            return None
        apart = motion.recurrence[period - 1] if period <= len(motion.recurrence) else 1.0
        return apart / (1.0 + apart)

    def features(self, pairs: set[tuple[str, str]], simulated: xr.Dataset) -> list[FeatureValue]:
        """Scalar features of (body, channel) pairs."""
        view = self.seen(simulated)
        found = []
        for body in self.bodies:
            channels = tuple(
                c for c in self._template.data_vars if (body, c) in pairs and (body, c) not in view.prescribed
            )
            if not channels:
                continue
            key = (body, frozenset(channels))
            if key not in self._scalars:
                self._scalars[key] = self._measured(self.record, body, channels, sigmas=True)
            found += compared(self.name, body, self._scalars[key], self._measured(view.record, body, channels))
        return found

    def _measured(self, record, body, channels, sigmas=False) -> dict[str, Scalar]:
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
    """Return the reference with the period of its excitation, its velocity averaged where it tells its impacts."""
    if "impact_time" in record and "velocity" in record:
        record = record.assign(velocity=record["velocity"].copy(data=sampled(record, "velocity")))
        record = record.drop_vars([v for v in ("impact_time", "impact_speed") if v in record])
    return _with_period(record, period)


def _with_period(record: xr.Dataset, period: float | None) -> xr.Dataset:
    attrs = {key: value for key, value in record.attrs.items() if key != "frequency"}
    if period is not None:
        attrs["frequency"] = 1.0 / period
    changed = record.copy(deep=False)
    changed.attrs = attrs
    return changed


class _Blocks:
    """One term on one record: what was measured, and the factors that make residuals of differences."""

    def __init__(self, term: Term, record: str, compared: _Compared):
        self.term, self.record = term, record
        feature = term.feature
        label = f"term {term.label!r}, record {record!r}"
        for body in term.bodies or ():
            if body not in compared.bodies:
                raise CalibError(
                    f"{label}: no body {body!r}{nearest(body, compared.bodies)}; the reference has {compared.bodies}"
                )
        _check_channels(feature, compared.record, label)
        try:
            reference = feature(compared.record, term.bodies)
        except CalibError as error:
            raise CalibError(f"{label}: {error}") from error
        self.measured = _cubed(reference)
        self.shape = self.measured.shape
        names = [str(body) for body in reference.body.values]
        channels = [str(c) for c in reference.channel.values] if "channel" in reference.dims else [feature.name]
        finite = np.isfinite(self.measured)
        if term.bodies is not None and not finite.all():
            lacking = names[int(np.argwhere(~finite)[0][0])]
            raise CalibError(f"{label}: the reference shows no {feature.name} of {lacking!r}; leave this body out")
        free = np.array([[(b, c) not in compared.prescribed for c in channels] for b in names])
        self.mask = finite & free[:, :, None]
        if free.any() and not self.mask.any():
            raise CalibError(f"{label}: the reference shows no {feature.name} of any body; drop the term")
        self._names = [(b, c) for b in names for c in channels]
        sizes = self.mask.sum(axis=2)
        self.layout = [(b, c, int(n)) for (b, c), n in zip(self._names, sizes.ravel(), strict=True) if n]
        self.number = len(self.layout)
        self._factor = self._factors(feature, reference, compared.record, sizes)
        self._wraps = getattr(feature, "wraps", None)
        self._bare = getattr(feature, "values", None)
        self._raw = not getattr(feature, "aligned", True)

    @property
    def pairs(self) -> set[tuple[str, str]]:
        """(body, channel) pairs that are compared."""
        return {(body, channel) for body, channel, _ in self.layout}

    def _factors(self, feature, reference, record, sizes):
        """1 / scale, times 1 / sigma of unit mean square, over the root of the number of samples (body, channel, n)."""
        scale = feature.scale(reference)
        if isinstance(scale, xr.DataArray):
            scale = _cubed(scale.broadcast_like(reference).transpose(*reference.dims))
        scale = np.broadcast_to(np.asarray(scale, dtype=float), self.shape)
        if not (scale[self.mask] > 0.0).all():
            body = self._names[int(np.argmax(((scale <= 0.0) & self.mask).any(axis=2).ravel()))][0]
            raise CalibError(
                f"term {self.term.label!r}, record {self.record!r}: {body!r} does not move in the reference, "
                "so that no difference can be related to it; leave this body out"
            )
        weight = np.ones(self.shape)
        sigma = feature.uncertainty(record, self.term.bodies) if hasattr(feature, "uncertainty") else None
        if sigma is not None:
            weight = 1.0 / _cubed(sigma)
            weight = weight / np.sqrt((weight**2).mean(axis=2, keepdims=True))
        sizes = np.maximum(sizes, 1)[:, :, None]
        return np.divide(weight, scale * np.sqrt(sizes), out=np.zeros(self.shape), where=self.mask)

    def active(self, prescribed: frozenset) -> np.ndarray:
        """Whether each block (body, channel) of the layout counts: what the simulator prescribes does not."""
        return np.array([(body, channel) not in prescribed for body, channel, _ in self.layout], dtype=bool)

    def residual(self, seen: _Seen, active: np.ndarray) -> np.ndarray:
        """Differences over scale and root of their number, in the order of the layout; what does not count is 0."""
        record = seen.raw if self._raw else seen.record
        feature, bodies = self.term.feature, self.term.bodies
        try:
            simulated = _cubed(feature(record, bodies)) if self._bare is None else self._bare(record, bodies)
        except CalibError as error:
            raise CalibError(f"term {self.term.label!r}, simulated record {self.record!r}: {error}") from error
        simulated = simulated.reshape(*simulated.shape[:2], -1)
        if simulated.shape != self.shape:
            raise CalibError(
                f"term {self.term.label!r}, record {self.record!r}: expected values of shape {self.shape} (body, "
                f"channel, rest), got {simulated.shape} from the simulated record; name the channels to compare"
            )
        difference = simulated - self.measured
        if self._wraps:
            difference = (difference + 0.5 * self._wraps) % self._wraps - 0.5 * self._wraps
        residual = (difference * self._factor)[self.mask]
        sizes = [size for _, _, size in self.layout]
        if np.isnan(residual).any():  # nothing to measure in the simulation: off by the whole scale
            flat = np.repeat([1.0 / np.sqrt(size) for size in sizes], sizes)
            residual = np.where(np.isnan(residual), flat, residual)
        return residual if active.all() else residual * np.repeat(active, sizes)


def _check_channels(feature: Feature, record: xr.Dataset, label: str) -> None:
    have = channels_of(record)
    missing = [channel for channel in feature.channels if channel not in have]
    if not missing:
        return
    possible = _possible(have)
    hint = f"possible are {', '.join(possible)}" if possible else "choose a feature of what it has"
    raise CalibError(
        f"{label}: {feature.name} needs {missing[0]}, which the reference lacks (it has {', '.join(have)}); {hint}"
    )


def _possible(have: Sequence[str]) -> list[str]:
    """Names of the registered features that records with these channels can be compared by."""
    found = []
    for name, maker in plugins.load_all("calib.features").items():
        needs = maker().channels
        if set(needs) <= set(have) and (needs or {"displacement", "velocity"} & set(have)):
            found.append(name)
    if "phase_curve" not in found and {"displacement", "velocity"} & set(have):
        one = next(c for c in ("displacement", "velocity") if c in have)
        found.append(f'phase_curve with channels = ["{one}"]')
    return found


def _cubed(values: xr.DataArray) -> np.ndarray:
    """Values (body, channel, rest)."""
    array = values.values
    if "channel" not in values.dims:
        array = array[:, None]
    return array.reshape(*array.shape[:2], -1)
