"""The reader of netCDF files."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from calib.errors import CalibError
from calib.execution.netcdf import read_dataset
from calib.simulators.command.readers.columns import Columns
from calib.simulators.command.readers.histories import Names
from calib.simulators.command.readers.rows import Step
from calib.simulators.command.readers.series import REAL, Series, clock, columns_of


def read(path: Path, /, *, time: str | None = None, step: Step | None = None, columns: Names | None = None) -> Columns:
    """NetCDF: variables over the dimension of time, as numbers in the file's units.

    A column is called by its variable, ``"tip"``, and where this has further dimensions by the place along them: the
    label of a coordinate that is text, ``"displacement[tip]"``, else counted from 1, ``"u[3]"``. Groups, and data in
    other files, are refused.

    Parameters
    ----------
    time : variable that is time; without it "time" or "t"
    step : time between the samples, in the unit of time, where no variable is time; `time` is then the dimension
    columns : names of those that are read; without it all

    Raises
    ------
    CalibError : no netCDF file, no such variable, more than 1 GiB
    """
    dataset = read_dataset(path)
    if step is not None:
        dimension = clock(path, [str(name) for name in dataset.sizes], time)
        instants = np.arange(dataset.sizes[dimension]) * step
    else:
        own = clock(path, [str(name) for name in dataset.variables], time)
        if dataset[own].ndim != 1:
            raise CalibError(f"{path}: {own}: expected a variable over one dimension as time, got {dataset[own].dims}")
        dimension = str(dataset[own].dims[0])
        instants = dataset[own].values
    series = {
        str(name): _series(dataset, variable, dimension)
        for name, variable in dataset.variables.items()
        if dimension in variable.dims and variable.dtype.kind in REAL and (step is not None or name != own)
    }
    return columns_of(path, instants, series, columns)


def _series(dataset: xr.Dataset, variable: xr.Variable, dimension: str) -> Series:
    ordered = variable.transpose(dimension, ...)
    return Series(ordered.values, [_labels(dataset, str(name)) for name in ordered.dims[1:]])


def _labels(dataset: xr.Dataset, dimension: str) -> Sequence[str] | None:
    """Labels along a dimension, where its coordinate is text without brackets and commas."""
    if dimension not in dataset.variables or dataset[dimension].dtype.kind not in "OUS":
        return None
    labels = [
        one.decode("utf-8", "replace") if isinstance(one, bytes) else str(one) for one in dataset[dimension].values
    ]
    plain = len(set(labels)) == len(labels) and not any(mark in label for label in labels for mark in "[],")
    return labels if plain else None
