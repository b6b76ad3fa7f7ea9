"""MATLAB 7.3 files as MATLAB writes them: HDF5 behind a header of 512 bytes, arrays with their axes reversed."""

import struct
from collections.abc import Mapping
from pathlib import Path

import h5py
import numpy as np

HEADER_BYTES = 512  # bytes before HDF5 begins


def save_73(path: Path, variables: Mapping[str, object]) -> None:
    """Write variables: arrays, text, object arrays as cells, mappings as structures, lists of mappings as arrays."""
    with h5py.File(path, "w", userblock_size=HEADER_BYTES) as file:
        for name, value in variables.items():
            _write(file, file, name, value)
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + struct.pack("<H", 0x0200) + b"IM")


def _write(file: h5py.File, group: h5py.Group, name: str, value: object) -> None:
    if isinstance(value, Mapping):
        inner = group.create_group(name)
        for key, own in value.items():
            _write(file, inner, key, own)
        inner.attrs["MATLAB_class"] = np.bytes_("struct")
    elif isinstance(value, list):
        inner = group.create_group(name)
        for key in value[0]:
            fields = np.empty((1, len(value)), object)
            fields[0] = [one[key] for one in value]
            inner[key] = _references(file, fields)
        inner.attrs["MATLAB_class"] = np.bytes_("struct")
    elif isinstance(value, np.ndarray) and value.dtype == object:
        group[name] = _references(file, value)
        group[name].attrs["MATLAB_class"] = np.bytes_("cell")
    else:
        _write_array(group, name, value)


def _references(file: h5py.File, cells: np.ndarray) -> np.ndarray:
    """References (reversed axes) to what the elements of an array are, which is written into MATLAB's own group."""
    own = file.require_group("#refs#")
    found = np.empty(cells.shape, h5py.ref_dtype)
    for index in np.ndindex(cells.shape):
        name = f"r{len(own)}"
        _write(file, own, name, cells[index])
        found[index] = own[name].ref
    return found.T


def _write_array(group: h5py.Group, name: str, value: object) -> None:
    kind = "char" if isinstance(value, str) else "double"
    array = np.atleast_2d(np.frombuffer(value.encode("utf-16-le"), "<u2") if isinstance(value, str) else value)
    if array.dtype.kind == "c":
        parts = np.empty(array.shape, [("real", "f8"), ("imag", "f8")])
        parts["real"], parts["imag"] = array.real, array.imag
        array = parts
    group[name] = np.array(array.shape, "u8") if array.size == 0 else array.T
    if array.size == 0:
        group[name].attrs["MATLAB_empty"] = np.uint8(1)
    group[name].attrs["MATLAB_class"] = np.bytes_(kind)
