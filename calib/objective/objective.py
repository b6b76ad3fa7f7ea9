"""The distance of simulated records from measured ones, over all records and terms."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import xarray as xr

from calib.errors import CalibError, nearest
from calib.modelling.model import Model
from calib.modelling.simulator import Request
from calib.objective.blocks import Blocks
from calib.objective.initial_state import Released
from calib.objective.prepared_reference import PreparedReference, SensedRecord, on_drive_clock
from calib.objective.prepared_response import PreparedResponse
from calib.objective.scalar_features import FeatureValue
from calib.objective.terms import Reference, Score, Term
from calib.records import channels as channels_of
from calib.records import is_response
from calib.records.cycles import MotionKind

MAX_LINEAR_DISTANCE = 5.0  # from which on the cost rises more slowly than the distance
MAX_AGREEMENT_DISTANCE = 0.05  # from which the simulation does not agree, 0.10 being a curve 10 % too large  [1]
MIN_COST_OF_WRONG_KIND = 10.0  # of a motion; more than any of the right kind


class Objective:
    """Compare simulated records with references, term by term.

    The distance of a term is the root of the mean squared difference of its feature, in units of the feature's scale,
    over the samples of each channel and body and then over channels, bodies and records with equal weights: 10 % too
    large is 0.10. Where the reference states how its uncertainty varies within a channel, samples are weighted by 1 /
    sigma, of unit mean square. D, the root of the weighted mean of the squared distances of all terms, is the root of
    the summed squares of the residuals.

    The kind of motion comes first. Where a reference is period-n and the simulation of its record is not, the cost is
    at least 10, more than any cost of the right kind (at most 9): 10 (1 + r / (1 + r)) averaged over the wrong records
    plus D / (1 + D), r being the difference of the simulated states n periods apart over the amplitude. A motion that
    is undecided is wrong only where it settles towards another period.

    Everything of the references is computed once: a score of one record (2 bodies, 2 channels, 2400 samples) costs
    about 1 ms, 3 ms with the trigger of a motion with impacts, 4 ms with all nuisances.

    Parameters
    ----------
    references : by name; those of use "calibrate" are scored, the others can be aligned
    terms : what is compared
    elsewhere : what is compared of records that are not calibrated on, each of which such a term names

    Raises
    ------
    CalibError : the body, record or channel of a term is missing, or the excitation prescribes all that it compares
    """

    def __init__(self, references: Mapping[str, Reference], terms: Sequence[Term], elsewhere: Sequence[Term] = ()):
        self.references = {name: on_drive_clock(reference) for name, reference in references.items()}
        self.terms, self.elsewhere = _distinct(terms), tuple(elsewhere)
        if not self.terms:
            raise CalibError("an objective needs at least one term; name a feature to compare")
        self._prepared = {
            name: _prepared(reference, self.terms_of(name)) for name, reference in self.references.items()
        }
        self.references = {
            name: _in_whole_loops(reference, self._prepared[name].motion.period)
            for name, reference in self.references.items()
        }
        self.scored = [name for name, reference in self.references.items() if reference.use == "calibrate"]
        if not self.scored:
            raise CalibError('no reference is used to calibrate; set use = "calibrate" for one of them at least')
        self._blocks = [self._blocks_of(term) for term in self.terms]
        whole = sum(term.weight for term in self.terms)
        self._weights = [term.weight / whole for term in self.terms]

    @property
    def measured_kinds(self) -> dict[str, str]:
        """Kind of the measured motion of each scored reference by its name."""
        return {name: self._prepared[name].motion.kind for name in self.scored}

    @property
    def measured_periods(self) -> dict[str, int | None]:
        """Periods after which the measured motion of each scored reference returns, None where that is not known."""
        return {name: self._prepared[name].motion.period for name in self.scored}

    def _blocks_of(self, term: Term) -> list[Blocks]:
        for name in term.records or ():
            if name not in self.scored:
                raise CalibError(
                    f"term {term.label!r}: no record {name!r} to calibrate on{nearest(name, self.scored)}; "
                    f"there are {', '.join(self.scored)}"
                )
        blocks = [Blocks(term, name, self._prepared[name]) for name in term.records or self.scored]
        if not any(block.number for block in blocks):
            raise CalibError(
                f"term {term.label!r}: the excitation prescribes all that it compares, which is no evidence of fit; "
                "compare another body or channel"
            )
        return blocks

    def on(self, references: Mapping[str, Reference]) -> "Objective":
        """Return the same terms over other references, all of them scored, whatever their use.

        Records that terms elsewhere name are compared by these alone. Of the others a term of named records keeps those
        that are there; where none is, it is taken for all that it can compare.

        Raises
        ------
        CalibError : a term that names no records cannot compare one of these, or none of the others can
        """
        scored = {name: replace(reference, use="calibrate") for name, reference in references.items()}
        terms = [taken for term in self.elsewhere if (taken := _of(term, scored)).records]
        named = {name for term in terms for name in term.records or ()}
        rest, refusal = {name: reference for name, reference in scored.items() if name not in named}, None
        for term in self.terms if rest else ():
            taken = _of(term, rest)
            if named and not taken.records:
                taken = replace(taken, records=tuple(rest))
            try:
                if term.records is not None and not set(term.records) & set(rest):
                    Objective(rest, [taken])
            except CalibError as error:
                refusal = error
            else:
                terms.append(taken)
        try:
            if refusal is not None and not terms:
                raise refusal
            return Objective(scored, terms)
        except CalibError as error:
            remedy = f"give {', '.join(scored)} a term of its own, with records = {list(scored)}"
            raise CalibError(f"{error}; or {remedy}") from error

    def terms_of(self, name: str) -> Sequence[Term]:
        """Terms that compare a record: those elsewhere that name it, else those that name it or none, else all."""
        elsewhere = [term for term in self.elsewhere if name in (term.records or ())]
        return elsewhere or [t for t in self.terms if t.records is None or name in t.records] or self.terms

    def with_free_trigger(self, name: str) -> "Objective":
        """Return the same comparison with the trigger of the reference `name` among its nuisances."""
        reference = self.references[name]
        freed = replace(reference, nuisance=(*reference.nuisance, "trigger"))
        return Objective({**self.references, name: freed}, self.terms, self.elsewhere)

    def __call__(self, records: Mapping[str, xr.Dataset]) -> Score:
        """Score the simulated records, one for each scored reference; a failed one makes the cost infinite."""
        failure = self._first_failure(records)
        return self._score(self._sensed(records)) if failure is None else self._failed(*failure)

    def judged(self, records: Mapping[str, xr.Dataset]) -> tuple[Score, list[FeatureValue]]:
        """Score the records, and return the scalar features of the compared bodies, measured and simulated, with it.

        There are none where a run failed.
        """
        failure = self._first_failure(records)
        if failure is not None:
            return self._failed(*failure), []
        sensed = self._sensed(records)
        return self._score(sensed), self._features(sensed)

    def _sensed(self, records: Mapping[str, xr.Dataset]) -> dict[str, SensedRecord]:
        return {name: self._prepared[name].sensed(records[name]) for name in self.scored}

    def _failed(self, status: str, reason: str) -> Score:
        return Score(np.inf, {term.label: np.inf for term in self.terms}, status, reason)

    def _score(self, sensed: Mapping[str, SensedRecord]) -> Score:
        distances, residuals = list[float](), list[np.ndarray]()
        for blocks, weight in zip(self._blocks, self._weights, strict=True):
            square, parts = self._term(blocks, weight, sensed)
            distances.append(square)
            residuals += parts
        square = float(np.dot(self._weights, distances))
        labels = [term.label for term in self.terms]
        judged = {name: self._prepared[name].penalty(view.motion) for name, view in sensed.items()}
        penalties = {name: penalty for name, penalty in judged.items() if penalty is not None}
        return Score(
            cost=_cost(np.sqrt(square), list(penalties.values())),
            terms=dict(zip(labels, np.sqrt(distances).tolist(), strict=True)),
            kind=_joined({name: view.motion.kind for name, view in sensed.items()}),
            evidence=_joined(
                {name: self._evidence(name, view.motion, name in penalties) for name, view in sensed.items()}
            ),
            residuals=np.concatenate(residuals),
            nuisances={name: view.nuisances for name, view in sensed.items()},
            wrong=tuple(penalties),
        )

    def _first_failure(self, records: Mapping[str, xr.Dataset]) -> tuple[str, str] | None:
        for name in self.scored:
            if name not in records:
                raise CalibError(f"no simulated record for {name!r}{nearest(name, records)}; there are {list(records)}")
        for name in self.scored:
            failure = self._prepared[name].failure(records[name])
            if failure is not None:
                return failure
        return None

    def _term(
        self, blocks: Sequence[Blocks], weight: float, sensed: Mapping[str, SensedRecord]
    ) -> tuple[float, list[np.ndarray]]:
        """Squared distance of a term, and its residuals record by record."""
        active = [block.active(sensed[block.record].prescribed) for block in blocks]
        number = sum(int(a.sum()) for a in active)
        if not number:
            raise CalibError(
                f"term {blocks[0].term.label!r}: the simulator prescribes all that it compares; compare another body"
            )
        square, parts = 0.0, list[np.ndarray]()
        for block, mask in zip(blocks, active, strict=True):
            residual = block.residual(sensed[block.record], mask) / np.sqrt(number)
            square += float(residual @ residual)
            parts.append(np.sqrt(weight) * residual)
        return square, parts

    def _evidence(self, name: str, motion: MotionKind, wrong: bool) -> str:
        if not wrong:
            return motion.evidence
        return f"{motion.evidence}; the reference is {self._prepared[name].motion.kind}"

    def residuals(self, records: Mapping[str, xr.Dataset]) -> xr.DataArray:
        """Residuals (residual,) with coordinates term, record, body and channel; its squares add up to D^2.

        Raises
        ------
        CalibError : a record failed
        """
        score = self(records)
        if score.residuals is None:
            raise CalibError(f"a failed run has no residuals (status {score.status!r}: {score.reason})")
        names: dict[str, list[str]] = {key: [] for key in ("term", "record", "body", "channel")}
        for blocks in self._blocks:
            for block in blocks:
                for body, channel, size in block.layout:
                    for key, value in zip(names, (block.term.label, block.record, body, channel), strict=True):
                        names[key] += [value] * size
        coords = {key: ("residual", np.array(values, dtype=str)) for key, values in names.items()}
        return xr.DataArray(score.residuals, dims="residual", coords=coords)

    def aligned(self, name: str, record: xr.Dataset) -> xr.Dataset:
        """Return a simulated record on the time base of the reference `name`, its nuisances applied."""
        sensed = self._comparable(name, record).sensed(record)
        return sensed.record.assign_attrs({f"nuisance_{key}": value for key, value in sensed.nuisances.items()})

    def compared(self, name: str, record: xr.Dataset) -> xr.Dataset:
        """Return a simulated record as it is compared with `Reference.compared` sample by sample.

        That is `aligned`, but that of a response each point differs by its distance (`PreparedResponse.compared`).
        """
        prepared = self._comparable(name, record)
        return prepared.compared(record) if isinstance(prepared, PreparedResponse) else self.aligned(name, record)

    def _comparable(self, name: str, record: xr.Dataset) -> PreparedReference | PreparedResponse:
        """Reference `name`, with which a simulated record that did not fail can be compared."""
        if name not in self._prepared:
            raise CalibError(f"no reference {name!r}{nearest(name, self._prepared)}; there are {list(self._prepared)}")
        failure = self._prepared[name].failure(record)
        if failure is not None:
            status, reason = failure
            raise CalibError(f"a failed run cannot be aligned (status {status!r}: {reason})")
        return self._prepared[name]

    def released(
        self, name: str, model: Model, values: Mapping[str, float], request: Request | None = None
    ) -> Released:
        """Simulate the record `name` with the initial state that fits it best.

        Parameters
        ----------
        model : whose simulator says which of its parameters are the initial state
        values : of that record, in SI; those of the initial state are replaced
        request : instead of the reference's

        Raises
        ------
        CalibError : the simulator declares no initial state, or the state changes nothing that is compared
        """
        compared = self._prepared[name]
        return compared.released(model, values, request or compared.reference.request)

    def wrong_kind(self, name: str, record: xr.Dataset) -> str:
        """How the kind of motion of a simulated record differs from that of the reference `name`; "" if not."""
        compared = self._prepared[name]
        motion = compared.sensed(record).motion
        return self._evidence(name, motion, wrong=True) if compared.penalty(motion) is not None else ""

    def features(self, name: str, record: xr.Dataset) -> list[FeatureValue]:
        """Scalar features of all channels of the reference `name`, beside those of a simulated record."""
        compared = self._prepared[name]
        pairs = {(body, channel) for body in compared.bodies for channel in channels_of(compared.record)}
        return compared.features(pairs, compared.sensed(record))

    def _features(self, sensed: Mapping[str, SensedRecord]) -> list[FeatureValue]:
        features = []
        for name in self.scored:
            mine = [block for blocks in self._blocks for block in blocks if block.record == name]
            pairs = {pair for block in mine for pair in block.pairs}
            features += self._prepared[name].features(pairs, sensed[name])
        return features


def _prepared(reference: Reference, terms: Sequence[Term]) -> PreparedReference | PreparedResponse:
    return (PreparedResponse if is_response(reference.record) else PreparedReference)(reference, terms)


def _in_whole_loops(reference: Reference, period: int | None) -> Reference:
    """Return a reference whose request is for whole loops of its motion, which returns after `period` periods."""
    asked, loop = reference.request.periods, period or 1
    if asked % loop == 0:
        return reference
    return replace(reference, request=replace(reference.request, periods=-(-asked // loop) * loop))


def _of(term: Term, references: Mapping[str, Reference]) -> Term:
    """Return a term of those of its records that are among the references; of all where none is."""
    return replace(term, records=tuple(name for name in term.records or () if name in references) or None)


def _distinct(terms: Sequence[Term]) -> list[Term]:
    """Terms with labels of which no two are equal."""
    distinct: list[Term] = []
    for term in terms:
        label, number = term.label, 1
        while label in {other.label for other in distinct}:
            number += 1
            label = f"{term.label} ({number})"
        distinct.append(term if number == 1 else replace(term, label=label))
    return distinct


def _cost(distance: float, penalties: Sequence[float]) -> float:
    if penalties:
        return float(MIN_COST_OF_WRONG_KIND * (1.0 + np.mean(penalties)) + distance / (1.0 + distance))
    beyond = (distance - MAX_LINEAR_DISTANCE) / 4.0
    return float(distance if beyond <= 0.0 else MAX_LINEAR_DISTANCE + 4.0 * beyond / (1.0 + beyond))


def _joined(texts: Mapping[str, str]) -> str:
    if len(set(texts.values())) == 1:
        return next(iter(texts.values()))
    return "; ".join(f"{name}: {text}" for name, text in texts.items())
