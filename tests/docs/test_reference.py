"""The reference names what there is."""

import pkgutil
import re
from dataclasses import fields

import pytest
from docs.blocks import ROOT

from calib.study.result import CalibrationResult

PAGES = sorted((ROOT / "docs").rglob("*.md"))
FILES = (ROOT / "docs" / "reference" / "files.md").read_text(encoding="utf-8")
NAMED = sorted({name for page in PAGES for name in re.findall(r"`(calib(?:\.\w+)+)[`(]", page.read_text("utf-8"))})


def test_every_key_of_a_result_is_explained():
    missing = [one.name for one in fields(CalibrationResult) if f"`{one.name}`" not in FILES]
    assert not missing


@pytest.mark.parametrize("name", NAMED)
def test_a_name_of_the_package_is_one(name):
    assert pkgutil.resolve_name(name) is not None
