"""The vectors of a MATLAB file."""

import io
import zlib
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from calib.errors import CalibError
from calib.execution.apart import read_apart
from calib.execution.interrupt import uninterrupted
from calib.execution.netcdf import UNREADABLE
from calib.records.matlab_elements import readable_variables
from calib.records.matlab_hdf5 import hdf5_variables, is_hdf5
from calib.records.sheet import Cells, Sheet

# what scipy raises on content that it cannot decode
DAMAGED = (*UNREADABLE, MatReadError, zlib.error)
MAX_MATRIX_COLUMNS = 1000  # of a matrix, that are columns of a sheet


def read_matlab(path: Path, content: bytes) -> Sheet:
    """Return the vectors of numbers of a MATLAB file by name, as `matlab_arrays` names them.

    The columns of a matrix are "x(:,2)", the parts of complex numbers "real(x)" and "imag(x)".

    Raises
    ------
    CalibError : not a readable MATLAB file, or more than 1 GiB of variables
    """
    if is_hdf5(content):
        try:
            with uninterrupted():
                arrays, unread = read_apart(partial(matlab_arrays, path, content), path)
        except OSError as error:
            raise CalibError(f"{path}: not a readable MATLAB 7.3 file ({error})") from error
    else:
        arrays, unread = matlab_arrays(path, content)
    columns: dict[str | int, Cells] = {key: column for n, v in arrays.items() for key, column in _columns(n, v)}
    described = {name: _described(name, array) for name, array in arrays.items() if name not in columns}
    unfit: dict[str | int, str] = dict([*unread.items(), *described.items()])
    return Sheet(path, columns, None, unfit=unfit)


def matlab_arrays(path: Path, content: bytes) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Return the arrays of a MATLAB file by name, and why variables of one of version 7.3 are not read.

    Arrays in cells and structures are named as MATLAB names them: "x{3,2}" for a cell, "s.force" for the field of a
    structure, "s(2).force" for that of the second structure in a row or column of them, and so on within one another.

    Raises
    ------
    CalibError : not a readable MATLAB file, or more than 1 GiB of variables
    """
    hdf5, unread = is_hdf5(content), dict[str, str]()
    try:
        if hdf5:
            variables, unread = hdf5_variables(str(path), content)
        else:
            variables = loadmat(io.BytesIO(content), variable_names=readable_variables(content))
    except DAMAGED as error:
        raise CalibError(f"{path}: not a readable MATLAB {'7.3' if hdf5 else 'v5'} file ({error})") from error
    named = ((name, value) for name, value in variables.items() if isinstance(value, np.ndarray))
    return dict(part for name, value in named for part in _within(name, value)), unread


def _within(name: str, array: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """An array, and those in its cells or fields, by the names that MATLAB gives them."""
    yield name, array
    if array.dtype.names:
        for index in np.ndindex(array.shape):
            for field in array.dtype.names:
                inner = array[field][index]
                if isinstance(inner, np.ndarray):
                    yield from _within(f"{name}{_element(index, array.shape)}.{field}", inner)
    elif array.dtype.kind == "O":
        for index in np.ndindex(array.shape):
            if isinstance(array[index], np.ndarray):
                yield from _within(f"{name}{{{_subscripts(index)}}}", array[index])


def _subscripts(index: tuple[int, ...]) -> str:
    return ",".join(str(i + 1) for i in index)


def _element(index: tuple[int, ...], shape: tuple[int, ...]) -> str:
    """Subscript of one structure of several: one number in a row or column."""
    if np.prod(shape) == 1:
        return ""
    return f"({max(index) + 1})" if _in_line(shape) else f"({_subscripts(index)})"


def _in_line(shape: tuple[int, ...]) -> bool:
    """Whether an array is one row or one column."""
    return sorted(shape)[:-1] == [1] * (len(shape) - 1)


def _columns(name: str, array: np.ndarray) -> Iterator[tuple[str, Cells]]:
    """Columns that an array of numbers is, by name."""
    if array.dtype.kind not in "buifc" or array.size < 2:
        return
    columns = {name: array.ravel()}
    if not _in_line(array.shape):
        few = array.ndim == 2 and array.shape[1] <= MAX_MATRIX_COLUMNS
        columns = {f"{name}(:,{k})": column for k, column in enumerate(array.T, 1)} if few else {}
    for key, column in columns.items():
        if array.dtype.kind == "c":
            yield f"real({key})", column.real
            yield f"imag({key})", column.imag
        else:
            yield key, column


def _described(name: str, array: np.ndarray) -> str:
    """Describe an array that is not a column."""
    shape = " x ".join(map(str, array.shape))
    if array.dtype.names:
        first = f"{name}{_element((0,) * array.ndim, array.shape)}.{array.dtype.names[0]}"
        return f"a structure of {shape} with the fields {', '.join(array.dtype.names)}; name one, such as {first!r}"
    if array.dtype.kind == "O":
        return f"a cell array of {shape}; name one of its cells, such as '{name}{{1,1}}'"
    kind = "numbers" if array.dtype.kind in "buif" else "text" if array.dtype.kind in "US" else "no numbers"
    if array.dtype.kind == "c":
        return f"an array of {shape}, complex numbers; name one of its parts, such as 'real({name})'"
    matrix = kind == "numbers" and array.ndim == 2 and min(array.shape) > 1
    remedy = f", such as '{name}(:,1)'" if matrix else ""
    return f"an array of {shape}, {kind}; a column is one row or one column of numbers{remedy}"
