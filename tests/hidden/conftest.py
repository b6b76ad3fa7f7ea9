"""Records without noise, which are simulated once for all tests that hide something in them."""

import os

import pytest


@pytest.fixture(scope="session")
def cache(tmp_path_factory):
    """Folder of clean records, one for all processes of a run: a file is named by what it depends on, and is whole."""
    if "PYTEST_XDIST_WORKER" not in os.environ:
        return tmp_path_factory.mktemp("clean")
    folder = tmp_path_factory.getbasetemp().parent / "clean"  # beside the folders of the processes
    folder.mkdir(exist_ok=True)
    return folder
