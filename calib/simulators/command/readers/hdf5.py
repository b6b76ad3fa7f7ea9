"""The reader of HDF5 files."""

import math
from functools import partial
from pathlib import Path

import h5py
import numpy as np

from calib.errors import CalibError
from calib.execution.apart import read_apart
from calib.execution.hdf5 import stored_datasets
from calib.execution.interrupt import uninterrupted
from calib.execution.netcdf import MAX_DATASET_BYTES, UNREADABLE
from calib.simulators.command.readers.columns import Columns
from calib.simulators.command.readers.histories import Names
from calib.simulators.command.readers.rows import Step
from calib.simulators.command.readers.series import REAL, chosen, clock, columns_of_arrays


def read(path: Path, /, *, time: str | None = None, step: Step | None = None, columns: Names | None = None) -> Columns:
    """HDF5: arrays with as many samples as time, in any groups.

    A column is called by the path of its dataset, ``"results/tip"``, and the place in an array with further axes,
    counted from 1: ``"results/u[3]"``. Links and data in other files are refused.

    Parameters
    ----------
    time : path of the dataset that is time; without it "time" or "t"
    step : time between the samples, in the unit of time, where no dataset is time; the first axis of all is then time
    columns : names of those that are read; without it all

    Raises
    ------
    CalibError : no HDF5 file, no such dataset, more than 1 GiB
    """
    try:
        with uninterrupted():
            arrays = read_apart(partial(_stored_arrays, path, time, step, columns), path)
    except UNREADABLE as error:
        raise CalibError(f"{path}: not a readable HDF5 file ({error}); did the program stop?") from error
    return columns_of_arrays(path, arrays, time, step, columns)


def _stored_arrays(
    path: Path,
    time: str | None,
    step: float | None,
    columns: Names | None,
) -> dict[str, np.ndarray]:
    """Return the arrays of real numbers that have the samples of time, and time itself, as they are stored.

    Raises
    ------
    CalibError : more than `MAX_DATASET_BYTES` in memory, no array that is time
    """
    with h5py.File(path, "r") as file:
        return _arrays(file, path, time, step, columns)


def _arrays(
    file: h5py.File,
    path: Path,
    time: str | None,
    step: float | None,
    columns: Names | None,
) -> dict[str, np.ndarray]:
    datasets = {
        name: dataset for name, dataset in stored_datasets(file, path) if dataset.dtype.kind in REAL and dataset.shape
    }
    own = None if step is not None else clock(path, datasets, time)
    is_chosen = chosen(path, columns, datasets)
    samples = None if own is None else datasets[own].size
    used = [
        name
        for name, dataset in datasets.items()
        if name == own or (is_chosen(name) and (samples is None or samples in dataset.shape))
    ]
    size = 0
    for name in used:
        size += _bytes(datasets[name])
        if size > MAX_DATASET_BYTES:
            raise CalibError(
                f"{path}: {name}: expected at most {MAX_DATASET_BYTES / 2**30:g} GiB in all arrays, got "
                f"{size / 2**30:.3g} GiB; choose some by columns = [...], or write fewer steps"
            )
    return {name: datasets[name][()] for name in used}


def _bytes(dataset: h5py.Dataset) -> int:
    """Bytes that a dataset takes in memory, at least those of one chunk of it."""
    chunk = math.prod(dataset.chunks) if dataset.chunks else 0
    return max(8, dataset.dtype.itemsize) * max(dataset.size, chunk)  # numbers become doubles
