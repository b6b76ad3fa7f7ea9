"""The values that a calibration has found, from its files."""

from collections.abc import Mapping
from pathlib import Path

from calib.errors import CalibError
from calib.study import result
from calib.study_file import StudyFile


def calibrated_values(file: StudyFile, folder: Path) -> Mapping[str, float]:
    """Return the values (SI) of a study whose results are in a folder: those that it holds, and those that were found.

    Raises
    ------
    CalibError : the study was not calibrated, ended without values, or was changed since
    """
    calibration = result.read(folder)
    if calibration is None:
        raise CalibError(f"there is no {result.FILE_NAME} in {folder}: calibrate first, with `calib run {file.path}`")
    if not calibration.values:
        raise CalibError(f"no trial of the study in {folder} ended well: there are no values; see `calib status`")
    missing = [name for name in file.study.space.names if name not in calibration.values]
    if missing:
        raise CalibError(
            f"{folder / result.FILE_NAME} has no value of {missing[0]}, which the study searches: it was changed "
            f"since; run `calib run {file.path}` again"
        )
    return {**file.study.space.fixed, **calibration.values}
