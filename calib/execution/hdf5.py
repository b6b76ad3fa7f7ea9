"""HDF5 files: whether one holds all of its data itself, and which data it holds.

netCDF follows external links, external storage and virtual datasets without saying so, and has no call that tells them.
"""

from collections.abc import Iterator
from pathlib import Path

import h5py

from calib.errors import CalibError

CLASSIC_SIGNATURE = b"CDF"  # of a netCDF-3 file, which is no HDF5 and cannot refer to other files
REMEDY = "copy the data into one file (`nccopy` does) and read that"
KINDS = {h5py.SoftLink: "a soft link", h5py.ExternalLink: "an external link"}
MAX_GROUPS = 10_000  # groups of one file


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
            where = f"{path}: {name}"
            if isinstance(entry(file, name, where), h5py.Group):
                raise CalibError(f"{where}: expected variables only, got a group; move its variables to the root")


def stored_datasets(file: h5py.File, path: Path) -> Iterator[tuple[str, h5py.Dataset]]:
    """Yield the datasets of a file and of its groups, by their path: "group/name".

    A group that is reached twice is visited once.

    Raises
    ------
    CalibError : a link that is not a plain one, data that lie in other files, or more than `MAX_GROUPS` groups
    OSError, RuntimeError, KeyError, UnicodeDecodeError : a damaged file
    """
    todo = [("", file["/"])]
    visited = set()
    while todo:
        prefix, group = todo.pop()
        address = h5py.h5o.get_info(group.id).addr
        if address in visited:
            continue
        visited.add(address)
        if len(visited) > MAX_GROUPS:
            raise CalibError(f"{path}: expected at most {MAX_GROUPS} groups")
        for name in group:
            entity = entry(group, name, f"{path}: {prefix}{name}")
            if isinstance(entity, h5py.Group):
                todo.append((f"{prefix}{name}/", entity))
            elif isinstance(entity, h5py.Dataset):
                yield f"{prefix}{name}", entity


def entry(group: h5py.Group, name: str, where: str) -> object:
    """Return an entry of a group, whose data lie in the file itself.

    Raises
    ------
    CalibError : a link that is not a plain one, or data that lie in other files
    """
    link = group.get(name, getlink=True)
    if not isinstance(link, h5py.HardLink):
        kind = KINDS.get(type(link), "a link of another kind")
        raise CalibError(f"{where}: expected data in the file itself, got {kind}; {REMEDY}")
    entity = group[name]
    if isinstance(entity, h5py.Dataset):
        check_own_data(entity, where)
    return entity


def check_own_data(dataset: h5py.Dataset, where: str) -> None:
    """Check that the data of a dataset lie in the file itself.

    Raises
    ------
    CalibError : they lie in other files
    """
    if dataset.is_virtual:
        raise CalibError(f"{where}: expected data in the file itself, got a virtual dataset; {REMEDY}")
    if dataset.external:
        raise CalibError(f"{where}: expected data in the file itself, got external storage; {REMEDY}")
