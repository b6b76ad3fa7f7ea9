"""The reference records come from the tables beside them."""

import runpy
import shutil
from pathlib import Path

import pytest

from calib.records import read

ROOT = Path(__file__).parents[2] / "experiments_ref"
NAMES = ["clapping", "louder", "slower", "quiet"]


@pytest.mark.parametrize("folder", ["clapping_minimal", "clapping_beam"])
def test_the_script_of_a_folder_makes_its_records(folder, tmp_path):
    here = tmp_path / folder
    here.mkdir()
    for source in [*(ROOT / folder).glob("*.csv"), ROOT / folder / "make_records.py"]:
        shutil.copy(source, here)
    runpy.run_path(str(here / "make_records.py"))
    assert sorted(path.stem for path in here.glob("*.nc")) == sorted(NAMES)
    same = {name: read(here / f"{name}.nc").identical(read(ROOT / folder / f"{name}.nc")) for name in NAMES}
    assert same == dict.fromkeys(NAMES, True)


@pytest.mark.parametrize("folder", ["clapping_minimal", "clapping_beam"])
@pytest.mark.parametrize("name", NAMES)
def test_a_reference_record_says_that_it_is_not_measured(folder, name):
    attrs = read(ROOT / folder / f"{name}.nc").attrs
    assert attrs["warning"].startswith("not measured: ")
    assert attrs["warning"].endswith(f"(README of {folder})")
    assert attrs["source"] == f"experiments_ref/{folder}/{name}.csv"


def test_the_beam_s_motion_is_the_drive_and_no_evidence():
    assert read(ROOT / "clapping_beam" / "clapping.nc").attrs["prescribed"] == "beam.displacement,beam.velocity"
