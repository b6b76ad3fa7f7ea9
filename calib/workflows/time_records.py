"""Commands that take records over time only."""

from calib.errors import CalibError
from calib.records import is_response
from calib.study_file import StudyFile


def check_time_records(file: StudyFile, command: str) -> StudyFile:
    """Return a study, none of whose records is a frequency response.

    Raises
    ------
    CalibError : one is
    """
    known = {**file.study.objective.references, **file.others}
    responses = [name for name, reference in known.items() if is_response(reference.record)]
    if responses:
        raise CalibError(
            f"{file.path}: record {responses[0]!r} is a frequency response, and `calib {command}` takes records over "
            "time only; leave it out of the study, or use `calib run`, `confidence`, `diagnose`, `discover` or "
            "`rehearse`, which take it"
        )
    return file
