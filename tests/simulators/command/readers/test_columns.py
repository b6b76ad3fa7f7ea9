"""What a reader returns is columns of real numbers of one length."""

import numpy as np
import pytest

from calib.errors import CalibError
from calib.simulators.command.readers import Columns


def test_columns_are_taken_as_floats_and_nan_is_passed_on():
    columns = Columns([0, 1], {"tip": [np.nan, 2]})
    np.testing.assert_array_equal(columns.time, [0.0, 1.0])
    np.testing.assert_array_equal(columns.values["tip"], [np.nan, 2.0])


@pytest.mark.parametrize(
    ("message", "time", "values"),
    [
        ("at least one sample", [], {}),
        ("expected real numbers of shape \\(n,\\), got float64 of shape \\(1, 2\\)", [[0.0, 1.0]], {}),
        ("'tip': expected real numbers", [0.0], {"tip": ["one"]}),
        ("'tip': expected real numbers", [0.0], {"tip": [1j]}),
        ("'tip': expected real numbers", [0.0], {"tip": None}),
        ("'tip': expected a row of real numbers", [0.0], {"tip": [[1.0], [1.0, 2.0]]}),
        ("expected 1 samples as of time, got 2", [0.0], {"tip": [1.0, 2.0]}),
        ("expected columns by name", [0.0], [1.0]),
        ("expected columns by name", [0.0], {1: [1.0]}),
    ],
)
def test_anything_else_is_refused(message, time, values):
    with pytest.raises(CalibError, match=message):
        Columns(time, values)
