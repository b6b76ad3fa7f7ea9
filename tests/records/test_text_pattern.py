"""Texts that are looked for in lines."""

import pytest

from calib.errors import CalibError
from calib.records.text_pattern import comment_test, text_pattern


@pytest.mark.parametrize(
    ("stated", "line", "is_one"),
    [
        ("#!", "! a note", True),
        ("#!", " # behind a blank", False),
        (["LOG:"], " LOG: END OF RUN", True),
        (["LOG:"], " 1.0 LOG: 2.0", False),
        (["L.G"], "LOG", False),
        (["#", "/^1 +PAGE/"], "1   PAGE 3", True),
        (["#", "/^1 +PAGE/"], "1.0 2.0", False),
        (["/STEP/"], " END OF STEP 4", True),
        ([], "# no comment", False),
    ],
)
def test_a_line_is_a_comment_where_it_begins_or_matches_as_stated(stated, line, is_one):
    assert bool(comment_test(stated)(line)) is is_one


@pytest.mark.parametrize(("text", "reason"), [("", "not empty"), ("//", "not empty"), ("/(/", "no regular expression")])
def test_a_text_that_finds_nothing_is_refused(text, reason):
    with pytest.raises(CalibError, match=reason):
        text_pattern(text)
