"""The reader of NumPy's files .npy and .npz."""

import math
import tokenize
import zipfile
import zlib
from pathlib import Path
from typing import IO

import numpy as np
from numpy.lib import format as npy

from calib.errors import CalibError
from calib.execution.netcdf import MAX_DATASET_BYTES, UNREADABLE
from calib.simulators.command.readers.columns import Columns
from calib.simulators.command.readers.histories import Names
from calib.simulators.command.readers.rows import Column, Step
from calib.simulators.command.readers.series import columns_of_arrays

# what numpy and zipfile raise on content that they cannot decode
DAMAGED = (*UNREADABLE, EOFError, SyntaxError, tokenize.TokenError, zipfile.BadZipFile, zlib.error)
SUFFIX = ".npy"  # of an array in an archive
FIRST = "1"  # name of the first column of a table without names


def read(
    path: Path,
    /,
    *,
    transpose: bool = False,
    time: Column | None = None,
    step: Step | None = None,
    columns: Names | None = None,
) -> Columns:
    """NumPy's .npy, a table with one row for each instant, and .npz, arrays with as many samples as time.

    A column of a table is called by its position counted from 1, ``"3"``, or by its field; one of an archive by its
    array, ``"tip"``, and the place in an array with further axes, counted from 1: ``"u[3]"``.

    Parameters
    ----------
    transpose : whether a table has one row for each quantity, and one column for each instant
    time : name or position of the column, or name of the array, that is time; without it "time" or "t", and of a table
        without names the first column
    step : time between the samples, in the unit of time, where none of them is time
    columns : names of those that are read; without it all

    Raises
    ------
    CalibError : no such file, one that is cut off, no such column, objects that are no numbers, more than 1 GiB
    """
    try:
        if zipfile.is_zipfile(path):
            arrays = _archive(path)
        else:
            with open(path, "rb") as file:
                arrays = _table(path, _array(path, file, path.stat().st_size), transpose)
    except DAMAGED as error:
        raise CalibError(f"{path}: not a readable file of NumPy ({error}); did the program stop?") from error
    if time is None and step is None and FIRST in arrays:
        time = FIRST
    return columns_of_arrays(path, arrays, None if time is None else str(time), step, columns)


def _archive(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays of a .npz by name."""
    with zipfile.ZipFile(path) as archive:
        members = [member for member in archive.infolist() if member.filename.endswith(SUFFIX)]
        size = sum(member.file_size for member in members)
        if size > MAX_DATASET_BYTES:
            raise CalibError(_too_large(path, size))
        arrays = {}
        for member in members:
            with archive.open(member) as file:
                arrays[member.filename.removesuffix(SUFFIX)] = _array(path, file, member.file_size)
    return arrays


def _array(path: Path, file: IO[bytes], size: int) -> np.ndarray:
    """Read one array from `size` bytes, which is looked at before anything is allocated."""
    version = npy.read_magic(file)
    header = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, fortran_order, dtype = header(file)
    if dtype.hasobject:
        raise CalibError(f"{path}: expected arrays of numbers, got objects; save them as numbers")
    count = math.prod(shape)
    stored = count * dtype.itemsize
    if min(shape, default=0) < 0 or stored > size:
        raise CalibError(f"{path}: expected {stored} bytes of numbers, got at most {size}; did the program stop?")
    if count * max(8, dtype.itemsize) > MAX_DATASET_BYTES:  # numbers become doubles
        raise CalibError(_too_large(path, count * max(8, dtype.itemsize)))
    content = file.read(stored)
    if len(content) < stored:
        raise CalibError(f"{path}: expected {stored} bytes of numbers, got {len(content)}; did the program stop?")
    return np.frombuffer(content, dtype).reshape(shape, order="F" if fortran_order else "C")


def _too_large(path: Path, size: int) -> str:
    bound = f"{MAX_DATASET_BYTES / 2**30:g} GiB"
    return f"{path}: expected at most {bound} of numbers, got {size / 2**30:.3g} GiB; write fewer steps"


def _table(path: Path, table: np.ndarray, transpose: bool) -> dict[str, np.ndarray]:
    """Return the columns of a table by field, or by position counted from 1."""
    if table.dtype.names is not None and table.ndim == 1:
        return {name: table[name] for name in table.dtype.names}
    if table.ndim == 1:
        table = table[:, np.newaxis]
    if table.ndim != 2:
        raise CalibError(f"{path}: expected a table, one row for each instant, got an array of shape {table.shape}")
    return {str(i): column for i, column in enumerate(table if transpose else table.T, 1)}
