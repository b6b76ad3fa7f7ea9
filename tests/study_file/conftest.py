"""What the tests of study files share: no pictures."""

import pytest


@pytest.fixture(scope="module", autouse=True)
def in_words_alone(without_pictures):
    """Draw nothing in any of their files."""
