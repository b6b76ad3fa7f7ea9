"""The thresholds of the diagnosis."""

import re
from dataclasses import FrozenInstanceError, fields

import pytest

from calib.diagnosis.criteria import CRITERIA, Criteria


@pytest.mark.parametrize("name", [field.name for field in fields(Criteria)])
def test_every_threshold_says_its_statistic_and_its_unit(name):
    [entry] = re.findall(rf"^    {name} : (.*?)(?=^    \w+ : |\Z)", Criteria.__doc__, re.DOTALL | re.MULTILINE)
    assert re.search(r"\[(1|count)\]", entry)


def test_thresholds_are_not_changed_in_passing():
    before = CRITERIA.aic_tie
    with pytest.raises(FrozenInstanceError, match="aic_tie"):
        CRITERIA.aic_tie = before + 1.0
    assert CRITERIA.aic_tie == before
