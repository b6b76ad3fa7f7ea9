"""What the tests of the workflows share: no pictures, which tests of the report and of the command line draw."""

import pytest


@pytest.fixture(scope="module", autouse=True)
def in_words_alone(without_pictures):
    """Draw nothing in any of their files."""
