"""Damaged MATLAB files are refused before SciPy reads them, which would end the process."""

import io
import struct

import numpy as np
import pytest
from scipy.io import savemat
from scipy.sparse import csc_array

from calib.errors import CalibError
from calib.records.matlab import matlab_arrays
from calib.records.matlab_elements import DamagedElementError, readable_variables

CELLS = np.empty((1, 2), object)
CELLS[0, 0], CELLS[0, 1] = np.ones(3), "text"
VARIABLES = {
    "x": np.arange(9.0),
    "z": np.ones(3) * 1j,
    "label": "by hand",
    "cells": CELLS,
    "out": {"tip": np.ones(3), "more": {"deep": 1.0}},
    "sparse": csc_array(np.eye(3)),
    "small": np.int8(3),
}


def saved(**options):
    file = io.BytesIO()
    savemat(file, VARIABLES, **options)
    return file.getvalue()


@pytest.mark.parametrize("compressed", [False, True])
def test_variables_of_numbers_text_cells_and_structures_are_readable(tmp_path, compressed):
    content = saved(do_compression=compressed)
    assert readable_variables(content) == [name for name in VARIABLES if name != "sparse"]
    arrays, unread = matlab_arrays(tmp_path, content)
    assert not unread
    np.testing.assert_array_equal(arrays["x"].ravel(), np.arange(9.0))
    assert arrays["cells{1,1}"].size == 3


def test_other_versions_have_no_such_elements():
    file = io.BytesIO()
    savemat(file, {"x": np.arange(3.0)}, format="4")
    assert readable_variables(file.getvalue().ljust(200, b"\0")) is None


def test_an_element_whose_type_cannot_be_is_refused():
    content = bytearray(saved())
    at = content.index(struct.pack("<II", 9, 72))  # the numbers of x
    struct.pack_into("<I", content, at, 0x2A09)
    with pytest.raises(DamagedElementError, match="expected an element of one of the types"):
        readable_variables(bytes(content))
    with pytest.raises(CalibError, match="x.mat: not a readable MATLAB v5 file"):
        matlab_arrays("x.mat", bytes(content))


@pytest.mark.parametrize("compressed", [False, True])
def test_a_file_with_any_byte_changed_or_cut_off_is_read_or_refused(compressed):
    content = saved(do_compression=compressed)
    rng = np.random.default_rng(7)
    for place in rng.integers(0, len(content), 400).tolist():
        changed = bytearray(content)
        changed[place] = int(rng.integers(256))
        for damaged in (bytes(changed), content[:place]):
            try:
                matlab_arrays("x.mat", damaged)
            except CalibError as error:
                if not str(error).startswith("x.mat: "):
                    raise
