"""What the tests of the workflows share: no pictures, which tests of the report, the command line and the pages draw."""

import pytest
from undrawn import empty_pictures


@pytest.fixture(scope="package", autouse=True)
def without_pictures():
    with empty_pictures():
        yield
