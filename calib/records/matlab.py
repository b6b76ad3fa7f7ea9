"""The vectors of a MATLAB v5 file."""

import io
import zlib
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from calib.errors import CalibError
from calib.execution.netcdf import UNREADABLE
from calib.records.matlab_elements import readable_variables
from calib.records.sheet import Cells, Sheet

# what scipy raises on content that it cannot decode
DAMAGED = (*UNREADABLE, MatReadError, zlib.error)


def read_matlab(path: Path, content: bytes) -> Sheet:
    """Return the vectors of numbers of a MATLAB v5 file by name, those in a cell array by the name of their cell.

    Raises
    ------
    CalibError : not a readable MATLAB v5 file
    """
    arrays = matlab_arrays(path, content)
    columns: dict[str | int, Cells] = {name: value.ravel() for name, value in arrays.items() if _is_vector(value)}
    return Sheet(path, columns, None, unfit={n: _described(n, v) for n, v in arrays.items() if n not in columns})


def matlab_arrays(path: Path, content: bytes) -> dict[str, np.ndarray]:
    """Return the arrays of a MATLAB v5 file by name, and those in cell arrays by the name of their cell: "x{3,2}".

    Raises
    ------
    CalibError : not a readable MATLAB v5 file, or more than 1 GiB of variables
    """
    try:
        variables = loadmat(io.BytesIO(content), variable_names=readable_variables(content))
    except NotImplementedError as error:
        raise CalibError(f"{path}: MATLAB 7.3 files are not read; save it with `save -v7`") from error
    except DAMAGED as error:
        raise CalibError(f"{path}: not a readable MATLAB v5 file ({error})") from error
    arrays = {name: value for name, value in variables.items() if isinstance(value, np.ndarray)}
    return arrays | {name: cell for key, value in arrays.items() for name, cell in _cells(key, value).items()}


def _cells(name: str, array: np.ndarray) -> dict[str, np.ndarray]:
    """Arrays in a cell array by the names that MATLAB gives them, ``"x{3,2}"``; none of another array."""
    if array.dtype.kind != "O":
        return {}
    indices = (",".join(str(i + 1) for i in index) for index in np.ndindex(array.shape))
    pairs = zip(indices, array.flat, strict=True)
    return {f"{name}{{{index}}}": cell for index, cell in pairs if isinstance(cell, np.ndarray)}


def _is_vector(array: np.ndarray) -> bool:
    """Whether an array is a row or a column of numbers."""
    return array.dtype.kind in "buif" and sorted(array.shape)[:-1] == [1] * (array.ndim - 1) and array.size > 1


def _described(name: str, array: np.ndarray) -> str:
    """Describe an array that is not a column."""
    shape = " x ".join(map(str, array.shape))
    if array.dtype.kind == "O":
        return f"a cell array of {shape}; name one of its cells, such as '{name}{{1,1}}'"
    kind = "numbers" if array.dtype.kind in "buif" else "text" if array.dtype.kind in "US" else "no numbers"
    return f"an array of {shape}, {kind}; a column is one row or one column of numbers"
