"""Hidden values are found again, and the stated intervals cover them as often as they say."""

from dataclasses import replace

import pytest
from recovery import CASES, coverage, recovered

from calib.modelling.parameter import Window


@pytest.mark.slow
def test_stated_intervals_cover_the_truth(tmp_path):
    """A sample: `tests/benchmarks/bench_intervals.py` plays as many as are asked for."""
    rows = coverage(range(3), tmp_path)
    missed = [row[:3] for row in rows if not row[3]]
    assert len(rows) >= 60
    assert 0.01 * len(rows) <= len(missed) <= 0.12 * len(rows), missed


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_hidden_values_are_found_again(name, tmp_path):
    case = replace(CASES[name], budget=400)
    truth, confidence = recovered(case, 77, tmp_path)
    assert confidence.reason == "", "the search has come to its end"
    for parameter, value in confidence.value.items():
        assert value == pytest.approx(truth[parameter], abs=5.0 * confidence.standard_error[parameter])


@pytest.mark.slow
def test_layer_stiffness_and_mass_are_only_determined_as_a_ratio(tmp_path):
    both = {"layer_stiffness": Window(0.8, 1.25, "log"), "layer_mass": Window(0.8, 1.25, "log")}
    case = CASES["four_dof"]
    _, confidence = recovered(replace(case, windows=case.windows | both), 3, tmp_path)
    [group] = [group for group in confidence.undetermined if "layer_mass" in group.members]
    assert set(group.members) == {"layer_stiffness", "layer_mass"}
