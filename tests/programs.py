"""Programs of the machine that tests run."""

import os
import shutil

import pytest


def required(program: str) -> str:
    """Path of a program; where it is absent the test skips, or fails if CALIB_PROGRAMS_REQUIRED is set."""
    path = shutil.which(program)
    if path is not None:
        return path
    reason = f"the program {program!r} is not installed"
    if os.environ.get("CALIB_PROGRAMS_REQUIRED"):
        pytest.fail(reason)
    pytest.skip(reason)
