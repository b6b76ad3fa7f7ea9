"""A record in a netCDF file."""

from pathlib import Path

import xarray as xr

from calib.execution.netcdf import read_dataset, write_dataset
from calib.records.record import OK
from calib.records.response_table import SUFFIXES, read_response
from calib.records.schema import check


def read(path: str | Path) -> xr.Dataset:
    """Read and check a record from a netCDF file, or a frequency response from delimited text; SI in any case.

    Raises
    ------
    CalibError : no such file, not a readable one, or not a record
    """
    if Path(path).suffix.lower() in SUFFIXES:
        return read_response(path)
    record = read_dataset(path)
    record.attrs.setdefault("status", OK)
    return check(record, str(path))


def write(record: xr.Dataset, path: str | Path) -> None:
    """Write a record as netCDF-4 so that the file is either whole or absent."""
    write_dataset(record, path)
