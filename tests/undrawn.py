"""Calibrations that draw nothing, for tests that look at no picture: drawing takes most of a short run."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from markupsafe import Markup

from calib.report.pages.picture import _pictures
from calib.store.store import Store


@contextmanager
def _trials_undrawn() -> Iterator[pytest.MonkeyPatch]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Store, "_draw", lambda store, trial, records: None)
        yield patch


@contextmanager
def undrawn() -> Iterator[None]:
    """Leave the pictures of the trials out, and all of the report but its file; also a decorator."""
    with _trials_undrawn() as patch:
        patch.setattr("calib.report.pages.page.render", lambda *shown: "")
        yield


@contextmanager
def empty_pictures() -> Iterator[None]:
    """Leave the pictures of the trials out, and those of the report empty: for tests of its text; also a decorator."""
    with _trials_undrawn() as patch:
        patch.setattr("calib.report.pages.page.drawn", lambda content, jobs: {
            picture.name: Markup("<svg></svg>") for picture in _pictures(content)
        })  # fmt: skip
        yield
