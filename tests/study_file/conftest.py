"""What the tests of study files share: no pictures."""

import pytest
from undrawn import empty_pictures


@pytest.fixture(scope="module", autouse=True)
def without_pictures():
    with empty_pictures():
        yield
