"""Whether an HDF5 file holds all of its data itself.

netCDF follows external links, external storage and virtual datasets without saying so, and has no call that tells them.
"""

from pathlib import Path

import h5py

from calib.errors import CalibError

CLASSIC_SIGNATURE = b"CDF"  # of a netCDF-3 file, which is no HDF5 and cannot refer to other files
REMEDY = "copy the data into one file (`nccopy` does) and read that"
KINDS = {h5py.SoftLink: "a soft link", h5py.ExternalLink: "an external link"}


def refuse_other_files(path: Path) -> None:
    """Check that every object of the root group lies in the file itself, where the file is HDF5.

    Raises
    ------
    CalibError : a link that is not a plain one, a group, or data that lie in other files
    OSError, RuntimeError, KeyError, UnicodeDecodeError : no HDF5 file, or a damaged one
    """
    with open(path, "rb") as stored:
        if stored.read(len(CLASSIC_SIGNATURE)) == CLASSIC_SIGNATURE:
            return
    with h5py.File(path, "r") as file:
        for name in file:
            _check(file, name, f"{path}: {name}")


def _check(file: h5py.File, name: str, where: str) -> None:
    link = file.get(name, getlink=True)
    if not isinstance(link, h5py.HardLink):
        kind = KINDS.get(type(link), "a link of another kind")
        raise CalibError(f"{where}: expected data in the file itself, got {kind}; {REMEDY}")
    entity = file[name]
    if isinstance(entity, h5py.Group):
        raise CalibError(f"{where}: expected variables only, got a group; move its variables to the root")
    if isinstance(entity, h5py.Dataset):
        if entity.is_virtual:
            raise CalibError(f"{where}: expected data in the file itself, got a virtual dataset; {REMEDY}")
        if entity.external:
            raise CalibError(f"{where}: expected data in the file itself, got external storage; {REMEDY}")
