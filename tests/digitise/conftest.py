"""Where the exports of other tools lie: not in this repository, for their licences are not its own."""

import os
from pathlib import Path

import pytest

BESIDE = Path(__file__).parents[3] / "shared" / "data"


@pytest.fixture(scope="session")
def samples():
    """Folder of the digitiser samples; their tests are skipped where it is not there."""
    folder = Path(os.environ.get("CALIB_DATA") or BESIDE) / "digitiser-samples"
    if not folder.is_dir():
        pytest.skip(f"{folder} is not there; CALIB_DATA names the folder of the data")
    return folder
