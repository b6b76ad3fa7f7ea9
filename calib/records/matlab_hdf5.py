"""The variables of a MATLAB 7.3 file, which is HDF5, in the layout in which SciPy returns those of version 5.

Arrays are stored with their axes in reverse order and an attribute MATLAB_class. Characters are stored as numbers,
complex numbers as pairs, cells as references to datasets; a structure is a group of its fields, each a dataset of
references in an array of structures; of an empty array the shape is stored in its place.
"""

import io
import math
from dataclasses import dataclass

import h5py
import numpy as np

from calib.execution.hdf5 import check_own_data, entry
from calib.records.matlab_elements import MAX_EXPANDED_BYTES, MAX_NESTING, DamagedElementError

SIGNATURE = b"\x89HDF\r\n\x1a\n"  # of HDF5
USER_BLOCKS = (512, 0)  # bytes before the signature: MATLAB's, and none
INTERNAL = "#"  # begins the names of groups that MATLAB makes for itself
CLASS, EMPTY = "MATLAB_class", "MATLAB_empty"  # attributes
OPAQUE = ("MATLAB_object_decode", "MATLAB_sparse")  # attributes of what SciPy does not return as arrays either
COMPLEX_PARTS = ("real", "imag")  # fields of a pair
REFERENCE_BYTES = 64  # bytes that an element of a cell array takes in memory, about


def is_hdf5(content: bytes) -> bool:
    """Whether the content of a MATLAB file is that of version 7.3."""
    return any(content[size : size + len(SIGNATURE)] == SIGNATURE for size in USER_BLOCKS)


def hdf5_variables(name: str, content: bytes) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Return the variables by name, and why others are not read.

    They are arrays of numbers or text, object arrays of cells, and arrays with fields. Objects, sparse matrices and
    what goes beyond `MAX_EXPANDED_BYTES` are not read.

    Parameters
    ----------
    name : of the file, for what is said of it

    Raises
    ------
    CalibError : links, or data that lie in other files
    DamagedElementError : cells within one another without an end
    OSError, RuntimeError, LookupError, ValueError, TypeError : a damaged file
    """
    with h5py.File(io.BytesIO(content), "r") as file:
        walk, found, unread = _Hdf5Walk(file, name, MAX_EXPANDED_BYTES), dict[str, np.ndarray](), dict[str, str]()
        for key in (key for key in file if not key.startswith(INTERNAL)):
            left = walk.left
            try:
                array = walk.within(file, key, 0)
            except _TooLargeError:
                walk.left, array = left, None
                limit = f"{MAX_EXPANDED_BYTES / 2**30:.3g} GiB"
                unread[key] = f"too large: with what is read before it, it has more than {limit}; keep fewer samples"
            if array is not None:
                found[key] = array
            else:
                unread.setdefault(key, _refused(file[key]))
    return found, unread


class _TooLargeError(Exception):
    """More than may be read."""


@dataclass
class _Hdf5Walk:
    """A way through a file, from variable to cell and field; `left` bytes may be taken in memory."""

    file: h5py.File
    name: str
    left: int

    def within(self, group: h5py.Group, key: str, nesting: int) -> np.ndarray | None:
        """Array of an entry of a group."""
        return self._array(entry(group, key, f"{self.name}: {key}"), nesting)

    def _array(self, own: object, nesting: int) -> np.ndarray | None:
        if nesting > MAX_NESTING:
            raise DamagedElementError(f"expected cells and structures within one another {MAX_NESTING} times at most")
        if not isinstance(own, h5py.Group | h5py.Dataset) or any(mark in own.attrs for mark in OPAQUE):
            return None
        if isinstance(own, h5py.Dataset) and own.shape is None:
            return None
        if isinstance(own, h5py.Group):
            return self._structure(own, nesting)
        check_own_data(own, f"{self.name}: {own.name}")
        self._take(own.dtype.itemsize * max(own.size, math.prod(own.chunks or (0,))))
        if EMPTY in own.attrs:
            return np.empty(own[()].ravel() if 0 in own[()] else 0)
        if h5py.check_ref_dtype(own.dtype) is h5py.Reference:
            return self._cells(own, nesting)
        array = np.asarray(own[()]).T
        if own.dtype.names == COMPLEX_PARTS:
            return np.asarray(array["real"] + 1j * array["imag"])
        return _text(array) if _class(own) == "char" else array

    def _cells(self, own: h5py.Dataset, nesting: int) -> np.ndarray:
        """Object array of what the elements of a dataset of references refer to."""
        self._take(REFERENCE_BYTES * own.size)
        references = np.asarray(own[()]).T
        cells = np.empty(references.shape, object)
        for index in np.ndindex(references.shape):
            cells[index] = self._array(self.file[references[index]], nesting + 1) if references[index] else None
        return cells

    def _structure(self, own: h5py.Group, nesting: int) -> np.ndarray:
        """Array with fields; of shape (1, 1) unless all fields are references that are no cells."""
        fields = {key: entry(own, key, f"{self.name}: {own.name}/{key}") for key in own}
        several = bool(fields) and all(_is_of_several(field) for field in fields.values())
        values = {
            key: self._cells(field, nesting) if several else self._array(field, nesting + 1)
            for key, field in fields.items()
        }
        shapes = {array.shape for array in values.values() if array is not None} if several else {(1, 1)}
        if len(shapes) > 1:
            raise DamagedElementError(f"expected as many elements of each field of {own.name}, got {sorted(shapes)}")
        self._take(REFERENCE_BYTES * len(fields))
        structure = np.empty(shapes.pop(), [(key, object) for key in fields])
        for key, value in values.items():
            if several:
                structure[key] = value
            else:
                structure[key][0, 0] = value
        return structure

    def _take(self, count: int) -> None:
        self.left -= count
        if self.left < 0:
            raise _TooLargeError


def _is_of_several(field: object) -> bool:
    """Whether a field of a group is that of an array of structures."""
    if not isinstance(field, h5py.Dataset) or _class(field) or EMPTY in field.attrs:
        return False
    return h5py.check_ref_dtype(field.dtype) is h5py.Reference


def _refused(own: object) -> str:
    """Why an entry is not read."""
    if not isinstance(own, h5py.Group | h5py.Dataset):
        return "no variable"
    if "MATLAB_sparse" in own.attrs:
        return "a sparse matrix; save it as full(...)"
    kind = _class(own) or "object"
    return f"a MATLAB {kind}; save its numbers as arrays, or as a structure, such as table2struct(T, 'ToScalar', true)"


def _class(own: h5py.Dataset | h5py.Group) -> str:
    stated = own.attrs.get(CLASS, b"")
    return stated.decode("ascii", "replace") if isinstance(stated, bytes) else str(stated)


def _text(codes: np.ndarray) -> np.ndarray:
    """Lines of an array of characters, one for each of its rows."""
    rows = np.atleast_2d(codes).reshape(-1, codes.shape[-1]) if codes.size else np.empty((0, 0), int)
    return np.array(["".join(map(chr, row)) for row in rows.tolist()], dtype=str)
