"""netCDF files: read whole once their content is known to be safe to read, and written whole."""

import errno
import math
from functools import cache, partial
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import xarray as xr
from scipy.io import netcdf_file

from calib.errors import CalibError
from calib.execution.apart import read_apart
from calib.execution.files import whole
from calib.execution.hdf5 import refuse_other_files
from calib.execution.interrupt import uninterrupted

MAX_DATASET_BYTES = 2**30  # bytes of all variables in memory: 33 million samples of two channels of two bodies
CLASSIC_VERSIONS = (b"CDF\1", b"CDF\2")  # signatures of classic files that SciPy reads too
CLASSIC_BYTES = 4  # bytes of a signature
TEXT_BYTES = 64  # bytes that a short text takes in memory, about
# what xarray and netCDF4 raise on content that they cannot decode
UNREADABLE = (OSError, ArithmeticError, AttributeError, LookupError, MemoryError, RuntimeError, TypeError, ValueError)


def read_dataset(path: str | Path) -> xr.Dataset:
    """Read a netCDF file whole.

    Raises
    ------
    CalibError : no such file, not a readable netCDF file, data that lie in other files, variables that are neither
        numbers nor text, attributes that are no plain values, or more than `MAX_DATASET_BYTES`
    """
    path = Path(path)
    if not path.exists():
        raise CalibError(f"{path}: no such file")
    if not path.is_file():
        raise CalibError(f"{path}: expected a netCDF file, got a folder or a device; name the file")
    try:
        # interrupted while it takes its locks, xarray would wait for itself for ever
        with uninterrupted():
            _import_array_packages()
            return read_apart(partial(_read, path), path)
    except UNREADABLE as error:
        raise CalibError(f"{path}: not a readable netCDF file ({error}); it may be truncated: make it again") from error


@cache
def _import_array_packages() -> None:
    """Import the packages of arrays that are installed (dask, pint), as xarray does where it first computes.

    Done here, it is done once, and not by each process that is forked to read a file.
    """
    xr.Dataset({"x": ("x", np.zeros(1))}).astype(np.float32)


def _read(path: Path) -> xr.Dataset:
    refuse_other_files(path)
    _check_classic(path)
    _check_content(path)
    with xr.open_dataset(path, engine="netcdf4", decode_times=False) as stored:
        return stored.load()


def write_dataset(dataset: xr.Dataset, path: str | Path) -> None:
    """Write netCDF-4 so that the file is either whole or absent.

    Raises
    ------
    OSError : it cannot be written; it names `path`
    """
    with whole(Path(path)) as temporary, uninterrupted():  # as in `read_dataset`
        try:
            dataset.to_netcdf(temporary, engine="netcdf4")
        except RuntimeError as error:  # as netCDF reports a full disk
            raise OSError(errno.EIO, f"the file cannot be written ({error}); is the disk full?") from error


def _check_classic(path: Path) -> None:
    """Check that a classic file holds what its header says: the netCDF library reads zeros where it is cut off.

    Raises
    ------
    CalibError : more than `MAX_DATASET_BYTES`
    UNREADABLE : a header that is damaged, or fewer data than it says
    """
    with open(path, "rb") as file:
        if file.read(CLASSIC_BYTES) not in CLASSIC_VERSIONS:
            return
    size = path.stat().st_size
    if size > MAX_DATASET_BYTES:
        raise CalibError(f"{path}: expected at most {MAX_DATASET_BYTES / 2**30:g} GiB, got {size / 2**30:.3g} GiB")
    netcdf_file(path, mmap=False).close()


def _check_content(path: Path) -> None:
    """Check types and sizes by what the file declares, before any value is read."""
    with netCDF4.Dataset(path) as file:
        _check_attributes(file, str(path))
        size = 0
        for name, variable in file.variables.items():
            where = f"{path}: {name}"
            _check_attributes(variable, where)
            size += _bytes(variable, where)
            if size > MAX_DATASET_BYTES:
                raise CalibError(
                    f"{where}: expected at most {MAX_DATASET_BYTES / 2**30:g} GiB in all variables, got shape "
                    f"{variable.shape} and with it {size / 2**30:.3g} GiB; "
                    "cut the record, or keep every so many-th sample"
                )


def _bytes(variable: netCDF4.Variable, where: str) -> int:
    """Bytes that a variable takes in memory, at least those of one chunk of it."""
    kind = variable.datatype
    if variable.dtype is str:
        width = TEXT_BYTES
    elif isinstance(kind, np.dtype) and kind.kind in "fiuS":
        width = max(8, kind.itemsize)  # numbers become doubles
    else:
        raise CalibError(f"{where}: expected real numbers or text, got {_described(kind)}; write it as 64-bit floats")
    chunk = variable.chunking()
    chunked = math.prod(chunk) if isinstance(chunk, list | tuple) else 0
    return width * max(math.prod(variable.shape), chunked)


def _described(kind: Any) -> str:
    """Describe a type of netCDF that is neither number nor text."""
    names = {
        netCDF4.CompoundType: "a compound type",
        netCDF4.VLType: "a variable-length type",
        netCDF4.EnumType: "an enumeration",
    }
    if isinstance(kind, np.dtype) and kind.kind == "c":
        return "complex numbers"
    return next((name for known, name in names.items() if isinstance(kind, known)), f"{kind}")


def _check_attributes(holder: netCDF4.Dataset | netCDF4.Variable, where: str) -> None:
    for name in holder.ncattrs():
        try:
            value = holder.getncattr(name)
        except UNREADABLE as error:
            raise CalibError(
                f"{where}: attribute {name}: expected a text or a number, got another type ({error}); drop it"
            ) from error
        plain = isinstance(value, str | int | float | np.number) or (
            isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind in "fiu"
        )
        texts = isinstance(value, list) and all(isinstance(text, str) for text in value)
        if not plain and not texts:
            kind = f"{value.dtype} of shape {value.shape}" if isinstance(value, np.ndarray) else type(value).__name__
            raise CalibError(f"{where}: attribute {name}: expected a text or numbers, got {kind}; drop it")
