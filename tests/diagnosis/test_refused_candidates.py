"""A candidate that is stated by itself and refused is told, with what may be done."""

from dataclasses import replace

import numpy as np
import pytest
from hidden.stepped import STUDY

from calib.diagnosis.candidate import candidates
from calib.records.response import make_response
from calib.study_file import load, stated_candidates
from calib.workflows.diagnose import _warn_of_refused


@pytest.fixture
def file(tmp_path):
    frequency = np.linspace(2.7, 4.0, 24)
    for name in ("levels", "between"):
        response = make_response(
            frequency, ["mass"], np.full((1, 24), 1e-3 - 1e-4j), 0.2, "N", place="mass", quantity="force"
        )
        response.to_netcdf(tmp_path / f"{name}.nc")
    (tmp_path / "study.toml").write_text(STUDY.format(seed=1))
    return load(tmp_path / "study.toml")


def refused(file, listed, searched):
    study, stated = file.study, stated_candidates(listed, file.path.parent)
    effects = [one.effect(file.path.parent) for one in stated]
    return stated, candidates(study.model, effects, study.objective.references, searched)[1]


@pytest.mark.parametrize(("searched", "advised"), [(["stiffness"], True), (["amplitude"], False)])
def test_a_gain_of_the_sensors_beside_responses_is_sent_to_the_factor_on_the_excitation(file, searched, advised):
    _, reasons = refused(file, ["channel_gain", "clipping"], searched)
    assert reasons["channel_gain"].endswith("give 'amplitude' a window") == advised
    assert reasons["clipping"].endswith("every record is a frequency response")


def test_candidates_that_are_stated_by_name_are_told_where_they_are_refused(file, recwarn):
    stated, reasons = refused(file, ["all", "channel_gain"], ["stiffness"])
    assert len(reasons) > 1
    _warn_of_refused(replace(file, candidates=stated), reasons)
    [told] = [str(one.message) for one in recwarn]
    assert told.startswith("candidate 'channel_gain' was not tested: it changes what is measured over time")
