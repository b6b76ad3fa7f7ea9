"""The values that a calibration has found, from its files, and the command that finds them."""

from collections.abc import Mapping
from pathlib import Path

from calib.errors import CalibError
from calib.store import read
from calib.store.lock import Lock, is_locked
from calib.study import result
from calib.study_file import StudyFile, located, results_folder
from calib.workflows.command_line import command_line


def folder_of_results(path: str | Path, out: str | Path | None) -> Path:
    """Folder of the results of a study that is not loaded yet; `path` and `out` as in `calib.study_file.load`.

    Raises
    ------
    CalibError : there is no such study file
    """
    return results_folder(located(path)) if out is None else Path(out)


def check_free(folder: Path) -> None:
    """Refuse a folder in which another process writes, before what takes long.

    Raises
    ------
    CalibError : a process writes there; the message names it
    """
    if is_locked(folder):
        lock = Lock(folder)
        lock.acquire()
        lock.release()  # the process has ended meanwhile


def check_calibrated(path: str | Path, folder: Path) -> None:
    """Refuse a study that has no result in its folder; neither is its file read, nor are its records.

    Raises
    ------
    CalibError : it was not calibrated; the message holds the command that does
    """
    if not (folder / result.FILE_NAME).is_file():
        raise _uncalibrated(located(path), folder)


def calibrated_values(file: StudyFile, folder: Path) -> Mapping[str, float]:
    """Return the values (SI) of a study whose results are in a folder: those that it holds, and those that were found.

    Raises
    ------
    CalibError : the study was not calibrated, ended without values, or was changed since
    """
    calibration = result.read(folder)
    if calibration is None:
        raise _uncalibrated(file.path, folder)
    if not calibration.values:
        raise CalibError(f"no trial of the study in {folder} ended well: there are no values; see `calib status`")
    try:
        read(folder, file.study.header.definition)
    except CalibError as error:
        raise CalibError(
            f"{error}\nto begin afresh is `{calibration_command(file.path, folder, '--fresh')}`"
        ) from error
    return {**file.study.space.fixed, **calibration.values}


def _uncalibrated(study: Path, folder: Path) -> CalibError:
    command = calibration_command(study, folder)
    return CalibError(f"there is no {result.FILE_NAME} in {folder}: calibrate first, with `{command}`")


def calibration_command(study: Path, folder: Path, *flags: str) -> str:
    """Return the command line that calibrates a study file with its results in a folder, which is named if need be."""
    return command_line("run", study, *(() if folder == results_folder(study) else ("--out", folder)), *flags)
