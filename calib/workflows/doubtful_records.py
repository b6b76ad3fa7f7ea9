"""Records of a study that contradict what is said of them."""

from collections.abc import Iterator

from calib.records import is_response
from calib.report.record_description import (
    doubtful_control,
    doubtful_frequency,
    doubtful_phase,
    doubtful_uncertainties,
)
from calib.study_file import StudyFile


def doubtful_records(file: StudyFile) -> Iterator[str]:
    """Warn of each such record, held out or not, in a sentence."""
    for name, reference in {**file.study.objective.references, **file.others}.items():
        excitation, called = reference.excitation, f"record {name!r}"
        if is_response(reference.record):
            told = reference.record.assign_attrs(place=excitation.place, quantity=excitation.quantity)
            doubt = doubtful_phase(told, called)
        elif excitation.frequency is not None:
            doubt = doubtful_frequency(reference.record.assign_attrs(frequency=excitation.frequency), called)
        else:
            doubt = None
        if doubt is not None:
            yield doubt
        yield from doubtful_uncertainties(reference.record, called)
        yield from doubtful_control(reference.record, called)
