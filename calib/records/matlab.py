"""The vectors of a MATLAB v5 file."""

import io
import struct
import zlib
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from calib.errors import CalibError
from calib.execution.netcdf import UNREADABLE
from calib.records.sheet import Cells, Sheet

MAX_EXPANDED_BYTES = 2**30  # bytes of all variables: 67 million samples of two channels
CHUNK_BYTES = 2**20  # bytes that are expanded at once
HEADER_BYTES = 128  # bytes before the first element of a file of version 5
ORDER_MARK = slice(126, 128)  # of the header
BYTE_ORDERS = {b"IM": "<", b"MI": ">"}
TAG_FORMAT = "II"  # type and number of bytes of an element
TAG_BYTES = struct.calcsize(f"<{TAG_FORMAT}")  # bytes
COMPRESSED = 15  # type of an element
# what scipy raises on content that it cannot decode
DAMAGED = (*UNREADABLE, MatReadError, struct.error, zlib.error)


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
    CalibError : not a readable MATLAB v5 file, or more than `MAX_EXPANDED_BYTES`
    """
    try:
        _check_expanded(path, content)
        variables = loadmat(io.BytesIO(content))
    except NotImplementedError as error:
        raise CalibError(f"{path}: MATLAB 7.3 files are not read; save it with `save -v7`") from error
    except DAMAGED as error:
        raise CalibError(f"{path}: not a readable MATLAB v5 file ({error})") from error
    arrays = {name: value for name, value in variables.items() if isinstance(value, np.ndarray)}
    return arrays | {name: cell for key, value in arrays.items() for name, cell in _cells(key, value).items()}


def _check_expanded(path: Path, content: bytes) -> None:
    """Bound what the compressed elements of a file, which follow its header one after the other, expand to."""
    byte_order = BYTE_ORDERS.get(content[ORDER_MARK])
    if byte_order is None:  # version 4, which compresses nothing
        return
    begin, size = HEADER_BYTES, len(content)
    while begin + TAG_BYTES <= len(content):
        kind, length = struct.unpack_from(byte_order + TAG_FORMAT, content, begin)
        begin += TAG_BYTES
        if kind == COMPRESSED:
            expander = zlib.decompressobj()
            rest = content[begin : begin + length]
            while rest:
                size += len(expander.decompress(rest, CHUNK_BYTES))
                rest = expander.unconsumed_tail
                if size > MAX_EXPANDED_BYTES:
                    raise CalibError(
                        f"{path}: expected at most {MAX_EXPANDED_BYTES / 2**30:g} GiB of variables; keep fewer samples"
                    )
        begin += length


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
