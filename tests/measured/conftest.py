"""Where the measured data lie."""

import os
from pathlib import Path

import pytest

BESIDE = Path(__file__).parents[3] / "shared" / "data"  # beside the checkout


@pytest.fixture(scope="session")
def measured():
    """Return the path of a measured file, or skip the test where it is absent (fail, with CALIB_DATA_REQUIRED set)."""
    folder = Path(os.environ.get("CALIB_DATA") or BESIDE)

    def find(name: str) -> Path:
        path = folder / name
        if not path.is_file():
            absent = (
                f"{path} is absent; set CALIB_DATA to the folder of the measured data (see the README of the study)"
            )
            (pytest.fail if os.environ.get("CALIB_DATA_REQUIRED") else pytest.skip)(absent)
        return path

    return find
