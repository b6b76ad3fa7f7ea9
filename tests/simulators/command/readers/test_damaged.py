"""A file with any bytes changed, lost or doubled is read, or refused by name, in little memory."""

import random
import tracemalloc

import numpy as np
import pytest
import xarray as xr
from output_formats import FORMATS, TIME

from calib.errors import CalibError
from calib.simulators.command.readers import reader

TRIES = [4, pytest.param(12, marks=pytest.mark.slow)]
MAX_PEAK_BYTES = 2**26  # bytes: none of the files holds more than 10 kB


def damaged(content, rng):
    """Cut the content off, cut out of it, double a part of it, or change some of its bytes."""
    at, length = rng.randrange(len(content)), rng.randrange(1, 200)
    match rng.randrange(6):
        case 0:
            return content[:at]
        case 1:
            return content[:at] + content[at + length :]
        case 2:
            return content[: at + length] + content[at:]
    changed = bytearray(content)
    for _ in range(rng.choice([1, 2, 10])):
        changed[rng.randrange(len(content))] = rng.choice([*b'\n *9-E"', 0, 127, 128, 255, rng.randrange(256)])
    return bytes(changed)


@pytest.mark.parametrize("tries", TRIES)
@pytest.mark.parametrize("form", FORMATS.values(), ids=FORMATS)
def test_damaged_files_are_read_or_refused_by_name(tmp_path, form, tries):
    read, path, rng, options = reader(form.reader), tmp_path / form.file, random.Random(7), form.options
    form.write(path)
    content = path.read_bytes()
    assert len(read(path, **options).values) > 0
    tracemalloc.start()
    try:
        for _ in range(tries):
            path.write_bytes(damaged(content, rng))
            try:
                read(path, **options)
            except CalibError as error:
                if str(tmp_path) not in str(error) or "failed:" in str(error):
                    raise
        assert tracemalloc.get_traced_memory()[1] < MAX_PEAK_BYTES
    finally:
        tracemalloc.stop()


def test_a_netcdf_file_that_is_cut_off_is_refused_by_name(tmp_path):
    path = tmp_path / "out.nc"
    for version in ("NETCDF4", "NETCDF3_64BIT"):
        xr.Dataset({"u": ("time", TIME)}, {"time": TIME}).to_netcdf(path, format=version)
        content = path.read_bytes()
        for size in np.linspace(0, len(content) - 20, 9, dtype=int).tolist():
            path.write_bytes(content[:size])
            with pytest.raises(CalibError, match="out.nc"):
                reader("netcdf")(path)
