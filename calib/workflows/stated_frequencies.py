"""Records of a study that repeat themselves at another frequency than their excitation is said to have."""

from collections.abc import Iterator

from calib.records import is_response
from calib.report.record_description import doubtful_frequency
from calib.study_file import StudyFile


def doubtful_frequencies(file: StudyFile) -> Iterator[str]:
    """Warn of each such record, held out or not, in a sentence."""
    for name, reference in {**file.study.objective.references, **file.others}.items():
        frequency = reference.excitation.frequency
        if not is_response(reference.record) and frequency is not None:
            doubt = doubtful_frequency(reference.record.assign_attrs(frequency=frequency), f"record {name!r}")
            if doubt is not None:
                yield doubt
