"""Whether an HDF5 file holds all of its data itself.

netCDF follows external links, external storage and virtual datasets without saying so, and has no call that tells them;
HDF5, on which it stands, has.
"""

import ctypes
import functools
import importlib
import os
from pathlib import Path

from calib.errors import CalibError

HARD_LINK, SOFT_LINK, EXTERNAL_LINK = 0, 1, 64  # H5L_type_t
GROUP, DATASET = 2, 5  # H5I_type_t
VIRTUAL_LAYOUT = 3  # H5D_layout_t
INDEX_BY_NAME, INCREASING, READ_ONLY, DEFAULT = 0, 0, 0, 0  # H5_INDEX_NAME, H5_ITER_INC, H5F_ACC_RDONLY, H5P_DEFAULT
LINK_INFO_BYTES = 128  # more than sizeof(H5L_info2_t), whose first member is the type
MAX_NAME_BYTES = 1024  # of a link; netCDF's names have 256 at most
CLASSIC_SIGNATURE = b"CDF"  # of a netCDF-3 file, which is no HDF5 and cannot refer to other files
REMEDY = "copy the data into one file (`nccopy` does) and read that"
Handle = ctypes.c_int64  # hid_t


@functools.cache
def _library() -> ctypes.CDLL:
    """The HDF5 that netCDF4 has loaded, found through the extension module that depends on it."""
    library = ctypes.CDLL(importlib.import_module("netCDF4._netCDF4").__file__)
    for name in ("H5Fopen", "H5Oopen", "H5Dget_create_plist"):
        getattr(library, name).restype = Handle
    library.H5Lget_name_by_idx.restype = ctypes.c_ssize_t
    library.H5open()
    library.H5Eset_auto2(Handle(0), None, None)  # errors are returned, not printed
    return library


def refuse_other_files(path: Path) -> None:
    """Check that every object of the root group lies in the file itself, where the file is HDF5.

    Raises
    ------
    CalibError : not a readable file, a link that is not a plain one, a group, or data that lie in other files
    """
    with open(path, "rb") as stored:
        if stored.read(len(CLASSIC_SIGNATURE)) == CLASSIC_SIGNATURE:
            return
    library = _library()
    file = library.H5Fopen(os.fsencode(path), ctypes.c_uint(READ_ONLY), Handle(DEFAULT))
    if file < 0:
        raise CalibError(f"{path}: not a readable netCDF file (no HDF5 file, or a damaged one); make it again")
    try:
        index = 0
        while (name := _name(library, file, index)) is not None:
            _check_link(library, file, name, str(path))
            index += 1
    finally:
        library.H5Fclose(Handle(file))


def _name(library: ctypes.CDLL, file: int, index: int) -> bytes | None:
    """Name of a link of the root group, None behind the last."""
    buffer = ctypes.create_string_buffer(MAX_NAME_BYTES)
    size = library.H5Lget_name_by_idx(
        Handle(file), b"/", INDEX_BY_NAME, INCREASING, ctypes.c_uint64(index), buffer,
        ctypes.c_size_t(MAX_NAME_BYTES), Handle(DEFAULT),
    )  # fmt: skip
    return buffer.value if size >= 0 else None


def _check_link(library: ctypes.CDLL, file: int, name: bytes, path: str) -> None:
    shown = name.decode(errors="replace")
    info = (ctypes.c_int * (LINK_INFO_BYTES // ctypes.sizeof(ctypes.c_int)))()
    if library.H5Lget_info2(Handle(file), name, info, Handle(DEFAULT)) < 0:
        raise CalibError(f"{path}: {shown}: not a readable netCDF file (a damaged link); make it again")
    if info[0] != HARD_LINK:
        kind = {SOFT_LINK: "a soft link", EXTERNAL_LINK: "an external link"}.get(info[0], f"a link of type {info[0]}")
        raise CalibError(f"{path}: {shown}: expected data in the file itself, got {kind}; {REMEDY}")
    entity = library.H5Oopen(Handle(file), name, Handle(DEFAULT))
    if entity < 0:
        raise CalibError(f"{path}: {shown}: not a readable netCDF file (a damaged object); make it again")
    try:
        kind = library.H5Iget_type(Handle(entity))
        if kind == GROUP:
            raise CalibError(f"{path}: {shown}: expected variables only, got a group; move its variables to the root")
        if kind == DATASET:
            _check_storage(library, entity, f"{path}: {shown}")
    finally:
        library.H5Oclose(Handle(entity))


def _check_storage(library: ctypes.CDLL, dataset: int, where: str) -> None:
    properties = library.H5Dget_create_plist(Handle(dataset))
    try:
        if library.H5Pget_layout(Handle(properties)) == VIRTUAL_LAYOUT:
            raise CalibError(f"{where}: expected data in the file itself, got a virtual dataset; {REMEDY}")
        if library.H5Pget_external_count(Handle(properties)) > 0:
            raise CalibError(f"{where}: expected data in the file itself, got external storage; {REMEDY}")
    finally:
        library.H5Pclose(Handle(properties))
