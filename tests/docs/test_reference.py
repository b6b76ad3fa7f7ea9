"""The reference names what there is."""

from dataclasses import fields

from docs.blocks import ROOT

from calib.study.result import CalibrationResult

FILES = (ROOT / "docs" / "reference" / "files.md").read_text(encoding="utf-8")


def test_every_key_of_a_result_is_explained():
    missing = [one.name for one in fields(CalibrationResult) if f"`{one.name}`" not in FILES]
    assert not missing
