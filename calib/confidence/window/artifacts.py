"""The files of a window: its document and its arrays."""

from pathlib import Path

import xarray as xr

from calib.confidence.window.document import WindowResult, read_window
from calib.execution.netcdf import read_dataset

WINDOW_DATA = "window.nc"


def read_drawn_window(folder: Path) -> tuple[WindowResult, xr.Dataset] | None:
    """Return document and arrays of the window in a folder; None where one of them is missing.

    Raises
    ------
    CalibError : a file holds something else
    """
    result = read_window(folder)
    if result is None or not (folder / WINDOW_DATA).is_file():
        return None
    return result, read_dataset(folder / WINDOW_DATA)
