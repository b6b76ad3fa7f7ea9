"""The reader of MATLAB's .mat files."""

from functools import partial
from pathlib import Path

from calib.errors import CalibError
from calib.execution.apart import read_apart
from calib.execution.interrupt import uninterrupted
from calib.execution.netcdf import MAX_DATASET_BYTES, UNREADABLE
from calib.records.matlab import matlab_arrays
from calib.simulators.command.readers.columns import Columns
from calib.simulators.command.readers.histories import Names
from calib.simulators.command.readers.lines import check_size
from calib.simulators.command.readers.rows import Step
from calib.simulators.command.readers.series import columns_of_arrays


def read(path: Path, /, *, time: str | None = None, step: Step | None = None, columns: Names | None = None) -> Columns:
    """MATLAB's .mat: variables with as many samples as time.

    A column is called by its variable, ``"tip"``, the place in a matrix, counted from 1 along what is not time,
    ``"u[3]"``, the place in a cell array, ``"x{3,2}"``, or the field of a structure, ``"out.tip"``.

    Parameters
    ----------
    time : variable that is time; without it "time" or "t"
    step : time between the samples, in the unit of time, where no variable is time; the first axis of all is then time
    columns : names of those that are read; without it all

    Raises
    ------
    CalibError : no such file, one that is cut off, no such variable, more than 1 GiB
    """
    check_size(path, MAX_DATASET_BYTES)
    try:
        with uninterrupted():
            arrays, unread = read_apart(partial(matlab_arrays, path, path.read_bytes()), path)
    except UNREADABLE as error:
        raise CalibError(f"{path}: not a readable MATLAB file ({error}); did the program stop?") from error
    for name in unread.keys() & {time, *(columns or ())}:
        raise CalibError(f"{path}: {name}: {unread[name]}")
    return columns_of_arrays(path, arrays, time, step, columns)
