"""The [[term]] of a study file: what is compared, of records that are calibrated on and of others."""

from collections.abc import Mapping
from dataclasses import replace

from calib import plugins
from calib.objective import Objective, Reference, Term
from calib.study_file.made import made
from calib.study_file.mistakes import Mistakes
from calib.study_file.schema import StudyToml


def read_terms(
    shape: StudyToml, known: Mapping[str, Reference] | None, mistakes: Mistakes
) -> tuple[list[Term], list[Term]]:
    """Make every [[term]], of records that are calibrated on, and of others that it names.

    known : all records; None where some have mistakes, against which no term can be checked
    """
    terms, elsewhere = [], []
    for index, entry in enumerate(shape.term):
        key = ("term", index)
        if mistakes.within(*key):
            continue
        feature = None
        with mistakes.at(*key, "feature"):
            maker = plugins.load("calib.features", entry.feature, mistakes.modules)
            feature = made(maker, entry.options, entry.feature, mistakes, key)
        if feature is None or known is None:
            continue
        term = Term(
            feature=feature,
            bodies=None if entry.bodies is None else tuple(entry.bodies),
            records=None if entry.records is None else tuple(entry.records),
            weight=entry.weight,
        )
        with mistakes.at(*key):
            own, further = _by_use(term, known)
            if own is not None:  # each alone, so that its refusal names this line
                Objective({name: one for name, one in known.items() if one.use == "calibrate"}, [own])
            if further is not None:
                Objective({name: replace(one, use="calibrate") for name, one in known.items()}, [further])
            terms += [] if own is None else [own]
            elsewhere += [] if further is None else [further]
    return terms, elsewhere


def _by_use(term: Term, known: Mapping[str, Reference]) -> tuple[Term | None, Term | None]:
    """Parts of a term of records that are calibrated on, and of others that it names; None where there is none."""
    others = tuple(name for name in term.records or () if name in known and known[name].use != "calibrate")
    if not others:
        return term, None
    own = tuple(name for name in term.records or () if name not in others)
    return replace(term, records=own, label="") if own else None, replace(term, records=others, label="")
