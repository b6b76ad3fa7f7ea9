"""The values that a calibration has found, from its files, and the command that finds them."""

from collections.abc import Mapping
from pathlib import Path

from calib.errors import CalibError
from calib.store import read
from calib.study import result
from calib.study_file import StudyFile, results_folder
from calib.workflows.command_line import command_line


def calibrated_values(file: StudyFile, folder: Path) -> Mapping[str, float]:
    """Return the values (SI) of a study whose results are in a folder: those that it holds, and those that were found.

    Raises
    ------
    CalibError : the study was not calibrated, ended without values, or was changed since
    """
    calibration = result.read(folder)
    if calibration is None:
        command = calibration_command(file.path, folder)
        raise CalibError(f"there is no {result.FILE_NAME} in {folder}: calibrate first, with `{command}`")
    if not calibration.values:
        raise CalibError(f"no trial of the study in {folder} ended well: there are no values; see `calib status`")
    try:
        read(folder, file.study.header.definition)
    except CalibError as error:
        raise CalibError(
            f"{error}\nto begin afresh is `{calibration_command(file.path, folder, '--fresh')}`"
        ) from error
    return {**file.study.space.fixed, **calibration.values}


def calibration_command(study: Path, folder: Path, *flags: str) -> str:
    """Return the command line that calibrates a study file with its results in a folder, which is named if need be."""
    return command_line("run", study, *(() if folder == results_folder(study) else ("--out", folder)), *flags)
