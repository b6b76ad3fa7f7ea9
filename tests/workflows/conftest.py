"""What the tests of the workflows share: no pictures, which tests of the report and of the command line draw."""

import pytest
from undrawn import empty_pictures


@pytest.fixture(scope="module", autouse=True)
def without_pictures():
    with empty_pictures():
        yield
