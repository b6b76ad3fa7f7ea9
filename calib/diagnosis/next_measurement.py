"""The measurement that best separates causes which the records leave indistinguishable."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from calib.diagnosis.bench import Bench
from calib.diagnosis.design_search import DesignSearch
from calib.diagnosis.laboratory import (
    DesignRegion,
    DesignVariable,
    Laboratory,
    alike,
    amplitude_of,
    base_record,
    inapplicable_tests,
    largest_levels,
    regions,
)
from calib.diagnosis.measurement import EvaluatedPoint, Measurement
from calib.diagnosis.part import Part
from calib.diagnosis.refit import Fitter
from calib.diagnosis.separation import with_free_form, with_steps
from calib.diagnosis.suspect import Refitted
from calib.objective import Reference
from calib.study import Pool

MAX_MODELS = 4  # rival models that are compared  [count]


@dataclass(frozen=True)
class RecordedPoint:
    """Amplitude [its unit] and frequency [Hz] of an existing record."""

    record: str
    amplitude: float | None
    frequency: float | None


@dataclass(frozen=True)
class Design:
    """A search for the next measurement.

    Attributes
    ----------
    record : on which the measurement is based
    models : names of the rival models that are compared
    variables : settings that were searched, with their bounds
    points : all that were evaluated
    measurements : the best of each kind of test, the best first
    unavailable : kind of test -> why it has no measurement
    known : records with the same kind of excitation
    simulations, max_simulations : number that it took, and its limit
    """

    record: str
    models: tuple[str, ...]
    variables: tuple[DesignVariable, ...]
    points: tuple[EvaluatedPoint, ...]
    measurements: tuple[Measurement, ...]
    unavailable: Mapping[str, str]
    known: tuple[RecordedPoint, ...]
    simulations: int
    max_simulations: int


def next_measurement(
    pool: Pool, bench: Bench, fitter: Fitter, rivals: Sequence[Refitted], laboratory: Laboratory
) -> Design | None:
    """Search the region of the laboratory for the largest separation of the two least distinguishable rivals.

    Each kind of test is evaluated on a regular grid and then refined about its best point by a pattern search (Kolda,
    Lewis and Torczon 2003, SIAM Review 45, 385-482). The measurement is based on the first record that is driven
    harmonically, or on the first. None where there are fewer than two rivals. The search takes no more simulations than
    the budget of the diagnosis leaves.
    """
    suspects = rivals[:MAX_MODELS]
    if len(suspects) < 2:
        return None
    fits = [with_steps(fitter.with_derivatives(with_free_form(suspect.fit))) for suspect in suspects]
    references = {name: bench.objective.references[name] for name in fitter.evidence.names}
    part = next(p for p in fitter.evidence.parts if p.name == base_record(references))
    searched = regions(laboratory, references, bench.model, part)
    most = int(min(laboratory.simulations, fitter.effort.left))
    search = DesignSearch(pool, bench, part, fits, replace(laboratory, simulations=most), lambda: fitter.effort.left)
    search.run(searched)
    return Design(
        record=part.name,
        models=tuple(suspect.name for suspect in suspects),
        variables=_variables(searched),
        measurements=tuple(search.measurements(searched)),
        points=tuple(evaluation.outcome for evaluation in search.evaluations),
        unavailable={
            **inapplicable_tests(laboratory, references, bench.model, part),
            **{test: reason for test in searched if (reason := search.unavailable(test))},
        },
        known=_known(references, part),
        simulations=search.simulations,
        max_simulations=most,
    )


def _variables(searched: Mapping[str, DesignRegion]) -> tuple[DesignVariable, ...]:
    """Settings that were searched, each once."""
    named = {v.name: v for region in searched.values() for v in region.variables}
    return tuple(named.values())


def _known(references: Mapping[str, Reference], part: Part) -> tuple[RecordedPoint, ...]:
    """Existing records with the same kind of excitation, over time as the base is, or each level of its responses."""
    base = references[part.name]
    if base.is_swept:
        records = {name: reference.record for name, reference in alike(references, base).items()}
        levels = {name: largest_levels(record) for name, record in records.items()}
        return tuple(RecordedPoint(name, level, None) for name, own in levels.items() for level in sorted(set(own)))
    return tuple(
        RecordedPoint(name, amplitude_of(r.excitation), r.excitation.frequency if r.excitation.harmonic else None)
        for name, r in alike(references, base).items()
    )
